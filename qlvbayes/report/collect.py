"""What lies in a folder of results, complete or not."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from qlvbayes.checks import InputError
from qlvbayes.report.draws import summary_of_draws

_MARKS = ("posterior.nc", "summary.json", "check.json", "diagnosis.json")


@dataclass(frozen=True)
class Model:
    """One fit: its constants, its check, its curves, and how it was made; None where not done.

    facts: the attributes of ``posterior.nc``.
    """

    folder: Path
    summary: dict | None
    check: dict | None
    curves: dict | None
    facts: dict

    @property
    def effects(self) -> list[str]:
        """In the model."""
        known = self.summary or self.check or {}
        return list(known.get("effects", []))


@dataclass(frozen=True)
class PadResults:
    """One pad: its last model, the plain one if it was kept, and the verdict with its words."""

    name: str
    folder: Path
    final: Model
    plain: Model | None
    diagnosis: dict | None
    words: tuple[str, ...]

    @property
    def force_unit(self) -> str:
        """Of the measured force."""
        return str(self.final.facts.get("force_unit", "N"))

    @property
    def speed_unit(self) -> str:
        """Of the loading rate."""
        displacement = str(self.final.facts.get("displacement_unit", "mm"))
        return "1/s" if displacement == "1" else f"{displacement}/s"

    @property
    def fluid(self) -> str | None:
        """What the pad is filled with, where the measurements say it."""
        return self.final.facts.get("fluid") or None


@dataclass(frozen=True)
class Compared:
    """Two pads or two fluids beside each other: the numbers and the answer in words."""

    folder: Path
    content: dict
    words: tuple[str, ...]


@dataclass(frozen=True)
class Results:
    """All that lies in ``out``; ``runs`` says by which commands it was made."""

    out: Path
    pads: tuple[PadResults, ...]
    comparisons: tuple[Compared, ...]
    runs: dict


def collect(out: Path) -> Results:
    """Read a folder of results; InputError where there is none or a file of it is damaged."""
    folders = [path for path in sorted(out.glob("*")) if any((path / m).exists() for m in _MARKS)]
    if not folders:
        raise InputError(
            "no results in this folder",
            file=out,
            remedy=f"run qlvbayes study FILE -o {out} first",
        )
    compared = [_compared(path.parent) for path in sorted(out.glob("compare/*/compare.json"))]
    runs = (_json(out / "run.json") or {}).get("runs", {})
    return Results(out, tuple(_pad(folder) for folder in folders), tuple(compared), runs)


def _pad(folder: Path) -> PadResults:
    final = _model(folder)
    plain = folder / "plain"
    diagnosis = _json(folder / "diagnosis.json")
    named = [part["pad"] for part in (final.summary, final.check, diagnosis) if part]
    return PadResults(
        str(named[0] if named else final.facts.get("pad", folder.name)),
        folder,
        final,
        _model(plain) if plain.is_dir() else None,
        diagnosis,
        _paragraphs(folder / "diagnosis.txt"),
    )


def _model(folder: Path) -> Model:
    draws, summary = folder / "posterior.nc", _json(folder / "summary.json")
    facts = _facts(draws)
    if summary is None and draws.exists():
        summary, told = summary_of_draws(draws)
        facts = told | facts
    return Model(
        folder, summary, _json(folder / "check.json"), _json(folder / "curves.json"), facts
    )


def _compared(folder: Path) -> Compared:
    content = _json(folder / "compare.json") or {}
    return Compared(folder, content, _paragraphs(folder / "compare.txt"))


def _json(path: Path) -> dict | None:
    """An object in a JSON file; None where there is no file."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise _damaged(path) from error
    if not isinstance(content, dict):
        raise _damaged(path)
    return content


def _paragraphs(path: Path) -> tuple[str, ...]:
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return ()
    except ValueError as error:
        raise _damaged(path) from error
    parts = [" ".join(part.split()) for part in text.split("\n\n")]
    return tuple(part for part in parts if part)


def _facts(path: Path) -> dict:
    """Attributes of a results file, as plain Python."""
    if not path.exists():
        return {}
    try:
        with h5py.File(path) as file:
            return {name: _plain(value) for name, value in file.attrs.items()}
    except OSError as error:
        raise _damaged(path) from error


def _plain(value: object) -> object:
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, h5py.Empty):
        return ""
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.size == 1):
        return value.item()
    return value


def _damaged(path: Path) -> InputError:
    return InputError(
        "cannot be read as results of qlvbayes", file=path, remedy="run the command again"
    )
