"""Do the actions of a session: read files, open pads, change models, take guesses, order jobs."""

from __future__ import annotations

import asyncio
import json
import secrets
import shutil
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

from qlvbayes.app.calls import Calls
from qlvbayes.app.events import Events
from qlvbayes.app.failures import RefusedError, error_content, refused
from qlvbayes.app.jobs import Job, Jobs
from qlvbayes.app.sessions import DATA, BenchPad, HistoryState, Session, Sessions, entry
from qlvbayes.io.files import bundled

BUNDLED = {
    "pads": "pads A, B and C, simulated from the paper's Table 1",
    "hidden": "a pad with something hidden in it",
}
_AT_FIRST = 2.0  # s in which the page requests all that it shows
_CHANGES = ("add", "remove", "elastic", "relaxation")


class Actions:
    """Actions that the routes ask for, carried out in the server's own process."""

    def __init__(
        self,
        sessions: Sessions,
        calls: Calls,
        jobs: Jobs,
        events: Events,
        effects_file: str | None = None,
    ) -> None:
        self.sessions = sessions
        self.calls = calls
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

    def bundled(self) -> list[dict[str, str]]:
        """Return the measurements that come with the package, as far as they are installed."""
        return [
            {"name": name, "text": text}
            for name, text in BUNDLED.items()
            if bundled(f"{name}.csv").is_file()
        ]

    def open_bundled(self, name: str, *, guess: bool) -> Session:
        """Open a session with measurements that come with the package."""
        file = bundled(f"{name}.csv")
        if name not in BUNDLED or not file.is_file():
            raise refused(404, f"no measurements {name!r} come with it", "open a file of your own")
        session = self.sessions.new(file.name)
        session.guess = {"given": None} if guess else None
        answer = file.with_suffix(".answer.json")
        if answer.is_file():
            session.private.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(answer, session.truth)
        self.begin(session, [file])
        return session

    def open_simulated(self) -> Session:
        """Open a session with a newly simulated pad, in which something may be hidden."""
        session = self.sessions.new("a pad dealt to you")
        session.guess = {"given": None}
        session.seed = secrets.randbelow(2**31)
        self._later(session, self._simulate(session))
        return session

    def open_results(self, folder: Path) -> Session:
        """Open a session in a folder of results that the commands or the bench left."""
        session = self.sessions.new(folder.name, folder)
        session.load()
        source = Path(session.data) if session.data else _source_of(folder)
        if source is None or not source.is_file():
            session.stage = "failed"
            session.error = error_content(
                "the measurements of these results are not where they were",
                "open the measurements themselves",
                str(folder),
            )
        elif session.data:
            self.resume(session)
        else:
            self.begin(session, [source])
        return session

    def begin(self, session: Session, uploads: list[Path]) -> None:
        """Read files into a session."""
        session.uploads = [str(one) for one in uploads]
        archives = [one for one in uploads if one.suffix.lower() == ".zip"]
        if archives:
            self._later(session, self._unpack(session, archives[0]))
        else:
            self._later(session, self._read(session))

    async def answer(self, session: Session, answers: dict[str, str]) -> None:
        """Continue with the answers to the questions.

        A RefusedError is raised where one cannot be used; the questions then stay.
        """
        self._asked(session)
        answered = session.answers | answers
        result = await self._ask(
            "read", folder=str(session.folder), uploads=session.uploads, answers=answered
        )
        self._asked(session)  # and not answered twice meanwhile
        session.answers = answered
        self._stage(session, "reading")
        self._later(session, self._take(session, result))

    async def specimens(self, session: Session, pattern: str) -> dict[str, Any]:
        """Return the pads that a pattern finds in the names of the tests that are asked about."""
        names = self._asked(session).get("names")
        if names is None:
            raise refused(409, "no test is asked about", "ask for the session's state")
        answer: dict[str, Any] = await self._ask("specimens", names=names, pattern=pattern)
        return answer

    def _asked(self, session: Session) -> dict[str, Any]:
        """Return the questions; raise RefusedError where nothing is asked."""
        if session.stage != "asking" or session.questions is None:
            raise refused(409, "nothing is asked", "ask for the session's state")
        return session.questions

    def resume(self, session: Session) -> None:
        """Open a session that is stored in its folder."""
        if session.stage in ("closed", "reading"):
            session.stage = "reading"
            self._later(session, self._prepare(session))

    async def _simulate(self, session: Session) -> None:
        data = session.folder / DATA
        session.private.mkdir(parents=True, exist_ok=True)
        await self.jobs.run(
            {"kind": "deal", "data": str(data), "truth": str(session.truth), "seed": session.seed}
        )
        session.data = str(data)
        await self._prepare(session)

    async def _unpack(self, session: Session, archive: Path) -> None:
        unpacked = await self._ask("unpack", folder=str(session.folder), archive=str(archive))
        session.load()
        session.data = unpacked["data"]
        await self._prepare(session)

    async def _read(self, session: Session) -> None:
        self._stage(session, "reading")
        result = await self._ask(
            "read", folder=str(session.folder), uploads=session.uploads, answers={}
        )
        await self._take(session, result)

    async def _take(self, session: Session, result: dict[str, Any]) -> None:
        """Go on with what reading gave: questions, or the measurements."""
        session.questions = result.get("questions")
        if session.questions is not None:
            self._stage(session, "asking")
            return
        session.data, session.made = result["data"], result.get("made")
        await self._prepare(session, result.get("notices", []))

    async def _prepare(self, session: Session, notices: list[str] | None = None) -> None:
        """Do everything after the reading."""
        study = await self._ask("pads", data=session.data)
        session.pads = study["pads"]
        session.notices = [*(notices or []), *study["notices"]]
        self._stage(session, "preparing")
        known = [name for name in session.pads if name in session.bench]
        for name in known or session.pads[:1]:
            await self.open_pad(session, name)
        self._stage(session, "ready")

    async def open_pad(self, session: Session, pad: str) -> BenchPad:
        """Open a pad, and fit its first model if it is opened for the first time."""
        session.known(pad)
        async with self._locks.setdefault((session.id, pad), asyncio.Lock()):
            own = session.bench.get(pad) or BenchPad()
            if (session.id, pad) in self._opened:
                return own
            facts = await self._ask("open_pad", **self._where(session, pad), first=not own.history)
            self._opened.add((session.id, pad))
            model, curves = facts.pop("model", None), facts.pop("curves", None)
            own.facts = facts
            session.bench[pad] = own
            if model is not None:
                self._keep(session, pad, own.add("start", model, curves["rmse"], None))
            await self._bands(session, pad, own)
        session.save()
        self._later(None, self._warm(session, pad))
        return own

    async def _warm(self, session: Session, pad: str) -> None:
        await asyncio.sleep(_AT_FIRST)
        await self._ask("warm", **self._where(session, pad))

    async def _bands(self, session: Session, pad: str, own: BenchPad) -> None:
        """Read the bands of a chain that was sampled before, here or by a command."""
        folder = session.folder / pad
        if not all((folder / name).is_file() for name in ("curves.json", "summary.json")):
            return
        bands = await self._ask("bands", **self._where(session, pad), folder=str(folder))
        own.bands = {"state": own.sampled, **bands}

    # the model by hand

    async def forwarded(self, session: Session, pad: str, call: str, /, **arguments: Any) -> bytes:
        """Return the worker's answer to a call about a pad, as it comes."""
        session.known(pad) if call == "measured" else session.pad(pad)
        return await self.calls.call(call, **self._where(session, pad), **arguments)

    async def change(self, session: Session, pad: str, body: dict[str, Any]) -> dict[str, Any]:
        """Make a new state of the model."""
        own = session.pad(pad)
        how, name, model = _change_of(body)
        raw = await self.forwarded(session, pad, "change", model=model, how=how, name=name)
        changed = json.loads(raw)
        words = {"add": f"add {name}", "remove": f"remove {name}", "keep": "kept", "fit": "fit"}
        state = own.add(
            words.get(how, "laws"), changed["model"], changed["curves"]["rmse"], model.get("values")
        )
        self._keep(session, pad, state)
        session.save()
        return {"state": entry(state), "curves": changed["curves"]}

    async def go_back(self, session: Session, pad: str, number: int) -> dict[str, Any]:
        """Go back to a state of the history."""
        own = session.pad(pad)
        state = own.state(number)
        curves = json.loads(await self.forwarded(session, pad, "curves", model=state.model))
        own.current = number
        session.save()
        self.events.publish(session.id, "state", {"pad": pad, "state": entry(state)})
        return {"state": entry(state), "curves": curves}

    def _keep(self, session: Session, pad: str, state: HistoryState) -> None:
        """Publish a new state, and compute its held-out error."""
        self.events.publish(session.id, "state", {"pad": pad, "state": entry(state)})
        self._later(None, self._held_out(session, pad, state))

    async def _held_out(self, session: Session, pad: str, state: HistoryState) -> None:
        answer = await self._ask("held_out", **self._where(session, pad), model=state.model)
        state.heldout = answer["heldout"]
        self.events.publish(session.id, "state", {"pad": pad, "state": entry(state)})
        session.save()

    # guesses

    def guess(self, session: Session, effects: list[str], words: str) -> dict[str, Any]:
        """Record a guess, and return what was hidden."""
        if session.guess is None:
            raise refused(409, "nothing is to be guessed here", "open it in guess mode")
        if session.is_hiding:
            session.guess = {"given": {"effects": effects, "words": words}}
            session.guess["truth"] = _truth(session.truth)
            session.save()
            self.events.publish(session.id, "session", {"stage": session.stage})
        return session.guess

    # jobs

    def order(self, session: Session, body: dict[str, Any]) -> Job:
        """Start a job that the page asks for."""
        kind = body.get("kind")
        pads = body.get("pads") or ([body["pad"]] if body.get("pad") else [])
        for name in pads:
            session.known(str(name))
        wanted = {"diagnose": 1, "sample": 1, "compare": 2, "report": 0}
        if kind not in wanted:
            raise refused(422, f"no job {kind!r}", f"use one of {', '.join(wanted)}")
        if len(set(pads)) != wanted[kind]:
            raise refused(422, f"{kind} needs {wanted[kind]} pads", "name them")
        if session.is_hiding and kind in ("diagnose", "report"):
            raise refused(409, "a guess is owed first", "write down what you think is missing")
        spec = {"kind": kind, "out": str(session.folder), "data": session.data, "pads": pads}
        spec |= {"effects_file": self._effects_file, "models": {}}
        spec["all_tests"] = bool(body.get("all_tests", True))
        for name in pads:
            own = session.bench.get(name)
            if own is not None and own.history:
                spec["models"][name] = own.state(own.current).model
        if kind == "sample" and body.get("model"):
            spec["models"][pads[0]] = body["model"]
        sampled = {name: session.bench[name].current for name in pads if name in session.bench}
        return self.jobs.add(session.id, spec, lambda job: self._finished(session, job, sampled))

    async def _finished(self, session: Session, job: Job, sampled: dict[str, int]) -> None:
        """Take in what a job has left in the folder, and publish it."""
        if job.kind in ("sample", "compare"):
            for name in job.result.get("sampled", []):
                if name in session.bench:
                    own = session.bench[name]
                    own.sampled = sampled.get(name)
                    await self._bands(session, name, own)
            session.save()
        what = {"diagnose": "diagnosis", "sample": "bands", "compare": "comparison"}
        names: list[str | None] = [*job.pads] or [None]
        for name in names:
            data = {"pad": name, "what": what.get(job.kind, job.kind)}
            self.events.publish(session.id, "result", data)

    # all else

    def _where(self, session: Session, pad: str) -> dict[str, Any]:
        return {"data": session.data, "pad": pad, "effects_file": self._effects_file}

    async def _ask(self, call: str, /, **arguments: Any) -> Any:
        """Return the answer to a call that no request waits for.

        Repeat it once if the worker dies.
        """
        for last in (False, True):
            await self.calls.up()
            try:
                return json.loads(await self.calls.call(call, **arguments))
            except RefusedError as error:
                if error.status != 503 or last:
                    raise
        raise AssertionError

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


