"""All steps of a study, from its measurements to the report."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
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
from qlvbayes.pipeline.checking import check_into, tell_check
from qlvbayes.pipeline.comparing import compare_few
from qlvbayes.pipeline.diagnosing import DiagnoseStep
from qlvbayes.pipeline.drawing import (
    Known,
    draw_constants,
    draw_forces_at_rates,
    references_of,
)
from qlvbayes.pipeline.fitting import fit_into, tell_fit
from qlvbayes.pipeline.looking import look_into
from qlvbayes.pipeline.many import Tally, Work, raise_failed, run_pads, run_step
from qlvbayes.pipeline.source import Source
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.report.page import write_report

ChoicesOf = Callable[[Measurements], Choices]
_METHOD, _EVIDENCE = "emcee", "laplace"


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
    ``<pad>/plain``, the diagnosis and, with the laws and effects that it names, the fit and its
    check in ``<pad>``: to all tests of all pads where something new is named in one, so that
    comparing them is fair; else they are those of the plain model. Comparisons of the pads, or of
    the fluids in them, in ``compare``; constants (PNG, PDF, CSV, LaTeX) and, for two pads or
    more, forces_at_rates of all; ``run.json`` and ``report.html``. What is finished is not done
    again.

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
        Of the sampler.
    thresholds
        Of the diagnosis, its ``tolerance`` among them.
    watcher
        Is told of each step.
    command
        Noted as what repeats the study.
    references
        A CSV file (pad,parameter,value,unit) of values to show beside the constants, by default
        paper_table1.csv beside the measurements, if it is there.
    client
        What works: a ``distributed.Client``, or any executor with ``submit``; by default this
        process, one pad after the other.
    shard
        ``3/200``: only the third of two hundred parts, without what is made of all pads
        (`gather`).

    Raises
    ------
    InputError
        Measurements, choices or references cannot be used.
    FailedError
        Some pads failed, after the others were done; its ``results`` are these.
    """
    source = file
    if not isinstance(source, Source):
        source = Source.of(source, only=pads, shard=Shard.from_text(shard) if shard else None)
    out, watcher, settings = Path(out), watcher or Watcher(), settings or Settings()
    thresholds = thresholds or DiagnosisSettings()
    known = references_of(source.place, None if references is None else Path(references))
    chosen = _chosen(choices)
    if source.read is not None and source.shard.count == 1:
        _look(source, out, chosen(source.whole), watcher)
    engine = engine_of(client)
    sampler, judging = settings, thresholds  # for the step, whose names mypy follows no further
    plain = run_step(
        out,
        source,
        lambda study: PlainStep(chosen(study), sampler, judging),
        engine=engine,
        watcher=watcher,
    )
    if not plain.pads:
        raise_failed([plain])
        return []
    call = command or f"qlvbayes.run_study({Path(source.whole.source).name!r}, {out.name!r}, ...)"
    told = {"sampler": settings, "thresholds": thresholds}
    base = chosen(source.whole)
    record_run(out, "study", call, source.whole, base, settings.seed, told)
    names = plain.pads if source.shard.count == 1 else _diagnosed_in(out)
    final = run_finals(
        out,
        _others(source, plain),
        chosen,
        settings,
        new=any_new(out, names, base),
        size=len(plain.pads),
        engine=engine,
        watcher=watcher,
    )
    if source.shard.count == 1:
        finish(out, final.pads, known, settings.seed, watcher, engine)
    verdicts = [verdict(out, name) for name in plain.pads]
    raise_failed([plain, final], verdicts)
    return verdicts


def finish(
    out: Path,
    pads: Sequence[str],
    references: Known | None,
    seed: int,
    watcher: Watcher,
    engine: Engine | None = None,
) -> None:
    """Write what concerns all pads: constants, forces, comparisons, report."""
    with watcher.doing("figures of all pads"):
        draw_constants(out, references)
        draw_forces_at_rates(out)
    compare_few(out, pads, seed, watcher)
    with watcher.doing("report"):
        write_report(out, engine=engine)


def _look(source: Source, out: Path, choices: Choices, watcher: Watcher) -> None:
    """Look at the tests of one file, before anything is fitted."""
    wanted = [study.pads[0] for study in source if isinstance(study, Measurements)]
    with watcher.doing("looking"):
        look, figures = look_into(
            out, source.whole, wanted, bonded=choices.bonded, effects=choices.effects,
            keep_all_readings=choices.keep_all_readings,
        )  # fmt: skip
    watcher.looked(look, figures)


