"""Keep sessions: a folder each, an ordinary OUT of the commands, with ``bench.json`` in it.

``bench.json`` holds all that a session stores: opening it again restores every state.
"""

from __future__ import annotations

import datetime
import json
import secrets
import shutil
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from qlvbayes.app.failures import ErrorContent, refused
from qlvbayes.io.files import write_whole
from qlvbayes.io.wording import as_typed

DATA = "data.csv"
"""The measurements in a session's folder."""
BENCH = "bench.json"
"""The state of a bench, in a session's folder."""
ASKED = ("sign", "contact", "columns", "units", "area")
"""Options of ``look -o`` that a question asks for."""
_PRIVATE = ".private"  # uploads
_RUN = "run.json"


class HistoryState(msgspec.Struct):
    """One model in the history of a pad."""

    id: int
    parent: int | None
    how: str
    elastic: str
    relaxation: str
    effects: list[str]
    values: dict[str, float]
    rmse: float | None
    heldout: float | None = None

    @property
    def model(self) -> dict[str, Any]:
        """Return the model as in the body of a request."""
        names = ("elastic", "relaxation", "effects", "values")
        return {name: getattr(self, name) for name in names}

    def shown(self) -> dict[str, Any]:
        """Return the state as the page receives it."""
        return msgspec.structs.asdict(self)


class BenchPad(msgspec.Struct):
    """Pad of a session: facts (units, noise, tests) and the history of its models.

    ``sampled`` is the state whose model was sampled last.
    """

    facts: dict[str, Any] = {}
    history: list[HistoryState] = []
    current: int = 0
    sampled: int | None = None

    def add(self, how: str, model: dict[str, Any], rmse: float | None) -> HistoryState:
        """Append a new state, which becomes the current one."""
        number = max((state.id for state in self.history), default=-1) + 1
        parent = self.current if self.history else None
        state = HistoryState(number, parent, how, rmse=rmse, **model)
        self.history.append(state)
        self.current = number
        return state

    def state(self, number: Any) -> HistoryState:
        """Return the state of that number; raise RefusedError where there is none."""
        for state in self.history:
            if state.id == number:
                return state
        raise refused(404, f"no state {number}", "ask for the session's state")


class Made(msgspec.Struct):
    """The files, and the options of ``look -o``, by which a tidy file was made."""

    files: list[str]
    options: dict[str, str]

    def __post_init__(self) -> None:
        """Refuse other options: the session may be a stranger's, and its command is run."""
        if not {*ASKED, "pad"}.issuperset(self.options):
            raise ValueError(self.options)


class _Stored(msgspec.Struct, kw_only=True):
    """Content of ``bench.json``."""

    schema: int = 1
    name: str
    data: str
    notices: list[str]
    found: list[str] = []
    pads: dict[str, BenchPad]
    made: Made | None = None


@dataclass
class Session:
    """Session of a user: the measurements, and for each pad the models that were tried.

    ``stage``, ``error`` and ``questions`` are those of the page; ``data`` is the tidy file, and
    ``made`` says how it was made of files of testing machines; ``found`` are the findings of that.
    ``answers`` are those to the questions so far. ``bands`` are those of the chains that were
    sampled last, as the page receives them.
    """

    id: str
    folder: Path
    private: Path
    name: str
    stage: str = "reading"
    error: ErrorContent | None = None
    questions: dict[str, Any] | None = None
    notices: list[str] = field(default_factory=list)
    found: list[str] = field(default_factory=list)
    pads: list[str] = field(default_factory=list)
    data: str = ""
    bench: dict[str, BenchPad] = field(default_factory=dict)
    bands: dict[str, dict[str, Any]] = field(default_factory=dict)
    uploads: list[str] = field(default_factory=list)
    answers: dict[str, str] = field(default_factory=dict)
    made: Made | None = None

    def known(self, name: str) -> None:
        """Raise RefusedError where there is no such pad, or no pad is known yet."""
        if not self.pads and self.stage != "failed":
            raise refused(409, "the measurements are still being read", "wait until it is ready")
        if name not in self.pads:
            raise refused(404, f"there is no pad {name!r}", f"use one of {', '.join(self.pads)}")

    def pad(self, name: str) -> BenchPad:
        """Return an open pad; raise RefusedError where it is not open."""
        self.known(name)
        if name not in self.bench:
            raise refused(404, f"the pad {name!r} is not open", "open it first")
        return self.bench[name]

    def shown(self) -> dict[str, Any]:
        """Return what the page shows of the session, without the jobs."""
        names = ("id", "name", "stage", "error", "questions", "pads", "notices", "found")
        shown = {name: getattr(self, name) for name in names}
        return shown | {"pad": {name: self.shown_pad(name) for name in self.bench}}

    def shown_pad(self, name: str) -> dict[str, Any]:
        """Return what the page shows of an open pad, with what a diagnosis left in its folder."""
        own, file = self.bench[name], self.folder / name / "diagnosis.json"
        diagnosis = ranking = None
        with suppress(OSError, ValueError):
            text = file.with_suffix(".txt").read_text().split("\n\n")
            diagnosis = json.loads(file.read_text())
            diagnosis["text"] = [one for one in text if one.strip()]
            ranked = ((x["effect"], x.get("inclusion")) for x in diagnosis.get("ranking", []))
            ranking = [{"effect": name, "probability": share} for name, share in ranked]
        history, bands = [state.shown() for state in own.history], self.bands.get(name)
        return {
            **own.facts, "current": own.current, "history": history, "ranking": ranking,
            "diagnosis": diagnosis, "bands": bands,
        }  # fmt: skip

    def save(self) -> None:
        """Write ``bench.json``."""
        stored = _Stored(
            name=self.name, data=Path(self.data).name, notices=self.notices, found=self.found,
            pads=self.bench, made=self.made,
        )  # fmt: skip
        self.folder.mkdir(parents=True, exist_ok=True)
        content = msgspec.json.format(msgspec.json.encode(stored), indent=2)
        write_whole(self.folder / BENCH, content)

    def load(self) -> None:
        """Read ``bench.json``; do nothing where there is none, or it is invalid."""
        try:
            stored = msgspec.json.decode((self.folder / BENCH).read_bytes(), type=_Stored)
        except (OSError, msgspec.MsgspecError):
            return
        self.name, self.notices, self.found = stored.name, stored.notices, stored.found
        self.bench, self.made, name = stored.pads, stored.made, stored.data
        if name and "/" not in name and "\\" not in name and (self.folder / name).is_file():
            self.data = str(self.folder / name)


