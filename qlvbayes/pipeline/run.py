"""Run all steps of a study, from its measurements to the report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.runs import record_run
from qlvbayes.io.data import Measurements
from qlvbayes.model.choices import Choices
from qlvbayes.parallel.engines import engine_of
from qlvbayes.parallel.faults import Fault
from qlvbayes.parallel.running import Shard
from qlvbayes.pipeline.comparing import find_references
from qlvbayes.pipeline.finals import ChoicesOf, finish, run_finals, verdict
from qlvbayes.pipeline.looking import look_into
from qlvbayes.pipeline.many import Tally, map_pads, raise_failed, run_steps
from qlvbayes.pipeline.source import Source
from qlvbayes.pipeline.steps import PLAIN, CheckStep, DiagnoseStep, FitStep, Step
from qlvbayes.pipeline.watcher import Watcher


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

    def choices_of(study: Measurements) -> Choices:
        given = choices(study) if callable(choices) else choices
        return given or Choices(bonded=study.units.bonded_default)

    settings, thresholds = settings or Settings(), thresholds or DiagnosisSettings()
    reference_file = find_references(source.location, Path(references) if references else None)
    whole = source.shard.count == 1
    base = choices_of(source.whole)
    if source.is_complete and whole:
        tests = [study.pads[0] for study in source if isinstance(study, Measurements)]
        with watcher.doing("looking"):
            look, figures = look_into(
                out, source.whole, tests, bonded=base.bonded, effects=base.effects,
                keep_all_readings=base.keep_all_readings, use=base.use, leave_out=base.leave_out,
                apply=partial(map_pads, engine),
            )  # fmt: skip
        watcher.looked(look, figures)
    source = source.kept(out)

    def plain_steps(study: Measurements) -> tuple[Step, ...]:
        chosen = choices_of(study)
        return (
            FitStep(chosen, settings=settings, within=PLAIN),
            CheckStep(settings.seed, within=PLAIN),
            DiagnoseStep(chosen, settings.seed, thresholds),
        )

    baseline = run_steps(out, source, plain_steps, engine=engine, watcher=watcher)
    if not baseline.pads:
        raise_failed([baseline])
        return []
    call = command or f"qlvbayes.run_study({Path(source.whole.source).name!r}, {out.name!r}, ...)"
    used = {"sampler": settings, "thresholds": thresholds}
    record_run(out, "study", call, source.whole, base, settings.seed, used)
    final = run_finals(
        out, _done_pads(source, baseline), choices_of, settings,
        size=len(baseline.pads), engine=engine, watcher=watcher,
    )  # fmt: skip
    if whole:
        finish(out, final.pads, reference_file, settings.seed, watcher, engine)
    verdicts = [verdict(out, name) for name in baseline.pads]
    raise_failed([baseline, final], verdicts)
    return verdicts


def _done_pads(source: Source, done: Tally) -> Iterator[Measurements | Fault]:
    """Yield the pads that are done, once more; faults were reported before."""
    pads, failed = set(done.pads), {fault.of for fault in done.faults}
    for one in source:
        new = one.of not in failed if isinstance(one, Fault) else one.pads[0].name in pads
        if new:
            yield one
