"""Run all steps of a study, from its measurements to the report."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.results import load
from qlvbayes.fitting.runs import record_run
from qlvbayes.io.data import Measurements
from qlvbayes.io.files import write_whole
from qlvbayes.laws.catalogue import find_elastic, find_relaxation
from qlvbayes.model.choices import Choices
from qlvbayes.parallel.engines import Engine, engine_of
from qlvbayes.parallel.faults import Fault
from qlvbayes.parallel.shards import Shard
from qlvbayes.pipeline.checking import check_into, report_saved_check
from qlvbayes.pipeline.comparing import compare_few
from qlvbayes.pipeline.diagnosing import DiagnoseStep
from qlvbayes.pipeline.drawing import (
    ReferenceFile,
    draw_constants,
    draw_forces_at_rates,
    find_references,
)
from qlvbayes.pipeline.fitting import fit_into, report_saved_fit
from qlvbayes.pipeline.looking import look_into
from qlvbayes.pipeline.many import Tally, Work, map_pads, raise_failed, run_pads, run_step
from qlvbayes.pipeline.source import Source
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.report.page import write_report

ChoicesOf = Callable[[Measurements], Choices]
_METHOD = "emcee"


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

    Leaves in ``out``: the first look at the tests of a single file, before anything is fitted
    (``look.json``, ``look_<pad>.png``); per pad the plain model's fit and check in
    ``<pad>/plain``; in ``<pad>`` the diagnosis and the final fit with its check. Where the
    diagnosis of any pad names a law or an effect, the final model has what is named and is fitted
    to all tests of every pad, so that pads are compared alike; else it is the plain model.
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
    part = Shard.from_text(shard) if shard else None
    source = file if isinstance(file, Source) else Source.from_files(file, only=pads, shard=part)
    study = _StudyRun(
        source, Path(out), _choices_function(choices), settings or Settings(),
        thresholds or DiagnosisSettings(), watcher or Watcher(), engine_of(client),
    )  # fmt: skip
    given = None if references is None else Path(references)
    reference_file = find_references(source.location, given)
    if source.read is not None and study.whole:
        study.look()
    baseline = study.baselines()
    if not baseline.pads:
        raise_failed([baseline])
        return []
    final = study.finals(baseline, command)
    if study.whole:
        seed = study.settings.seed
        finish(study.out, final.pads, reference_file, seed, study.watcher, study.engine)
    verdicts = [verdict(study.out, name) for name in baseline.pads]
    raise_failed([baseline, final], verdicts)
    return verdicts


@dataclass(frozen=True, eq=False)
class _StudyRun:
    """The steps of a study, from the same pads with the same settings into the same folder."""

    source: Source
    out: Path
    choices_of: ChoicesOf
    settings: Settings
    thresholds: DiagnosisSettings
    watcher: Watcher
    engine: Engine | None

    @property
    def whole(self) -> bool:
        """True if this run has all pads of the study, and not one of several shards."""
        return self.source.shard.count == 1

    def look(self) -> None:
        """Look at the tests of one file, before anything is fitted."""
        source, choices = self.source, self.choices_of(self.source.whole)
        pads = [study.pads[0] for study in source if isinstance(study, Measurements)]
        with self.watcher.doing("looking"):
            look, figures = look_into(
                self.out, source.whole, pads, bonded=choices.bonded, effects=choices.effects,
                keep_all_readings=choices.keep_all_readings, use=choices.use,
                leave_out=choices.leave_out, apply=partial(map_pads, self.engine),
            )  # fmt: skip
        self.watcher.looked(look, figures)

    def baselines(self) -> Tally:
        """Fit, check and diagnose the plain model of every pad."""
        return run_step(
            self.out,
            self.source,
            lambda study: BaselineStep(self.choices_of(study), self.settings, self.thresholds),
            engine=self.engine,
            watcher=self.watcher,
        )

    def finals(self, baseline: Tally, command: str) -> Tally:
        """Record the run, and fit the final model of every pad that has its baseline."""
        study, out = self.source.whole, self.out
        call = command or f"qlvbayes.run_study({Path(study.source).name!r}, {out.name!r}, ...)"
        used = {"sampler": self.settings, "thresholds": self.thresholds}
        base = self.choices_of(study)
        record_run(out, "study", call, study, base, self.settings.seed, used)
        names = baseline.pads if self.whole else _diagnosed_in(out)
        return run_finals(
            out,
            _done_pads(self.source, baseline),
            self.choices_of,
            self.settings,
            named=anything_named(out, names, base),
            size=len(baseline.pads),
            engine=self.engine,
            watcher=self.watcher,
        )


def finish(
    out: Path,
    pads: Sequence[str],
    references: ReferenceFile | None,
    seed: int,
    watcher: Watcher,
    engine: Engine | None = None,
) -> None:
    """Write what concerns all pads: constants, forces, comparisons and report."""
    with watcher.doing("figures of all pads"):
        draw_constants(out, references)
        draw_forces_at_rates(out)
    compare_few(out, pads, seed, watcher)
    with watcher.doing("report"):
        write_report(out, engine=engine)


def verdict(out: Path, pad: str) -> DiagnosisResult:
    """Return the saved verdict on a pad."""
    return DiagnosisResult.read(out / pad / "diagnosis.json")


def anything_named(out: Path, pads: Iterable[str], choices: Choices) -> bool:
    """Return whether the verdict on some pad names what the model did not have."""
    return any(with_verdict(choices, verdict(out, pad)) != choices for pad in pads)


def with_verdict(choices: Choices, result: DiagnosisResult) -> Choices:
    """Return the choices with the laws and effects that a verdict names."""
    new = (result.forms.get(name, name) for name in result.effects if name not in choices.effects)
    return replace(_on_laws(choices, result), effects=(*choices.effects, *new))


def _choices_function(choices: Choices | ChoicesOf | None) -> ChoicesOf:
    if isinstance(choices, Choices):
        fixed = choices
        return lambda study: fixed
    return choices or (lambda study: Choices(bonded=study.units.bonded_default))


def _diagnosed_in(out: Path) -> list[str]:
    return [file.parent.name for file in sorted(out.glob("*/diagnosis.json"))]


def _done_pads(source: Source, done: Tally) -> Iterator[Measurements | Fault]:
    """Yield the pads that are done, once more; faults were reported before."""
    pads, failed = set(done.pads), {fault.of for fault in done.faults}
    for one in source:
        if isinstance(one, Fault):
            if one.of not in failed:
                yield one
        elif one.pads[0].name in pads:
            yield one


def run_finals(
    out: Path,
    studies: Iterable[Measurements | Fault],
    choices_of: ChoicesOf,
    settings: Settings,
    *,
    named: bool,
    size: int,
    engine: Engine | None,
    watcher: Watcher,
) -> Tally:
    """Fit every pad, with what its verdict names, to all its tests, so that pads compare alike."""
    if not named:
        names = [study.pads[0].name for study in studies if isinstance(study, Measurements)]
        for name in names:
            _copy_baseline(out / name)
        return Tally(tuple(names), ())
    work = (
        study if isinstance(study, Fault) else _final_work(out, study, choices_of, settings)
        for study in studies
    )
    return run_pads(out, work, size=size, engine=engine, watcher=watcher)


def _final_work(out: Path, study: Measurements, choices_of: ChoicesOf, settings: Settings) -> Work:
    name = study.pads[0].name
    step = FinalStep(with_verdict(choices_of(study), verdict(out, name)), settings)
    return Work(step, study, out / name)


def _copy_baseline(folder: Path) -> None:
    """Copy the baseline fit and its check to the pad's folder."""
    for file in filter(Path.is_file, (folder / "plain").iterdir()):
        write_whole(folder / file.name, file.read_bytes())


