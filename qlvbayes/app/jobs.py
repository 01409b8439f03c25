"""Run long work, each in a worker of its own: a queue, progress, cancelling."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

from qlvbayes.app.events import Events
from qlvbayes.app.failures import ErrorContent, RefusedError, refused
from qlvbayes.app.workers import Worker

AT_ONCE = max(1, min(2, (os.cpu_count() or 1) - 1))  # jobs that run together: a core is the page's
_LISTED = 50  # jobs of a session that are kept once they are over


@dataclass(eq=False)
class Job:
    """Job of a session: a call of ``steps``, with its arguments and its progress so far.

    ``enough`` is whether a search was asked to end with its results so far; ``probabilities`` are
    those that it reported last. ``finished`` takes in what the job has left in the folder.
    """

    id: str
    session: str
    kind: str
    pad: str | None
    spec: dict[str, Any]
    finished: Callable[[Job], Awaitable[None]] | None = None
    state: str = "waiting"
    progress: dict[str, Any] = field(default_factory=lambda: {"text": "", "elapsed_s": 0.0})
    error: ErrorContent | None = None
    enough: bool = False
    probabilities: dict[str, Any] = field(default_factory=dict)
    worker: Worker | None = None
    task: asyncio.Task[None] | None = None

    @property
    def over(self) -> bool:
        """Return whether it has ended, one way or another."""
        return self.state in ("done", "failed", "cancelled")


class Jobs:
    """All jobs of a server, in the order in which they were requested."""

    def __init__(self, events: Events) -> None:
        self._events = events
        self._jobs: list[Job] = []
        self._numbers = count(1)
        self._turn = asyncio.Semaphore(AT_ONCE)

    async def close(self) -> None:
        """End every worker."""
        for job in self._jobs:
            if job.task is not None:
                job.task.cancel()
        await asyncio.gather(*(job.task for job in self._jobs if job.task), return_exceptions=True)

    def add(
        self, session: str, kind: str, pad: str | None, spec: dict[str, Any],
        finished: Callable[[Job], Awaitable[None]],
    ) -> dict[str, Any]:  # fmt: skip
        """Append a job to the queue; raise RefusedError where the same job is there already."""
        own = self.in_session(session)
        if any((one.kind, one.pad) == (kind, pad) and not one.over for one in own):
            raise refused(409, f"a {kind} of this is there already", "wait or cancel it")
        for old in [one for one in own if one.over][:-_LISTED]:
            self._jobs.remove(old)
        job = Job(f"j{next(self._numbers)}", session, kind, pad, spec, finished)
        self._jobs.append(job)
        job.task = asyncio.create_task(self._run(job))
        self._publish(job)
        return self.shown(job)

    async def run(self, kind: str, spec: dict[str, Any]) -> None:
        """Do something short at once, outside the queue."""
        await self._work(Job("", "", kind, None, spec))

    def get(self, session: str, number: str) -> Job:
        """Return the job of that id; raise RefusedError where there is none."""
        for job in self.in_session(session):
            if job.id == number:
                return job
        raise refused(404, f"there is no job {number}", "ask for the session's state")

    def in_session(self, session: str) -> list[Job]:
        """Return the jobs of one session."""
        return [job for job in self._jobs if job.session == session]

    async def cancel(self, job: Job) -> dict[str, Any]:
        """End a job and its worker at once; remove one that is over."""
        if job.over:
            self._jobs.remove(job)
        elif job.task is not None:
            job.task.cancel()
            await asyncio.gather(job.task, return_exceptions=True)
        return self.shown(job)

    async def enough(self, job: Job) -> dict[str, Any]:
        """Make a search sum up its results so far; raise RefusedError where there are none."""
        if job.worker is None or not job.probabilities or job.over:
            raise refused(409, "nothing is known yet", "wait for the first probabilities")
        if not job.enough:
            job.enough = True
            await job.worker.call("enough")
            self._publish(job)
        return self.shown(job)

    async def cancel_all(self, session: str) -> None:
        """Cancel and remove all jobs of one session."""
        for job in self.in_session(session):
            await self.cancel(job)
        self._jobs = [job for job in self._jobs if job.session != session]

    def shown(self, job: Job) -> dict[str, Any]:
        """Return a job as the page receives it."""
        waiting = [one for one in self._jobs if one.state == "waiting"]
        known = {name: getattr(job, name) for name in ("id", "kind", "pad", "state", "error")}
        place = waiting.index(job) + 1 if job in waiting else 0
        enough = job.enough if job.probabilities else None
        return known | {"place": place, "enough": enough, **job.progress}

    async def _run(self, job: Job) -> None:
        try:
            async with self._turn:
                job.state = "running"
                self._publish(job)
                await self._work(job)
            job.state = "done"
        except RefusedError as error:
            job.state, job.error = "failed", error.content
        except asyncio.CancelledError:
            job.state = "cancelled"
        job.progress["left_s"] = None
        for one in (job, *(one for one in self._jobs if one.state == "waiting")):
            self._publish(one)

    async def _work(self, job: Job) -> None:
        """Do a job in a worker, and end that."""
        job.worker = await Worker.spawn("steps")
        try:
            await job.worker.call(job.kind, lambda line: self._on_progress(job, line), **job.spec)
            if job.finished is not None:
                await job.finished(job)
        except RefusedError as error:
            if error.status != 503:
                raise
            what = "the process that computed this has died"
            raise refused(500, what, "start it again: it goes on where it was") from None
        finally:
            await asyncio.shield(_end(job.worker, job))

    def _on_progress(self, job: Job, line: dict[str, Any]) -> None:
        if "probabilities" in line:
            job.probabilities = line["probabilities"]
            self._events.publish(job.session, "ranking", job.probabilities)
        else:
            job.progress = line
        self._publish(job)

    def _publish(self, job: Job) -> None:
        self._events.publish(job.session, "job", self.shown(job))


async def _end(worker: Worker, job: Job) -> None:
    """End a job's worker, and remove its half-written files."""
    await worker.kill()
    for part in Path(job.spec["out"]).glob(f"{job.pad or ''}/*.part"):
        part.unlink(missing_ok=True)