def _change_of(body: dict[str, Any]) -> tuple[str, str, dict[str, Any]]:
    """Return how a model is to change, the name involved, and the model."""
    how, name, model = "", "", None
    for key in ("keep", "fit"):
        if key in body:
            how, model = key, body[key]
    for key in _CHANGES:
        if key in body:
            how, name, model = key, body[key], body.get("model")
    if not how or not isinstance(name, str) or not isinstance(model, dict):
        raise refused(422, "no change of a model is asked for", "see docs/app.md")
    return how, name, model


def _source_of(folder: Path) -> Path | None:
    """Return the measurements of a folder of results: in it, or where its ``run.json`` says."""
    if (folder / DATA).is_file():
        return folder / DATA
    try:
        runs = json.loads((folder / "run.json").read_text())["runs"]
        sources = [Path(run["source"]) for run in runs.values()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return next((one for one in reversed(sources) if one.is_file()), None)


def _truth(file: Path) -> dict[str, Any] | None:
    """Return what was hidden, as names and as text; None where that is unknown."""
    try:
        effects = json.loads(file.read_text())["effects"]
    except (OSError, ValueError, KeyError):
        return None
    lines = [
        f"{one['effect']} ({', '.join(f'{k} = {v:.3g}' for k, v in one['parameters'].items())})"
        for one in effects
    ]
    return {
        "effects": [one["effect"] for one in effects],
        "text": " and ".join(lines) if lines else "nothing was hidden",
    }
