"""Run all steps of a study, from its measurements to the report.

After its verdict comes the last fit of each pad, and then what is made of all pads together.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.results import load, record_run
from qlvbayes.fitting.summary import read_references
from qlvbayes.io.data import Measurements
from qlvbayes.io.files import write_whole
from qlvbayes.laws.catalogue import find_elastic, find_relaxation
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.parallel.engines import Engine, engine_of
from qlvbayes.parallel.running import Fault, Shard, fault_of
from qlvbayes.pipeline import derived
from qlvbayes.pipeline.many import Tally, map_pads, run_pads
from qlvbayes.pipeline.source import Source, pad_of, read_again
from qlvbayes.pipeline.steps import (
    PLAIN,
    CheckStep,
    DiagnoseStep,
    FitStep,
    Step,
    Watcher,
    faults_in,
    files_of_fit,
)
from qlvbayes.report.collect import runs_in
from qlvbayes.report.firstlook.looking import look_into
from qlvbayes.report.page import MOST_ON_A_PAGE, write_report

ChoicesOf = Callable[[Measurements], Choices]


def run_study(
    file: str | Path | Measurements | Source | Sequence[str | Path],
    out: str | Path,
    *,
    pads: Sequence[str] = (),
    choices: Choices | ChoicesOf | None = None,
    settings: Settings | None = None,
    thresholds: DiagnosisSettings | None = None,
    watcher: Watcher | None = None,
    command: str = "",
    references: str | Path | None = None,
    client: Any = None,
    shard: str | None = None,
) -> list[DiagnosisResult]:
    """Do everything for the named pads (all by default); return their verdicts.

    Leaves in ``out``: the first look at the tests, before anything is fitted, unless there are
    several tidy files (``look.json``, ``look_<pad>.png``); per pad the plain model's fit and check
    in ``<pad>/plain``; in ``<pad>`` the diagnosis and the final fit, which has what the diagnosis
    names and is fitted to all tests, so that pads are compared alike, with its check. Where nothing
    is named the check is the plain fit's, which predicts the tests that it left out.
    Comparisons of the pads, or of the fluids in them, are in ``compare``; constants (PNG, PDF,
    CSV, LaTeX) and, for two pads or more, forces_at_rates concern all pads; ``run.json`` and
    ``report.html`` cover the whole study. What is finished is not done again.

    Parameters
    ----------
    file
        Measurements, the file of them, several files, a folder, or a `Source` of pads.
    out
        The folder of results.
    pads
        Names of the pads.
    choices
        The model to start from, or a function that gives it for measurements; by default the plain
        one, bonded where the file holds strain and stress.
    settings
        Settings of the sampler.
    thresholds
        Thresholds of the diagnosis, its ``tolerance`` among them.
    watcher
        Receives reports of each step.
    command
        Command that repeats the study, recorded in ``run.json``.
    references
        A CSV file (pad,parameter,value,unit) of values to show with the constants, by default
        paper_table1.csv in the folder of the measurements, if it is there.
    client
        A ``distributed.Client``, or any executor with ``submit``, that does the work; by default
        this process does, one pad after the other.
    shard
        Part of the study that is run: ``3/200`` is the third of two hundred parts, without what
        is made of all pads (`gather`).

    Raises
    ------
    InputError
        Measurements, choices or references cannot be used.
    FailedError
        Some pads failed, after the others were done; its ``results`` are these.
    """
    out, watcher, engine = Path(out), watcher or Watcher(), engine_of(client)
    part = Shard.from_text(shard) if shard else None
    source = file if isinstance(file, Source) else Source.from_files(file, only=pads, shard=part)
    settings, thresholds = settings or Settings(), thresholds or DiagnosisSettings()

    def choices_of(study: Measurements) -> Choices:
        given = choices(study) if callable(choices) else choices
        return given or Choices(bonded=study.units.bonded_default)

    def steps(study: Measurements) -> tuple[Step, ...]:
        chosen = choices_of(study)
        return (
            FitStep(chosen, settings=settings, within=PLAIN),
            CheckStep(settings.seed, within=PLAIN),
            DiagnoseStep(chosen, settings.seed, thresholds),
            FinalStep(chosen, settings),
        )

    given = Path(references) if references else None
    if given:
        read_references(given)  # a file that cannot be used is refused before the work
    place, whole = source.location, source.shard.count == 1
    base = choices_of(source.whole)
    if source.is_complete and whole:
        _look_first(out, source, base, engine, watcher)
    source = source.kept(out)
    done = run_pads(out, source, steps, size=source.size, engine=engine, watcher=watcher)
    if not done.pads:
        done.raise_failed()
        return []
    call = command or f"qlvbayes.run_study({Path(source.whole.source).name!r}, {out.name!r}, ...)"
    used = {"sampler": settings, "thresholds": thresholds}
    record_run(out, "study", call, source.whole, base, settings.seed, used)
    if whole:
        finish(out, done.pads, given, place, settings.seed, watcher, engine)
    verdicts = [DiagnosisResult.read(out / name / "diagnosis.json") for name in done.pads]
    done.raise_failed(verdicts)
    return verdicts


def _look_first(
    out: Path, source: Source, choices: Choices, engine: Engine | None, watcher: Watcher
) -> None:
    """Show what is in the tests, before anything is fitted."""
    pads = [study.pads[0] for study in source if isinstance(study, Measurements)]
    readings = {name: getattr(choices, name) for name in ("keep_all_readings", "use", "leave_out")}
    with watcher.doing("looking"):
        look, figures = look_into(
            out, source.whole, pads, prepared=partial(prepare, **readings),
            bonded=choices.bonded, effects=choices.effects, apply=partial(map_pads, engine),
        )  # fmt: skip
    watcher.looked(look, figures)


@dataclass(frozen=True)
class FinalStep(Step):
    """Step of a pad after its diagnosis: the fit to all its tests, so that pads compare alike.

    Its model is the plain one, and what the verdict names. Where nothing is named, the plain fit is
    the last if it had all tests, and the check stays its own, which predicts tests left out.
    """

    name = "final"
    needs = ("diagnosis.json", *(f"{PLAIN}/{x}" for x in files_of_fit()))
    leaves = (*FitStep.leaves, *CheckStep.leaves)
    code = DiagnoseStep.code

    choices: Choices
    settings: Settings = field(default_factory=Settings)

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Do what is left of the last fit and its check; copy the rest of the plain ones."""
        todo = self._steps(folder)
        for step in todo:
            step.run(folder, study, watcher)
        if len(todo) < 2:
            kept = CheckStep.name if todo else ""
            for name in files_of_fit(kept):
                if (file := folder / PLAIN / name).is_file():
                    write_whole(folder / name, file.read_bytes())

    def report(self, folder: Path, watcher: Watcher) -> None:
        """Report what was not reported of the plain fit."""
        for step in self._steps(folder):
            step.report(folder, watcher)

    def _steps(self, folder: Path) -> tuple[Step, ...]:
        """Return the steps that the verdict requires."""
        choices = with_verdict(self.choices, DiagnosisResult.read(folder / "diagnosis.json"))
        fit = FitStep(choices, all_tests=True, settings=self.settings)
        if choices != self.choices:
            return fit, CheckStep(self.settings.seed)
        cells = CheckResult.read(folder / PLAIN / "check.json").cells
        return (fit,) if any(cell.role == "validate" for cell in cells) else ()


