"""Keep sessions: a folder each, an ordinary OUT of the commands, with ``bench.json`` in it.

``bench.json`` holds all that a session stores: opening it again restores every state.
"""

from __future__ import annotations

import datetime
import json
import secrets
import shutil
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from qlvbayes.app.failures import ErrorContent, refused
from qlvbayes.io.files import write_json

DATA = "data.csv"
"""The measurements in a session's folder."""
BENCH = "bench.json"
"""The state of a bench, in a session's folder."""
ASKED = ("sign", "contact", "units", "area")
"""Options of ``convert`` that a question asks for."""
CONVERT_OPTIONS = frozenset({*ASKED, "pad"})
"""Those that a session may have."""
_PRIVATE = ".private"  # uploads, and hidden effects that are not to be shown yet


@dataclass
class HistoryState:
    """One model in the history of a pad.

    ``begun`` are the constants that its fit began from.
    """

    id: int
    parent: int | None
    how: str
    elastic: str
    relaxation: str
    effects: list[str]
    values: dict[str, float]
    rmse: float | None
    heldout: float | None = None
    begun: dict[str, float] = field(default_factory=dict)

    @property
    def model(self) -> dict[str, Any]:
        """Return the model as in the body of a request."""
        return {
            "elastic": self.elastic,
            "relaxation": self.relaxation,
            "effects": self.effects,
            "values": self.values,
        }


@dataclass
class BenchPad:
    """Pad of a session: facts (units, noise, tests) and the history of its models.

    ``sampled`` is the state whose model was sampled last, and ``bands`` are its bands as the page
    receives them.
    """

    facts: dict[str, Any] = field(default_factory=dict)
    history: list[HistoryState] = field(default_factory=list)
    current: int = 0
    sampled: int | None = None
    bands: dict[str, Any] | None = None

    def add(self, how: str, model: dict[str, Any], rmse: float | None, begun: Any) -> HistoryState:
        """Append a new state, which becomes the current one."""
        number = max((state.id for state in self.history), default=-1) + 1
        parent = self.current if self.history else None
        state = HistoryState(number, parent, how, rmse=rmse, begun=begun or {}, **model)
        self.history.append(state)
        self.current = number
        return state

    def state(self, number: int) -> HistoryState:
        """Return the state of that number; raise RefusedError where there is none."""
        for state in self.history:
            if state.id == number:
                return state
        raise refused(404, f"no state {number}", "ask for the session's state")