class Sessions:
    """All sessions of a server below one folder, and folders of results opened where they are."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._open: dict[str, Session] = {}

    def new(self, name: str, folder: Path | None = None) -> Session:
        """Return an empty session; ``folder`` is one of results that exist already."""
        number = secrets.token_urlsafe(9)
        where = self._root / number if folder is None else folder
        session = Session(number, where, self._root / _PRIVATE / number, name)
        self._open[number] = session
        return session

    def get(self, number: str) -> Session:
        """Return the session of that id; raise RefusedError where there is none."""
        if number not in self._open:
            folder = self._root / number
            named = number.isascii() and number.replace("-", "a").replace("_", "a").isalnum()
            if not named or not (folder / BENCH).is_file():
                raise refused(404, "there is no such session", "open the measurements again")
            session = Session(number, folder, self._root / _PRIVATE / number, number, "closed")
            session.load()
            self._open[number] = session
        return self._open[number]

    def known(self) -> list[dict[str, str]]:
        """Return all stored sessions, the last first."""
        entries = []
        for file in self._root.glob(f"*/{BENCH}"):
            try:
                name = str(json.loads(file.read_text())["name"])
                changed = file.stat().st_mtime
            except (OSError, ValueError, KeyError, TypeError):
                continue
            when = datetime.datetime.fromtimestamp(changed, datetime.UTC)
            entries.append({"id": file.parent.name, "name": name, "changed": when.isoformat()})
        return sorted(entries, key=lambda entry: entry["changed"], reverse=True)

    def forget(self, session: Session) -> None:
        """Remove a session, and its folder where that is the server's own."""
        self._open.pop(session.id, None)
        shutil.rmtree(session.private, ignore_errors=True)
        if session.folder.parent == self._root:
            shutil.rmtree(session.folder, ignore_errors=True)


def commands(session: Session, pad: str) -> str:
    """Return command lines that sample the current state's model, check it, and diagnose.

    They begin with the one that makes the measurements, where they were files of other layouts.
    """
    own = session.pad(pad)
    state = own.state(own.current)
    data = Path(session.data).name
    lines = []
    if session.made is not None:
        files = [f"./{name}" if name.startswith("-") else name for name in session.made.files]
        options = [w for name, value in session.made.options.items() for w in (f"--{name}", value)]
        lines.append(["qlvbayes", "look", *files, *options, "-o", data])
    fit = ["qlvbayes", "fit", data, "--pads", pad, "--all-tests"]
    fit += ["--elastic", state.elastic, "--relaxation", state.relaxation]
    fit += [word for name in state.effects for word in ("--add", name)]
    diagnose = ["qlvbayes", "diagnose", data, "--pads", pad, "-o", "out"]
    check, report = (["qlvbayes", command, "out"] for command in ("check", "report"))
    lines += [[*fit, "-o", "out"], check, diagnose, report]
    return "\n".join(as_typed(*words) for words in lines) + "\n"


def source_of(folder: Path) -> Path | None:
    """Return the measurements of a folder of results: in it, or where its ``run.json`` says."""
    if (folder / DATA).is_file():
        return folder / DATA
    try:
        runs = json.loads((folder / _RUN).read_text())["runs"]
        sources = [Path(run["source"]) for run in runs.values()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return next((one for one in reversed(sources) if one.is_file()), None)


def holds_results(folder: Path) -> bool:
    """Return whether a command or the bench has left results in a folder."""
    return any((folder / name).is_file() for name in (_RUN, BENCH, DATA))
