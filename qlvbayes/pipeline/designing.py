"""Which test to do next, from what a fit and a diagnosis left in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from msgspec.structs import replace as with_fields

from qlvbayes.diagnosis.candidate import described
from qlvbayes.diagnosis.nexttest.belief import Belief, Explanation
from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.draws import explanation_of_draws
from qlvbayes.diagnosis.nexttest.errors import ReadingErrors
from qlvbayes.diagnosis.nexttest.hypotheses import explanation_of_mode
from qlvbayes.diagnosis.nexttest.records import record_of
from qlvbayes.diagnosis.nexttest.result import NextTests
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.diagnosis.nexttest.series import Goal, Series, plan_series
from qlvbayes.diagnosis.nexttest.setpoints import as_csv
from qlvbayes.diagnosis.nexttest.suggest import cause_of
from qlvbayes.diagnosis.nexttest.summary import summarize
from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.result import Alternative, DiagnosisResult
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.searchsetup import as_chosen, build_search
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE
from qlvbayes.fitting.results import Saved, load
from qlvbayes.fitting.runs import Run, Runs
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.files import write_whole
from qlvbayes.io.runtime import one_blas_thread
from qlvbayes.io.units import UnitSystem
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.pipeline.watcher import Watcher

CAUSE = "cause"
MOST = 4
"""Causes that are reckoned with,"""
LEAST = 0.05
"""probability from which one is,"""
MOST_EXPLANATIONS = 6
"""and explanations of all of them: each costs a run of every design."""


@dataclass(frozen=True, eq=False)
class Present:
    """What is known before the next test; rig: as the tests that were done show it."""

    pad: str
    units: UnitSystem
    belief: Belief
    rig: Rig
    floor: NoiseFloor
    missed: float
    clock: float = 0.0

    def errors(self, rig: Rig) -> ReadingErrors:
        """Of tests on a rig, with the largest force of the deepest and fastest press."""
        press = Design(rig.depth, rig.speed, rig.acceleration, 1.0)
        first = self.belief.explanations[0]
        force = first.forces(np.zeros((1, first.size)), record_of([press], rig, self.clock))
        return ReadingErrors(self.floor, float(np.max(np.abs(force))), self.missed)


@dataclass(frozen=True, eq=False)
class Found:
    """What was planned, and of what."""

    result: NextTests
    series: Series
    present: Present
    rig: Rig


def design_into(
    out: Path,
    pad: str,
    asked: Sequence[str],
    *,
    minutes: float,
    tests: int,
    depth: float | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    data: Path | None = None,
    seed: int = 0,
    watcher: Watcher | None = None,
) -> tuple[Found, list[Path]]:
    """Plan; leave design.json, set_points.csv and the figure in ``out/pad``.

    asked: names of constants, and ``cause``; empty: all that is not known. Returns the plan and the
    figures' paths. Raises InputError where the folder holds neither a fit nor a diagnosis, a name
    is not known, or no test fits.
    """
    if not minutes > 0.0:
        raise InputError(f"--minutes is {minutes:g}", remedy="give it above 0")
    folder = out / pad
    with (watcher or Watcher()).doing(f"pad {pad}") as tell, one_blas_thread():
        tell("what is known")
        present, cause = _present(folder, out, asked, data)
        names = tuple(name for name in asked if name != CAUSE)
        present.belief.check(names)
        if not asked:
            names = present.belief.base_names
        goal = Goal(names, cause)
        rig = present.rig.limited(depth, speed, acceleration)
        errors = present.errors(rig)
        series = plan_series(
            present.belief, rig, errors, goal,
            minutes=minutes, tests=tests, clock=present.clock, seed=seed, report=tell,
        )  # fmt: skip
        result = summarize(
            pad, present.units, present.belief, rig, errors, goal, series,
            minutes=minutes, seed=seed,
        )  # fmt: skip
        found = Found(result, series, present, rig)
        tell("writing")
        designs = [one.design for one in series.tests]
        write_whole(folder / "set_points.csv", as_csv(designs, present.units).encode())
        result.write(folder / "design.json")
        figures = _figures(found, folder)
    return found, figures


def _figures(found: Found, folder: Path) -> list[Path]:
    # here, so that other commands do not wait for matplotlib
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.nexttests import plot_next_tests

    present, series = found.present, found.series
    axes = plot_next_tests(
        found.result, [one.design for one in series.tests], present.belief, found.rig,
        present.floor.total, clock=present.clock,
    )  # fmt: skip
    return [save_figure(axes, folder / "design")]


def _present(
    folder: Path, out: Path, asked: Sequence[str], data: Path | None
) -> tuple[Present, bool]:
    """Return what is known, and whether the cause is asked for, which has to be in doubt then."""
    fit, judged = folder / "posterior.nc", folder / "diagnosis.json"
    result = DiagnosisResult.read(judged) if judged.is_file() else None
    if result is None and not fit.is_file():
        raise InputError(
            "neither a fit nor a diagnosis of this pad", file=folder, remedy="run qlvbayes fit"
        )
    families = Families.from_kinds((*EFFECTS, *FORMS, *OUTSIDE))
    doubted = likely(result.alternatives, families) if result else []
    causes = {cause_of(one.effects, families) for one in doubted}
    wanted = CAUSE in asked
    if wanted and len(causes) < 2:
        raise InputError(
            "no two sets of effects are in doubt" if result else "no diagnosis of this pad",
            file=folder,
            remedy="ask for constants, as --for m,b" if result else "run qlvbayes diagnose",
        )
    cause = wanted or (not asked and len(causes) > 1)
    if not cause and fit.is_file():
        return present_of_fit(load(fit), data), False
    assert result is not None
    return _of_diagnosis(out, result, doubted, data), cause


def likely(found: Sequence[Alternative], families: Families) -> list[Alternative]:
    """Explanations that are reckoned with, of causes with a probability summed over all their laws.

    The likeliest of each cause, then the others; they share their cause's probability.
    """
    groups: dict[str, list[Alternative]] = {}
    for one in sorted(found, key=lambda one: -one.probability):
        groups.setdefault(cause_of(one.effects, families), []).append(one)
    total = {cause: sum(one.probability for one in some) for cause, some in groups.items()}
    counted = sorted((cause for cause in groups if total[cause] >= LEAST), key=lambda c: -total[c])
    counted = counted[:MOST]
    firsts = [groups[cause][0] for cause in counted]
    others = [one for cause in counted for one in groups[cause][1:] if one.probability >= LEAST]
    others.sort(key=lambda one: -one.probability)
    kept = [*firsts, *others][:MOST_EXPLANATIONS]
    shared = []
    for cause in counted:
        own = [one for one in kept if one in groups[cause]]
        factor = total[cause] / sum(one.probability for one in own)
        shared += [with_fields(one, probability=factor * one.probability) for one in own]
    return sorted(shared, key=lambda one: -one.probability)


def present_of_fit(saved: Saved, data: Path | None = None) -> Present:
    """Return what is known by a fit's posterior, and of the rig by its measurements if given."""
    if saved.covered is None:
        raise InputError(
            f"the posterior of pad {saved.pad} does not say what its tests cover",
            remedy="run qlvbayes fit again",
        )
    draws = dict(zip(saved.names, saved.draws.T, strict=True))
    one = explanation_of_draws(saved.choices, saved.names, saved.draws, saved.covered.depth)
    found = Present(
        saved.pad,
        saved.units,
        Belief.from_explanations([one]),
        Rig.from_ranges(saved.covered),
        _floor_of(draws, saved.pad),
        float(np.median(draws.get("noise.remainder", np.zeros(1)))),
    )
    source = data or Path(saved.source)
    if data is None and not source.is_file():
        return found
    study = read_measurements(source)
    if study.sha256 != saved.sha256:
        raise InputError(
            "not the measurements that were fitted", file=source, remedy="run qlvbayes fit again"
        )
    pad, keep = study.pad(saved.pad), saved.choices.keep_all_readings
    experiment = prepare(pad, keep_all_readings=keep, use=saved.choices.use)
    return replace(found, rig=Rig.from_tests(experiment), clock=experiment.scales.clock)