def verdict(out: Path, pad: str) -> DiagnosisResult:
    """Return the verdict on a pad, as its file has it."""
    return DiagnosisResult.read(out / pad / "diagnosis.json")


def any_new(out: Path, pads: Iterable[str], choices: Choices) -> bool:
    """Return whether the verdict on some pad names what the model did not have."""
    return any(fuller(choices, verdict(out, pad)) != choices for pad in pads)


def fuller(choices: Choices, found: DiagnosisResult) -> Choices:
    """Return the choices with the laws and effects that a verdict names."""
    new = (found.forms.get(name, name) for name in found.effects if name not in choices.effects)
    return replace(_on_laws(choices, found), effects=(*choices.effects, *new))


def _chosen(choices: Choices | ChoicesOf | None) -> ChoicesOf:
    if isinstance(choices, Choices):
        fixed = choices
        return lambda study: fixed
    return choices or (lambda study: Choices(bonded=study.units.bonded_default))


def _diagnosed_in(out: Path) -> list[str]:
    return [file.parent.name for file in sorted(out.glob("*/diagnosis.json"))]


def _others(source: Source, done: Tally) -> Iterator[Measurements | Fault]:
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
    chosen: ChoicesOf,
    settings: Settings,
    *,
    new: bool,
    size: int,
    engine: Engine | None,
    watcher: Watcher,
) -> Tally:
    """Fit what the verdicts name to the same tests of every pad, so that comparing is fair.

    new: whether any of them names something; else the plain fits are taken over.
    """
    if not new:
        names = [study.pads[0].name for study in studies if isinstance(study, Measurements)]
        for name in names:
            _take_over(out / name)
        return Tally(tuple(names), ())
    work = (
        study if isinstance(study, Fault) else _final_work(out, study, chosen, settings)
        for study in studies
    )
    return run_pads(out, work, size=size, engine=engine, watcher=watcher)


def _final_work(out: Path, study: Measurements, chosen: ChoicesOf, settings: Settings) -> Work:
    name = study.pads[0].name
    step = FinalStep(fuller(chosen(study), verdict(out, name)), settings)
    return Work(step, study, out / name)


def _take_over(folder: Path) -> None:
    """Copy the baseline fit and its check to the pad's folder."""
    for file in filter(Path.is_file, (folder / "plain").iterdir()):
        write_whole(folder / file.name, file.read_bytes())


@dataclass(frozen=True)
class PlainStep:
    """The plain model's fit and check of a pad, and the diagnosis."""

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

    def tell(self, folder: Path, watcher: Watcher) -> None:
        """Report what the steps left."""
        _tell_fit(folder / "plain", watcher)
        self._diagnosis.tell(folder, watcher)

    @property
    def _diagnosis(self) -> DiagnoseStep:
        return DiagnoseStep(self.choices, _EVIDENCE, self.settings.seed, self.thresholds)


@dataclass(frozen=True)
class FinalStep:
    """The fit of a pad to all its tests, with what the verdict names, and its check."""

    name: ClassVar[str] = "final"
    reads: ClassVar[tuple[str, ...]] = ()

    choices: Choices
    settings: Settings

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Fit the pad and check the fit."""
        _fit_and_check(folder, study, self.choices, self.settings, watcher, all_tests=True)

    def tell(self, folder: Path, watcher: Watcher) -> None:
        """Report what the steps left."""
        _tell_fit(folder, watcher)


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


def _tell_fit(folder: Path, watcher: Watcher) -> None:
    tell_fit(folder, watcher)
    tell_check(folder, watcher)


def _on_laws(choices: Choices, found: DiagnosisResult) -> Choices:
    """Return choices with the verdict's base laws, if any; a Prony series keeps its modes.

    What the user said of the constants of a law goes with it.
    """
    if found.verdict == "unexplained":
        return choices
    elastic, relaxation = found.base.elastic, found.base.relaxation.partition(":")[0]
    gone: set[str] = set()
    if elastic != choices.law:
        gone.update(find_elastic(choices.law, choices.laws).units)
    if relaxation != choices.relaxation:
        gone.update(find_relaxation(choices.relaxation, choices.laws).units)

    def kept(settings: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(text for text in settings if _constant(text) not in gone)

    priors, fixed = kept(choices.priors), kept(choices.fixed)
    return replace(choices, law=elastic, relaxation=relaxation, priors=priors, fixed=fixed)


def _constant(setting: str) -> str:
    """Return the constant's name in ``v[2]=0.14``, without its number."""
    return setting.partition("=")[0].partition("[")[0].strip()
