"""Run long work in processes of its own: a queue, one warm process, progress, cancelling."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections import defaultdict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

from qlvbayes.app.events import Events
from qlvbayes.app.failures import ErrorContent, RefusedError, error_content, refused
from qlvbayes.app.pipes import Process

MODULE = "qlvbayes.app.job"
AT_ONCE = max(1, min(2, (os.cpu_count() or 1) - 1))
"""Jobs that run together, with one core left for the page."""
_OVER = ("done", "failed", "cancelled")
_LISTED = 50  # jobs of a session that are kept

Finished = Callable[["Job"], Awaitable[None]]


@dataclass(eq=False)
class Job:
    """Job of the server.

    ``enough`` is whether a search was asked to end with its results so far; ``result`` is what its
    process returned; ``probabilities`` are those that it reported last.
    """

    id: str
    session: str
    spec: dict[str, Any]
    state: str = "waiting"
    text: str = ""
    done: int | None = None
    total: int | None = None
    left_s: float | None = None
    elapsed_s: float = 0.0
    error: ErrorContent | None = None
    enough: bool = False
    result: dict[str, Any] = field(default_factory=dict)
    probabilities: dict[str, Any] = field(default_factory=dict)
    ended: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def kind(self) -> str:
        """Return the kind of job."""
        return str(self.spec["kind"])

    @property
    def pads(self) -> list[str]:
        """Return the names of its pads."""
        return list(self.spec["pads"])

    @property
    def over(self) -> bool:
        """Return whether it has ended, one way or another."""
        return self.state in _OVER


class Jobs:
    """All jobs of a server, in the order in which they were requested."""

    def __init__(self, events: Events) -> None:
        self._events = events
        self._jobs: dict[str, Job] = {}
        self._finished: dict[str, Finished] = {}
        self._running: dict[str, asyncio.Task[None]] = {}
        self._processes: dict[str, Process] = {}
        self._numbers: defaultdict[str, count[int]] = defaultdict(lambda: count(1))
        self._spare: asyncio.Task[Process] | None = None
        self._closed = False

    def warm(self) -> None:
        """Start a process that is ready for the next job."""
        if self._spare is None and not self._closed:
            self._spare = asyncio.create_task(Process.spawn(MODULE))

    async def close(self) -> None:
        """End every process."""
        self._closed = True
        for task in list(self._running.values()):
            task.cancel()
        await asyncio.gather(*self._running.values(), return_exceptions=True)
        if self._spare is not None:
            await (await self._spare).kill()

    # what the page asks for

    def add(self, session: str, spec: dict[str, Any], finished: Finished) -> Job:
        """Append a job to the queue; raise RefusedError where the same job is there already."""
        for other in self.in_session(session):
            same = (other.kind, other.pads) == (spec["kind"], spec["pads"])
            if same and not other.over:
                raise refused(409, f"a {other.kind} of this is there already", "wait or cancel it")
        job = Job(f"j{next(self._numbers[session])}", session, spec)
        self._jobs[f"{session}/{job.id}"] = job
        self._finished[f"{session}/{job.id}"] = finished
        over = [one for one in self.in_session(session) if one.over]
        for old in over[: max(0, len(over) - _LISTED)]:
            self._forget(old)
        self._start_next()
        self._publish_waiting()
        return job

    def get(self, session: str, number: str) -> Job:
        """Return the job of that id; raise RefusedError where there is none."""
        key = f"{session}/{number}"
        if key not in self._jobs:
            raise refused(404, f"there is no job {number}", "ask for the session's state")
        return self._jobs[key]

    def in_session(self, session: str) -> list[Job]:
        """Return the jobs of one session."""
        return [job for job in self._jobs.values() if job.session == session]

    async def cancel(self, job: Job) -> None:
        """End a job and its process at once; remove one that is over."""
        if job.over:
            self._forget(job)
            return
        job.state = "cancelled"
        if (task := self._running.get(_key(job))) is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        else:
            self._end(job)

    async def enough(self, job: Job) -> None:
        """Make a search sum up its results so far; raise RefusedError where there are none."""
        process = self._processes.get(_key(job))
        if job.kind != "diagnose" or process is None or not job.probabilities:
            raise refused(409, "nothing is known yet", "wait for the first probabilities")
        if not job.enough:
            job.enough = True
            with contextlib.suppress(ConnectionError):
                await process.write({"enough": True})
            self._publish(job)

    async def cancel_all(self, session: str) -> None:
        """Cancel all jobs of one session."""
        for job in self.in_session(session):
            await self.cancel(job)
            if _key(job) in self._jobs:
                self._forget(job)

    def shown(self, job: Job) -> dict[str, Any]:
        """Return a job as the page receives it."""
        return {
            "id": job.id,
            "kind": job.kind,
            "pad": job.pads[0] if job.pads else None,
            "pads": job.pads,
            "state": job.state,
            "place": self._waiting.index(job) + 1 if job in self._waiting else 0,
            "text": job.text,
            "enough": None if not (job.kind == "diagnose" and job.probabilities) else job.enough,
            "done": job.done,
            "total": job.total,
            "left_s": job.left_s,
            "elapsed_s": job.elapsed_s,
            "error": job.error,
        }

    async def run(self, spec: dict[str, Any]) -> dict[str, Any]:
        """Return the result of something short, done in a process of its own outside the queue.

        A RefusedError is raised as the process reports it.
        """
        job = Job("", "", {"pads": [], **spec})
        process = await self._take()
        try:
            await self._follow(job, process)
        finally:
            await process.kill()
            self.warm()
        return job.result

    # the queue

    @property
    def _waiting(self) -> list[Job]:
        return [job for job in self._jobs.values() if job.state == "waiting"]

    def _start_next(self) -> None:
        for job in self._waiting:
            if len(self._running) >= AT_ONCE or self._closed:
                return
            job.state = "running"
            self._running[_key(job)] = asyncio.create_task(self._run(job))

    async def _run(self, job: Job) -> None:
        process: Process | None = None
        try:
            job.text = "starting"
            self._publish(job)
            process = self._processes[_key(job)] = await self._take()
            await self._follow(job, process)
            await self._finished[_key(job)](job)
            job.state = "done"
        except RefusedError as error:
            job.state, job.error = "failed", error.content
        except asyncio.CancelledError:
            job.state = "cancelled"
        finally:
            if process is not None:
                await asyncio.shield(_gone(process, job))
            self._running.pop(_key(job), None)
            self._processes.pop(_key(job), None)
            self._end(job)
            self._start_next()
            self._publish_waiting()
            self.warm()

    async def _follow(self, job: Job, process: Process) -> None:
        """Send the job to the process, and listen until it is over."""
        with contextlib.suppress(ConnectionError):
            await process.write(job.spec)
        while (line := await process.read()) is not None:
            if "error" in line:
                raise RefusedError(422, line["error"])
            if "result" in line:
                job.result = line["result"]
                return
            if "probabilities" in line:
                job.probabilities = line["probabilities"]
                self._events.publish(job.session, "ranking", job.probabilities)
                continue
            job.text, job.elapsed_s = line["text"], line["elapsed_s"]
            job.done, job.total, job.left_s = line["done"], line["total"], line["left_s"]
            if job.session:
                self._publish(job)
        status = await process.wait()
        message = f"the process that computed this has died (status {status})"
        raise RefusedError(500, error_content(message, "start it again: it goes on where it was"))

    async def _take(self) -> Process:
        """Return the spare process, or a new one."""
        self.warm()
        if self._spare is None:
            raise refused(503, "the server is ending", "start it again")
        spare, self._spare = self._spare, None
        return await spare

    def _end(self, job: Job) -> None:
        job.left_s = None
        job.ended.set()
        self._publish(job)

    def _forget(self, job: Job) -> None:
        self._jobs.pop(_key(job), None)
        self._finished.pop(_key(job), None)

    def _publish(self, job: Job) -> None:
        self._events.publish(job.session, "job", self.shown(job))

    def _publish_waiting(self) -> None:
        """Publish the waiting jobs, as their positions have changed."""
        for job in self._waiting:
            self._publish(job)


def _key(job: Job) -> str:
    return f"{job.session}/{job.id}"


async def _gone(process: Process, job: Job) -> None:
    """End a process, and remove its half-written files."""
    await process.kill()
    for name in job.pads:
        for part in (Path(job.spec["out"]) / name).glob("*.part"):
            part.unlink(missing_ok=True)