def _floor_of(draws: dict[str, np.ndarray], pad: str) -> NoiseFloor:
    """Means of the noise's draws."""
    mean = {name: float(values.mean()) for name, values in draws.items()}
    factor = mean.get("noise.factor", 1.0)
    white = mean.get("noise.white", mean.get("noise.scale"))
    if white is None:
        raise InputError(
            f"the posterior of pad {pad} has no noise", remedy="give draws of noise.white"
        )
    return NoiseFloor(
        factor * white, factor * mean.get("noise.ou", 0.0), mean.get("noise.tau", 1.0)
    )


def _of_diagnosis(
    out: Path, result: DiagnosisResult, doubted: Sequence[Alternative], data: Path | None
) -> Present:
    run = _run(out)
    source = data or Path(run.source)
    if not source.is_file():
        raise InputError(
            "the measurements that were diagnosed are not there",
            file=source,
            remedy="say where they are with --data FILE",
        )
    study = read_measurements(source)
    if study.sha256 != run.sha256:
        raise InputError(
            "not the measurements that were diagnosed",
            file=source,
            remedy="run qlvbayes diagnose again",
        )
    choices = Choices.from_dict(run.choices)
    pad, keep = study.pad(result.pad), choices.keep_all_readings
    experiment = as_chosen(prepare(pad, keep_all_readings=keep, use=choices.use), choices)
    search = build_search(
        experiment, choices, kinds=choices.candidates, settings=_thresholds(result)
    )
    explanations = explained(search, doubted or result.alternatives[:1])
    scales = experiment.scales
    return Present(
        result.pad,
        experiment.units,
        Belief.from_explanations(explanations, result.outside),
        Rig.from_tests(experiment),
        experiment.floor,
        result.discrepancy,
        scales.clock,
    )


def _thresholds(result: DiagnosisResult) -> DiagnosisSettings | None:
    return result.settings.thresholds if result.settings else None


def _run(out: Path) -> Run:
    """Return the last run that diagnosed."""
    path = out / "run.json"
    runs = Runs.read(path).runs if path.is_file() else {}
    run = runs.get("diagnose", runs.get("study"))
    if run is None:
        raise InputError("no diagnosis in this folder", file=out, remedy="run qlvbayes diagnose")
    return run


def explained(search: Search, alternatives: Sequence[Alternative]) -> list[Explanation]:
    """Alternatives at their likeliest modes; those that have none are left out."""
    search.begin()
    baseline = search.baseline
    found = []
    for one in alternatives:
        hypothesis = Hypothesis(
            one.base.elastic, one.base.relaxation, baseline.effects | set(one.effects)
        )
        bare = Hypothesis(*one.base.pair, baseline.effects)
        search.evaluate(bare)
        if bare in search.modes:
            search.evaluate(hypothesis, bare)
        if hypothesis not in search.modes:
            continue
        best = search.modes[hypothesis][0]
        found.append(
            explanation_of_mode(
                search.density,
                hypothesis,
                best.point,
                best.evidence.covariance,
                best.mode.size,
                one.probability,
                described(hypothesis),
                cause_of(one.effects, search.families),
            )
        )
    if not found:
        raise InputError(
            "none of the diagnosis's explanations fits any more",
            remedy="run qlvbayes diagnose again",
        )
    return found
