"""Plan the next tests of a pad from its saved fit or diagnosis, and its measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from qlvbayes.diagnosis.nexttest.belief import Belief, Explanation, is_meant
from qlvbayes.diagnosis.nexttest.design import Design, Readings
from qlvbayes.diagnosis.nexttest.planning import Goal, NextTests, plan_tests
from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.searchsetup import as_chosen
from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE
from qlvbayes.fitting.results import Run, Saved, load
from qlvbayes.io.arrays import Array
from qlvbayes.io.catalogue import MOST_TESTS
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import write_whole
from qlvbayes.io.runtime import one_blas_thread
from qlvbayes.io.units import UnitSystem, column_name
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import described_model
from qlvbayes.motion.experiment import Experiment
from qlvbayes.pipeline.source import read_again
from qlvbayes.pipeline.steps import Watcher
from qlvbayes.report.collect import runs_in
from qlvbayes.use.prescribed.hypotheses import FILE as HYPOTHESES
from qlvbayes.use.prescribed.hypotheses import Hypotheses

CAUSE = "cause"  # the goal that is no constant
SET_POINTS = 1000.0  # a second in the file for the rig, as the paper's controller takes them
PAUSE = "pause"  # entry of the column ``test`` while the pad recovers
_DIGITS = 9  # more than any rig resolves
_ROUNDING = 1e-9  # of the depth


def design_into(
    out: Path,
    pad: str,
    goals: Sequence[str],
    *,
    minutes: float,
    tests: int,
    data: Path | None = None,
    seed: int = 0,
    watcher: Watcher | None = None,
    **limits: float,
) -> tuple[NextTests, Path]:
    """Plan the next tests; return them and the path of their figure.

    Leaves design.json, set_points.csv and the figure in ``out/pad``. ``limits`` are those of depth,
    speed and acceleration that differ from the tests' own.
    """
    if not minutes > 0.0:
        raise InputError(f"--minutes is {minutes:g}", remedy="give it above 0")
    # imported here, so that other commands do not wait for matplotlib
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.prediction import plot_next_tests

    folder = out / pad
    with (watcher or Watcher()).doing(f"pad {pad}") as report, one_blas_thread():
        report("what is known")
        belief, experiment, missed = known(folder, goals, data)
        cause = CAUSE in goals or (not goals and len(belief.causes) > 1)
        goal = Goal(_constants(belief, goals), cause, minutes, min(tests, MOST_TESTS))
        readings = Readings.after(experiment, missed, **limits)
        result = plan_tests(pad, experiment.units, belief, readings, goal, seed=seed, report=report)
        report("writing")
        write_whole(folder / "set_points.csv", as_csv(result.tests, experiment.units).encode())
        result.write(folder / "design.json")
        figure = save_figure(plot_next_tests(result, belief, readings), folder / "design")
    return result, figure


def _constants(belief: Belief, goals: Sequence[str]) -> tuple[str, ...]:
    """Return the constants that are asked for: without a goal, the free ones of the laws."""
    every = [pair for x in belief.explanations for pair in zip(x.names, x.gradient, strict=True)]
    if not goals:
        free = (name for name, slopes in every if "." not in name and slopes.any())
        return tuple(dict.fromkeys(free))
    known, names = dict.fromkeys(name for name, _ in every), [x for x in goals if x != CAUSE]
    for name in names:
        if not any(is_meant(own, [name]) for own in known):
            raise InputError(f"no constant '{name}'", remedy=f"use cause, {', '.join(known)}")
    return tuple(names)


def set_points(designs: Sequence[Design]) -> tuple[Array, Array, list[str]]:
    """Return times (N,) in s, displacements (N,) in mm, and the name of the test of each."""
    parts, tests = [], []
    for k, design in enumerate(designs):
        pause = max(round(design.wait * SET_POINTS) - 1, 0) if k else 0
        count = int(np.ceil(design.seconds * SET_POINTS)) + 1
        parts += [np.zeros(pause), design.trajectory.displacement(np.arange(count) / SET_POINTS)]
        tests += [PAUSE] * pause + [f"next-{k + 1}"] * count
    position = np.concatenate(parts)
    position = np.where(np.abs(position) > _ROUNDING * position.max(), position, 0.0)
    return np.arange(position.size) / SET_POINTS, position, tests


def as_csv(designs: Sequence[Design], units: UnitSystem) -> str:
    """Return the text of the file, with the columns time_s, displacement and test."""
    name = column_name(units.displacement_name, "" if units.dimensionless else units.displacement)
    rows = zip(*set_points(designs), strict=True)
    lines = [f"time_s,{name},test", *(f"{t:.3f},{x:.{_DIGITS}g},{test}" for t, x, test in rows)]
    return "\n".join(lines) + "\n"


def known(
    folder: Path, goals: Sequence[str], data: Path | None = None
) -> tuple[Belief, Experiment, float]:
    """Return what is known of a pad, its tests, and the size of what is left unexplained (force).

    It is what the diagnosis left; where there is none, or constants alone are asked for and there
    is a fit, what the fit knows.
    """
    fit, diagnosis, drawn = (folder / x for x in ("posterior.nc", "diagnosis.json", HYPOTHESES))
    saved = load(fit) if fit.is_file() else None
    diagnosed = diagnosis.is_file() and drawn.is_file()
    result = DiagnosisResult.read(diagnosis) if diagnosed else None
    if result is None and saved is None:
        what = "neither a fit nor a diagnosis of this pad"
        raise InputError(what, file=folder, remedy="run qlvbayes fit")
    if result is None and CAUSE in goals:
        raise InputError("no diagnosis of this pad", file=folder, remedy="run qlvbayes diagnose")
    if saved is not None and (result is None or (goals and CAUSE not in goals)):
        return _fitted(saved, data)
    assert result is not None
    left, explanations = Hypotheses.read(drawn), []
    families = Families.from_kinds((*EFFECTS, *FORMS, *OUTSIDE))
    for one in left.hypotheses:
        choices, cause = left.side(one).choices, families.cause(one.effects)
        model = described_model(choices, left.covered.depth)
        draws = {name: np.array(values) for name, values in one.curve.items()}
        words = _words(choices)
        explanations.append(Explanation.from_draws(words, model, draws, one.probability, cause))
    belief = Belief.from_explanations(explanations, result.outside)
    if CAUSE in goals and len(belief.causes) < 2:
        remedy = "ask for constants, as --for m,b"
        raise InputError("no two sets of effects are in doubt", file=folder, remedy=remedy)
    runs = runs_in(folder.parent)
    run = runs.get("diagnose", runs.get("study"))  # the last that diagnosed, where it is known
    source = run if saved is None or (run is not None and run.sha256) else saved
    return belief, _measured(left.pad, left.choices, source, data), result.discrepancy


def _fitted(saved: Saved, data: Path | None) -> tuple[Belief, Experiment, float]:
    """Return the same of a fit, with its noise where that is fitted."""
    choices = saved.choices
    experiment = _measured(saved.pad, choices, saved, data)
    draws = dict(zip(saved.names, saved.curve_draws.T, strict=True))
    if choices.noise == "white":
        floor = experiment.floor.as_white(float(draws["noise.white"].mean()))
        experiment = replace(experiment, floor=floor)
    model = described_model(choices, experiment.scales.depth)
    one = Explanation.from_draws(_words(choices), model, draws, 1.0, _words(choices))
    missed = float(np.median(draws.get("noise.remainder", 0.0)))
    return Belief.from_explanations([one]), experiment, missed


def _words(choices: Choices) -> str:
    return " + ".join((f"{choices.elastic}, {choices.relaxing}", *choices.effects))


def _measured(
    pad: str, choices: Choices, known: Saved | Run | None, data: Path | None
) -> Experiment:
    source, sha256 = (known.source, known.sha256) if known else ("", "")
    study = read_again(source, sha256, data)
    return as_chosen(choices.prepare(study.pad(pad)), choices)
