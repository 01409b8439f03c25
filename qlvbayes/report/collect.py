"""Read a folder of results, complete or not."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import h5py
import numpy as np

from qlvbayes.comparison.contrast import Comparison
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.fitting.ensemble import diagnose_chain
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.results import Run, RunLog, load
from qlvbayes.fitting.summary import Constant, FitSummary, constant_of, lasting_of, pulled
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import Result
from qlvbayes.io.wording import as_typed, pad_title
from qlvbayes.model.drawn import described_fields
from qlvbayes.report.errors import ErrorTable

Kind = TypeVar("Kind", bound=Result)

MARKS = ("posterior.nc", "summary.json", "check.json", "diagnosis.json")


@dataclass(frozen=True)
class FitResults:
    """Results of one fit: constants, check, and how it was made; None where not done."""

    folder: Path
    summary: FitSummary | None
    check: CheckResult | None
    facts: dict  # the attributes of ``posterior.nc``

    @property
    def effects(self) -> list[str]:
        """Names of the effects in the model."""
        known = self.summary or self.check
        return list(known.effects) if known else []


@dataclass(frozen=True)
class PadResults:
    """Results of one pad: its last model, the baseline if it was kept, and the verdict in words."""

    name: str
    folder: Path
    final: FitResults
    baseline: FitResults | None
    diagnosis: DiagnosisResult | None
    words: tuple[str, ...]

    @property
    def title(self) -> str:
        """'pad B', or 'the pad' where the file does not name it."""
        return pad_title(self.name)

    @property
    def parameters(self) -> dict[str, Constant]:
        """Constants of the last model; none where it was not fitted."""
        return self.final.summary.parameters if self.final.summary else {}

    @property
    def pulled(self) -> tuple[str, ...]:
        """Sentences on the constants of the last model that lie far out of their priors."""
        priors = json.loads(self.final.facts.get("priors", "{}"))
        return pulled(self.final.summary, priors) if self.final.summary else ()

    @property
    def notices(self) -> list[str]:
        """Return what one should know of the tests, each once, whichever step says it."""
        parts = (self.final.summary, self.final.check, self.diagnosis)
        return list(dict.fromkeys(text for part in parts if part for text in part.notices))

    @property
    def noise(self) -> float | None:
        """The noise floor, which check and diagnosis measure alike."""
        measured = self.final.check or self.diagnosis
        return measured.noise if measured else None

    @property
    def errors(self) -> list[ErrorTable]:
        """Errors of the last model, after those of the baseline where effects were added."""
        final, plain = self.final, self.baseline
        checks = [final.check]
        if plain is not None and plain.effects != final.effects:
            checks.insert(0, plain.check)
        return [ErrorTable(one) for one in checks if final.check and one]

    @property
    def force_unit(self) -> str:
        """Unit of the measured force."""
        measured = self.diagnosis.units.force if self.diagnosis else "N"
        return str(self.final.facts.get("force_unit", measured))

    @property
    def speed_unit(self) -> str:
        """Unit of the loading rate."""
        measured = self.diagnosis.units.displacement if self.diagnosis else "mm"
        displacement = str(self.final.facts.get("displacement_unit", measured))
        return "1/s" if displacement == "1" else f"{displacement}/s"

    @property
    def fluid(self) -> str | None:
        """Fluid in the pad, where the measurements name it."""
        return self.final.facts.get("fluid") or None


@dataclass(frozen=True)
class Compared:
    """The comparison of two pads or fluids, and its answer in words."""

    folder: Path
    comparison: Comparison
    words: tuple[str, ...]


@dataclass(frozen=True)
class Results:
    """All results that lie in ``out``; ``runs`` are the commands that made them, by step."""

    out: Path
    pads: tuple[PadResults, ...]
    comparisons: tuple[Compared, ...]
    runs: dict[str, Run]

    @property
    def typed(self) -> str:
        """The folder as a command names it: the path of a machine is not shown."""
        return (self.out.name if self.out.is_absolute() else self.out.as_posix()) or "OUT"


def collect(out: Path) -> Results:
    """Read a folder of results; InputError where there is none or a file of it is damaged."""
    folders = pad_folders(out)
    compared = tuple(
        Compared(file.parent, Comparison.read(file), _paragraphs(file.with_suffix(".txt")))
        for file in sorted(out.glob("compare/*/compare.json"))
    )
    return Results(out, tuple(map(pad_in, folders)), compared, runs_in(out))


def pad_folders(out: Path) -> list[Path]:
    """Return the folders of all pads; raise InputError where there are none."""
    folders = [path for path in sorted(out.glob("*")) if any((path / m).exists() for m in MARKS)]
    if not folders:
        remedy = f"run {as_typed('qlvbayes', 'study', 'FILE', '-o', str(out))} first"
        raise InputError("no results in this folder", file=out, remedy=remedy)
    return folders


def runs_in(out: Path) -> dict[str, Run]:
    """Return the runs that made a folder, by step; empty where it does not say."""
    noted = read_if_there(RunLog, out / "run.json")
    return noted.runs if noted else {}


def pad_in(folder: Path) -> PadResults:
    """Return one pad, as far as it is there."""
    final, plain = _model(folder), folder / "plain"
    baseline = _model(plain) if plain.is_dir() else None
    diagnosis = read_if_there(DiagnosisResult, folder / "diagnosis.json")
    named = [part.pad for part in (final.summary, final.check, diagnosis) if part]
    name = str(named[0] if named else final.facts.get("pad", folder.name))
    words = _paragraphs(folder / "diagnosis.txt")
    return PadResults(name, folder, final, baseline, diagnosis, words)


def _model(folder: Path) -> FitResults:
    draws, summary = folder / "posterior.nc", read_if_there(FitSummary, folder / "summary.json")
    facts = facts_of(draws)
    if summary is None and draws.exists():
        summary, described = summary_of_draws(draws)
        facts = described | facts
    return FitResults(folder, summary, read_if_there(CheckResult, folder / "check.json"), facts)


def read_if_there(kind: type[Kind], path: Path) -> Kind | None:
    """Return a result in a file; None where there is no file."""
    return kind.read(path) if path.exists() else None


def _paragraphs(path: Path) -> tuple[str, ...]:
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return ()
    except ValueError as error:
        raise _damaged(path) from error
    parts = [" ".join(part.split()) for part in text.split("\n\n")]
    return tuple(part for part in parts if part)


def facts_of(path: Path) -> dict:
    """Return the attributes of a results file, as Python's own types."""
    if not path.exists():
        return {}
    try:
        with h5py.File(path) as file:
            return {name: _as_python(value) for name, value in file.attrs.items()}
    except OSError as error:
        raise _damaged(path) from error


def _as_python(value: object) -> object:
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, h5py.Empty):
        return ""
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.size == 1):
        return value.item()
    return value


def _damaged(path: Path) -> InputError:
    what = "cannot be read as results of qlvbayes"
    return InputError(what, file=path, remedy="run the command again")


def summary_of_draws(path: Path) -> tuple[FitSummary, dict]:
    """Return what ``summary.json`` would say, with units and choices from the attributes."""
    saved = load(path)
    kinds = {name: f.unit for f in described_fields(saved.choices) for name in f.names}
    judged = diagnose_chain(saved.constants)
    troubles = tuple(judged.troubles)
    parameters = {
        name: constant_of(saved.constants[..., k], saved.units.of(kinds[name]), k, judged)
        for k, name in enumerate(saved.names)
    }
    summary = FitSummary(
        pad=saved.pad, units=saved.units, effects=saved.choices.effects, sampler=saved.method,
        converged=not troubles, troubles=troubles, parameters=parameters,
        never_relaxes=lasting_of(saved.choices, saved.names, saved.constants),
    )  # fmt: skip
    facts = {
        "displacement_unit": saved.units.displacement,
        "force_unit": saved.units.force,
        "choices": json.dumps(saved.choices.as_dict()),
    }
    return summary, facts