@dataclass(frozen=True)
class BaselineStep:
    """Step that fits, checks and diagnoses the baseline model of a pad."""

    name: ClassVar[str] = "plain"
    reads: ClassVar[tuple[str, ...]] = ()

    choices: Choices
    settings: Settings
    thresholds: DiagnosisSettings

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Fit and check the baseline model in ``plain``, and diagnose the pad."""
        _fit_and_check(
            folder / "plain", study, self.choices, self.settings, watcher, all_tests=False
        )
        self._diagnosis.run(folder, study, watcher)

    def report_saved(self, folder: Path, watcher: Watcher) -> None:
        """Report the saved results."""
        _report_saved_fit_and_check(folder / "plain", watcher)
        self._diagnosis.report_saved(folder, watcher)

    @property
    def _diagnosis(self) -> DiagnoseStep:
        return DiagnoseStep(self.choices, self.settings.seed, self.thresholds)


@dataclass(frozen=True)
class FinalStep:
    """Step that fits a pad, with what the verdict names, to all its tests and checks the fit."""

    name: ClassVar[str] = "final"
    reads: ClassVar[tuple[str, ...]] = ()

    choices: Choices
    settings: Settings

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Fit the pad and check the fit."""
        _fit_and_check(folder, study, self.choices, self.settings, watcher, all_tests=True)

    def report_saved(self, folder: Path, watcher: Watcher) -> None:
        """Report the saved results."""
        _report_saved_fit_and_check(folder, watcher)


def _fit_and_check(
    folder: Path,
    study: Measurements,
    choices: Choices,
    settings: Settings,
    watcher: Watcher,
    *,
    all_tests: bool,
) -> None:
    fit_into(
        folder,
        study.pads[0],
        study,
        choices,
        method=_METHOD,
        all_tests=all_tests,
        settings=settings,
        watcher=watcher,
    )
    check_into(folder, load(folder / "posterior.nc"), study, seed=settings.seed, watcher=watcher)


def _report_saved_fit_and_check(folder: Path, watcher: Watcher) -> None:
    report_saved_fit(folder, watcher)
    report_saved_check(folder, watcher)


def _on_laws(choices: Choices, result: DiagnosisResult) -> Choices:
    """Return choices with the verdict's base laws, if any; a Prony series keeps its modes."""
    if result.verdict == "unexplained":
        return choices
    elastic, relaxation = result.base.elastic, result.base.relaxation.partition(":")[0]
    replaced: set[str] = set()
    if elastic != choices.law:
        replaced.update(find_elastic(choices.law, choices.laws).units)
    if relaxation != choices.relaxation:
        replaced.update(find_relaxation(choices.relaxation, choices.laws).units)

    def remaining(settings: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(text for text in settings if _constant(text) not in replaced)

    priors, fixed = remaining(choices.priors), remaining(choices.fixed)
    return replace(choices, law=elastic, relaxation=relaxation, priors=priors, fixed=fixed)


def _constant(setting: str) -> str:
    """Return the constant's name in ``v[2]=0.14``, without its number."""
    return setting.partition("=")[0].partition("[")[0].strip()