@dataclass
class Session:
    """Session of a user: the measurements, and for each pad the models that were tried.

    ``stage``, ``error``, ``questions`` and ``guess`` are those of the page; ``data`` is the
    tidy file, ``seed`` that of a pad simulated for the session, and ``answers`` are those so far.
    ``made`` holds ``files`` and ``options`` of ``convert`` where the tidy file was made of files of
    testing machines.
    """

    id: str
    folder: Path
    private: Path
    name: str
    stage: str = "reading"
    error: ErrorContent | None = None
    questions: dict[str, Any] | None = None
    notices: list[str] = field(default_factory=list)
    pads: list[str] = field(default_factory=list)
    data: str = ""
    guess: dict[str, Any] | None = None
    bench: dict[str, BenchPad] = field(default_factory=dict)
    seed: int | None = None
    uploads: list[str] = field(default_factory=list)
    answers: dict[str, str] = field(default_factory=dict)
    made: dict[str, Any] | None = None

    @property
    def is_hiding(self) -> bool:
        """True if a guess is missing, so that what is hidden must not be shown."""
        return self.guess is not None and self.guess["given"] is None

    @property
    def truth(self) -> Path:
        """Return the file that holds what was hidden, if anything was."""
        return self.private / "truth.json"

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
        return {
            "id": self.id,
            "name": self.name,
            "stage": self.stage,
            "error": self.error,
            "questions": self.questions,
            "pads": self.pads,
            "notices": self.notices,
            "guess": self.guess,
            "pad": {name: self._pad(name, own) for name, own in self.bench.items()},
        }

    def _pad(self, name: str, own: BenchPad) -> dict[str, Any]:
        diagnosis = None if self.is_hiding else self._diagnosis(name)
        return {
            **own.facts,
            "current": own.current,
            "history": [entry(state) for state in own.history],
            "ranking": None if diagnosis is None else ranking(diagnosis),
            "diagnosis": diagnosis,
            "bands": own.bands,
        }

    def _diagnosis(self, pad: str) -> dict[str, Any] | None:
        """Return what a diagnosis left in the pad's folder, if there was one."""
        file = self.folder / pad / "diagnosis.json"
        try:
            diagnosis: dict[str, Any] = json.loads(file.read_text())
            text = file.with_suffix(".txt").read_text()
        except (OSError, ValueError):
            return None
        return diagnosis | {"text": [one for one in text.split("\n\n") if one.strip()]}

    def save(self) -> None:
        """Write ``bench.json``."""
        pads = {
            name: {
                "current": own.current,
                "sampled": own.sampled,
                "facts": own.facts,
                "history": [asdict(state) for state in own.history],
            }
            for name, own in self.bench.items()
        }
        content = {"schema": 1, "name": self.name, "data": Path(self.data).name}
        content |= {"notices": self.notices, "guess": self.guess, "pads": pads}
        content["made"] = self.made
        self.folder.mkdir(parents=True, exist_ok=True)
        write_json(self.folder / BENCH, content)

    def load(self) -> None:
        """Read ``bench.json``; do nothing where there is none, or it is invalid."""
        try:
            content = json.loads((self.folder / BENCH).read_text())
            pads = {
                name: BenchPad(
                    own["facts"],
                    [HistoryState(**state) for state in own["history"]],
                    own["current"],
                    own["sampled"],
                )
                for name, own in content["pads"].items()
            }
            self.name, self.guess = str(content["name"]), content["guess"]
            self.notices, name = list(content["notices"]), str(content["data"])
            self.made = _made(content.get("made"))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return
        self.bench = pads
        if name and "/" not in name and "\\" not in name and (self.folder / name).is_file():
            self.data = str(self.folder / name)


def _made(stored: Any) -> dict[str, Any] | None:
    """Return files and options of ``convert`` as stored, of a session that may be a stranger's."""
    if stored is None:
        return None
    options = {str(name): str(value) for name, value in stored["options"].items()}
    if not CONVERT_OPTIONS.issuperset(options):
        raise ValueError(options)
    return {"files": [str(name) for name in stored["files"]], "options": options}


def entry(state: HistoryState) -> dict[str, Any]:
    """Return a state as in the history."""
    fields = asdict(state)
    del fields["begun"]
    return fields


def ranking(diagnosis: dict[str, Any]) -> list[dict[str, Any]]:
    """Return effects with their probabilities of being in the model, from a diagnosis."""
    return [
        {"effect": ranked["effect"], "probability": ranked.get("inclusion"), "heldout": None}
        for ranked in diagnosis.get("ranking", [])
    ]


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
            if not _is_id(number) or not (folder / BENCH).is_file():
                raise refused(404, "there is no such session", "open the measurements again")
            session = Session(number, folder, self._root / _PRIVATE / number, number, "closed")
            session.load()
            self._open[number] = session
        return self._open[number]

    @property
    def opening(self) -> bool:
        """Return whether a page waits for its first curves."""
        return any(one.stage in ("reading", "preparing") for one in self._open.values())

    def known(self) -> list[dict[str, str]]:
        """Return all stored sessions, the last first."""
        entries = []
        for file in sorted(self._root.glob(f"*/{BENCH}"), key=_changed, reverse=True):
            try:
                name = str(json.loads(file.read_text())["name"])
            except (OSError, ValueError, KeyError, TypeError):
                continue
            when = datetime.datetime.fromtimestamp(_changed(file), datetime.UTC)
            text = when.isoformat(timespec="seconds").replace("+00:00", "Z")
            entries.append({"id": file.parent.name, "name": name, "changed": text})
        return entries

    def forget(self, session: Session) -> None:
        """Remove a session, and its folder where that is the server's own."""
        self._open.pop(session.id, None)
        shutil.rmtree(session.private, ignore_errors=True)
        if session.folder.parent == self._root:
            shutil.rmtree(session.folder, ignore_errors=True)


def _is_id(text: str) -> bool:
    return bool(text) and all(c.isalnum() or c in "-_" for c in text) and text.isascii()


def _changed(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0