def finish(
    out: Path,
    pads: Sequence[str],
    references: Path | None,
    data: Path,
    seed: int,
    watcher: Watcher,
    engine: Engine | None = None,
) -> None:
    """Write what concerns all pads: constants, forces, comparisons and report."""
    with watcher.doing("figures of all pads"):
        derived.draw_constants(out, references, data)
        derived.draw_forces_at_rates(out)
    if len(pads) > MOST_ON_A_PAGE:
        watcher.notice(derived.not_all_compared(f"{len(pads)} pads"))
    else:
        derived.compare_pairs(out, derived.saved_pads(out, pads), seed, watcher)
    with watcher.doing("report"):
        write_report(out, engine=engine)


def gather(
    out: Path,
    *,
    references: Path | None = None,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
) -> Tally:
    """Write, of parts that were run apart, what an undivided run writes of all its pads."""
    watcher = watcher or Watcher()
    pads = derived.fitted_pads(out)
    seed = max((one.seed for one in runs_in(out).values()), default=0)
    data = Path(load(out / pads[0] / "posterior.nc").source).parent
    finish(out, pads, references, data, seed, watcher, engine)
    return Tally(tuple(pads), tuple(faults_in(out)))


def saved_studies(
    out: Path, pads: Sequence[str], *, data: Path | None = None
) -> Iterator[Measurements | Fault]:
    """Yield the measurements of some pads, read from where their fits say that they are.

    ``data`` is the file or the folder of them, if they have moved since the fits.
    """
    read = lru_cache(1)(read_again)  # the next pad is often in the same file
    for pad in pads:
        try:
            saved = load(out / pad / "posterior.nc")
            yield pad_of(read(saved.source, saved.sha256, data), saved.pad)
        except Exception as error:  # one missing file must not stop the others
            yield replace(fault_of(error), of=f"pad {pad}")


def with_verdict(choices: Choices, result: DiagnosisResult) -> Choices:
    """Return the choices with the laws and effects that a verdict names."""
    new = (result.forms.get(name, name) for name in result.effects if name not in choices.effects)
    return replace(on_laws(choices, result), effects=(*choices.effects, *new))


def on_laws(choices: Choices, result: DiagnosisResult) -> Choices:
    """Return choices with the verdict's base laws, if any; a Prony series keeps its modes.

    Priors and fixed values of constants that a law replaced are left out.
    """
    if result.verdict == "unexplained":
        return choices
    elastic, relaxation = result.base.elastic, result.base.relaxation.partition(":")[0]
    replaced: set[str] = set()
    if elastic != choices.elastic:
        replaced.update(find_elastic(choices.elastic, choices.laws).units)
    if relaxation != choices.relaxation:
        replaced.update(find_relaxation(choices.relaxation, choices.laws).units)

    def remaining(settings: tuple[str, ...]) -> tuple[str, ...]:
        constants = ((text, re.split(r"[=[]", text)[0].strip()) for text in settings)
        return tuple(text for text, constant in constants if constant not in replaced)

    priors, fixed = remaining(choices.priors), remaining(choices.fixed)
    return replace(choices, elastic=elastic, relaxation=relaxation, priors=priors, fixed=fixed)
