"""Do the actions of a session: read files, open pads, change models, order jobs."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import msgspec

from qlvbayes.app.events import Events
from qlvbayes.app.failures import RefusedError, error_content, refused
from qlvbayes.app.jobs import Job, Jobs
from qlvbayes.app.sessions import BenchPad, HistoryState, Made, Session, Sessions, source_of
from qlvbayes.app.workers import WarmWorker
from qlvbayes.io.files import DESCRIBED, bundled

BUNDLED = {
    "pads": "pads A, B and C, simulated from the paper's Table 1",
    "hidden": "a pad with something hidden in it",
}
_HOW = {"keep": "kept", "fit": "fit", "add": "add {}", "remove": "remove {}",
        "elastic": "laws", "relaxation": "laws"}  # fmt: skip
_KINDS = ("diagnose", "sample", "report")  # of jobs


class Actions:
    """Actions that the routes ask for, carried out in the server's own process."""

    def __init__(
        self,
        sessions: Sessions,
        worker: WarmWorker,
        jobs: Jobs,
        events: Events,
        effects_file: str | None = None,
    ) -> None:
        self.sessions = sessions
        self.worker = worker
        self.jobs = jobs
        self.events = events
        self._effects_file = effects_file
        self._tasks: set[asyncio.Task[None]] = set()
        self._locks: dict[tuple[str, str], asyncio.Lock] = {}
        self._opened: set[tuple[str, str]] = set()

    # sessions

    def shown(self, session: Session) -> dict[str, Any]:
        """Return all that is shown of a session, with the probabilities of a running search."""
        shown, jobs = session.shown(), self.jobs.in_session(session.id)
        for job in jobs:
            if job.state == "running" and job.probabilities:
                so_far = {key: job.probabilities[key] for key in ("ranking", "laws")}
                shown["pad"][job.probabilities["pad"]] |= so_far
        return shown | {"jobs": [self.jobs.shown(job) for job in jobs]}

    def open_bundled(self, body: dict[str, Any]) -> dict[str, str]:
        """Open a session with measurements that come with the package."""
        name = str(body.get("open"))
        file = bundled(f"{name}.csv")
        if name not in BUNDLED or not file.is_file():
            raise refused(404, f"no measurements {name!r} come with it", "open a file of your own")
        session = self.sessions.new(file.name)
        self.begin(session, [file])
        return {"id": session.id}

    def open_path(self, path: Path) -> Session:
        """Open a session with a file, or in a folder of results of the commands or the bench."""
        session = self.sessions.new(path.name, path if path.is_dir() else None)
        if path.is_file():
            self.begin(session, [path])
            return session
        session.load()
        source = Path(session.data) if session.data else source_of(path)
        if source is None:
            what = "the measurements of these results are not where they were"
            remedy = "open the measurements themselves"
            session.stage, session.error = "failed", error_content(what, remedy, str(path))
        elif session.data:
            self.resume(session)
        else:
            self.begin(session, [source])
        return session

    def begin(self, session: Session, uploads: list[Path]) -> None:
        """Read files into a session."""
        session.uploads = [str(one) for one in uploads]
        self._later(session, self._read(session))

    def resume(self, session: Session) -> None:
        """Open a session that is stored in its folder."""
        session.stage = "reading"
        self._later(session, self._prepare(session))

    async def answer(self, session: Session, body: dict[str, Any]) -> dict[str, bool]:
        """Continue with the answers to the questions about a file."""
        given = body.get("answers")
        if not isinstance(given, dict):
            raise refused(422, "there are no answers", "see docs/app.md")
        _refuse_unasked(session)
        words = {str(key): str(value) for key, value in given.items() if value not in (None, "")}
        answered = session.answers | words
        result = await self._reading(session, answered)
        _refuse_unasked(session)  # and not answered twice meanwhile
        session.answers = answered
        self._stage(session, "reading")
        self._later(session, self._take(session, result))
        return {"ok": True}

    async def _read(self, session: Session) -> None:
        self._stage(session, "reading")
        await self._take(session, await self._reading(session, {}))

    async def _reading(self, session: Session, answers: dict[str, str]) -> Any:
        folder, uploads = str(session.folder), session.uploads
        return await self._ask("read", folder=folder, uploads=uploads, answers=answers)

    async def _take(self, session: Session, result: dict[str, Any]) -> None:
        """Go on with what reading gave: questions, or the measurements."""
        session.questions = result.get("questions")
        if session.questions is not None:
            self._stage(session, "asking")
            return
        session.data, session.found = result["data"], result.get("found", [])
        session.made = msgspec.convert(result["made"], Made) if "made" in result else None
        await self._prepare(session)

    async def _prepare(self, session: Session) -> None:
        """Do everything after the reading."""
        study = await self._ask("pads", data=session.data)
        session.pads, session.notices = study["pads"], study["notices"]
        self._stage(session, "preparing")
        known = [name for name in session.pads if name in session.bench]
        for name in known or session.pads[:1]:
            await self.open_pad(session, name)
        self._stage(session, "ready")

    async def open_pad(self, session: Session, pad: str) -> dict[str, Any]:
        """Open a pad, and fit its first model if it is opened for the first time."""
        session.known(pad)
        async with self._locks.setdefault((session.id, pad), asyncio.Lock()):
            if (session.id, pad) in self._opened:
                return session.shown_pad(pad)
            own = session.bench.get(pad) or BenchPad()
            opened = await self._ask("open_pad", **self._where(session, pad), first=not own.history)
            self._opened.add((session.id, pad))
            own.facts = opened["facts"]
            session.bench[pad] = own
            if "model" in opened:
                rmse = opened["curves"]["rmse"]
                self._keep(session, pad, own.add("start", opened["model"], rmse))
            await self._bands(session, pad)
        session.save()
        return session.shown_pad(pad)

    async def _bands(self, session: Session, pad: str) -> None:
        """Read the bands of a chain that was sampled before, here or by a command."""
        folder = session.folder / pad
        if all((folder / name).is_file() for name in ("posterior.nc", "summary.json")):
            bands = await self._ask("bands", **self._where(session, pad), folder=str(folder))
            own, model = session.bench[pad], bands["model"]
            alike = (s.id for s in own.history if s.model | {"values": None} == model)
            state = next(alike, None) if own.sampled is None else own.sampled
            session.bands[pad] = {"state": state, **bands}

    # the model by hand

    async def forwarded(self, session: Session, pad: str, call: str, /, **arguments: Any) -> bytes:
        """Return the worker's answer to a call about a pad, as it comes."""
        session.known(pad) if call == "measured" else session.pad(pad)
        return await self.worker.call(call, **self._where(session, pad), **arguments)

    async def change(self, session: Session, pad: str, body: dict[str, Any]) -> dict[str, Any]:
        """Make a new state of the model."""
        own = session.pad(pad)
        how = next((key for key in _HOW if key in body), "")
        plain = how in ("keep", "fit")
        name, model = ("", body[how]) if plain else (body.get(how), body.get("model"))
        if not isinstance(name, str) or not isinstance(model, dict):
            raise refused(422, "no change of a model is asked for", "see docs/app.md")
        raw = await self.forwarded(session, pad, "change", model=model, how=how, name=name)
        changed, curves = (found := json.loads(raw)), found["curves"]
        state = own.add(_HOW[how].format(name), changed["model"], curves["rmse"])
        self._keep(session, pad, state)
        session.save()
        return {"state": state.shown(), "curves": curves}

    async def go_back(self, session: Session, pad: str, body: dict[str, Any]) -> dict[str, Any]:
        """Go back to a state of the history."""
        own = session.pad(pad)
        state = own.state(body.get("state"))
        curves = json.loads(await self.forwarded(session, pad, "curves", model=state.model))
        own.current = state.id
        session.save()
        self._publish(session, pad, state)
        return {"state": state.shown(), "curves": curves}

    def _publish(self, session: Session, pad: str, state: HistoryState) -> None:
        self.events.publish(session.id, "state", {"pad": pad, "state": state.shown()})

    def _keep(self, session: Session, pad: str, state: HistoryState) -> None:
        """Publish a new state, and compute its held-out error."""
        self._publish(session, pad, state)
        self._later(None, self._held_out(session, pad, state))

    async def _held_out(self, session: Session, pad: str, state: HistoryState) -> None:
        answer = await self._ask("held_out", **self._where(session, pad), model=state.model)
        state.heldout = answer["heldout"]
        self._publish(session, pad, state)
        session.save()

    # jobs

    def order(self, session: Session, body: dict[str, Any]) -> dict[str, Any]:
        """Start a job that the page asks for."""
        kind, pad, state = str(body.get("kind")), body.get("pad"), None
        if kind not in _KINDS:
            raise refused(422, f"no job {kind!r}", f"use one of {', '.join(_KINDS)}")
        spec: dict[str, Any] = {"out": str(session.folder)}
        if kind == "report":
            pad = None
        else:
            pad = str(pad or "")
            session.known(pad)
            model = body.get("model")
            if (own := session.bench.get(pad)) is not None:
                state = own.current
                model = model or own.state(state).model
            spec |= {"pad": pad, "model": model, **self._where(session, pad)}
            if kind == "diagnose":  # which describes anew
                spec["effects_file"] = self._effects_file
        return self.jobs.add(
            session.id, kind, pad, spec, lambda job: self._finished(session, job, state)
        )

    async def _finished(self, session: Session, job: Job, state: int | None) -> None:
        """Take in what a job has left in the folder, and publish it."""
        if job.kind == "sample" and job.pad in session.bench:
            session.bench[job.pad].sampled = state
            await self._bands(session, job.pad)
            session.save()
        job.probabilities = {}  # those of the result count from now on
        self.events.publish(session.id, "result", {"pad": job.pad, "what": job.kind})

    # all else

    def _where(self, session: Session, pad: str) -> dict[str, Any]:
        """Return where a pad is, with the user's effects or else the law that was described."""
        law = session.folder / pad / DESCRIBED
        file = self._effects_file or (str(law) if law.exists() else None)
        return {"data": session.data, "pad": pad, "effects_file": file}

    async def _ask(self, call: str, /, **arguments: Any) -> Any:
        """Return the answer to a call that no request waits for."""
        return json.loads(await self.worker.patient_call(call, **arguments))

    def _stage(self, session: Session, stage: str) -> None:
        session.stage = stage
        self.events.publish(session.id, "session", {"stage": stage})

    def _later(self, session: Session | None, work: Coroutine[Any, Any, None]) -> None:
        """Do work in the background; an error becomes the session's error."""

        async def run() -> None:
            try:
                await work
            except RefusedError as error:
                if session is not None:
                    session.error = error.content
                    self._stage(session, "failed")

        if session is not None:
            session.error, session.questions = None, None
        task = asyncio.create_task(run())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def close(self) -> None:
        """Stop the background work."""
        for task in self._tasks:
            task.cancel()


def _refuse_unasked(session: Session) -> None:
    if session.stage != "asking" or session.questions is None:
        raise refused(409, "nothing is asked", "ask for the session's state")
