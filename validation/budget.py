"""Does what is fitted follow the readings? Three checks of records and simulated pads.

(a) The root mean square of what a fit leaves of the block means is at most 1.05 times that of least
squares of the same model on the same block means: of the plain model, and of the answer's.
(b) Along the steps of an answer the error of the fit never rises. (c) An effect that is named
lowers the error on tests left out by more than its standard error (paired, over the tests; only
counted).

Every CSV file of the folders given counts by its folder's name, pads of the wide population by what
is hidden. Interrupted, the same command goes on where it was.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from blind.case import THRESHOLDS
from blind.counting import Case
from blind.population import Population
from blind.study import make_study
from numpy.typing import NDArray
from results import JOBS, Origin, Table, finished

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.samples import error, leave_out, predicted, rmse
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.fitting.least_squares import least_squares as scipys
from qlvbayes.fitting.optimum import find_start, predictor_of
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space
from qlvbayes.inference.modes import find_mode
from qlvbayes.io.data import Pad, read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment, prepare

_FAR = 0.2  # of a number's natural length, one sd, by which starts near a fit lie off it
_BEFORE_PRIORS = 0.3  # sd of the white noise of least squares over what a fit leaves: readings rule
_ROUNDING = 1e-3  # share by which an error may rise from step to step

Array = NDArray[np.float64]
Make = Callable[[], Pad]


MOST = 1.05
"""Times what least squares leaves."""
_FITS = ("plain", "answer", "fit")
COLUMNS = (
    "kind", "pads", "plain", "most", "answer", "most", "fit", "most", "rises", "most", "lowers",
    "failed",
)  # fmt: skip


def main() -> None:
    options = _options()
    origin = Origin.now()
    pads = dict(_recorded(options.folders)) | dict(_simulated(options.seed, options.pads))
    check = partial(_checked, pads, options.bonded.split(","))
    found = finished("budget", check, list(pads), options.jobs)
    Table(origin, len(found), COLUMNS, rows(found), [_worst(found)]).write("budget")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, help="of CSV files; absent ones are left")
    parser.add_argument("--pads", type=int, default=100, help="of the wide population")
    parser.add_argument("--seed", type=int, default=418, help="of the wide population")
    parser.add_argument(
        "--bonded", default="adhesive_shear", help="files whose specimens are fixed to the platen"
    )
    parser.add_argument("--jobs", type=int, default=JOBS, help="processes")
    return parser.parse_args()


def rows(found: Sequence[Case]) -> list[list[str]]:
    """Return a row for each kind of pad, and one for all."""
    kinds = list(dict.fromkeys(case["kind"] for case in found))
    groups = [(kind, [case for case in found if case["kind"] == kind]) for kind in kinds]
    return [_row(kind, some) for kind, some in [*groups, ("all", found)]]


def _row(kind: str, every: Sequence[Case]) -> list[str]:
    some = [case for case in every if "error" not in case]
    cells = [kind, str(len(every))]
    for key in _FITS:
        ratios = [case[key]["ratio"] for case in some]
        cells += [str(sum(ratio > MOST for ratio in ratios)), f"{max(ratios, default=1.0):.2f}"]
    rising = [max(case["rises"]) for case in some if case["rises"]]
    cells += [str(len(rising)), f"{max(rising, default=1.0):.2f}"]
    tested = [one for case in some for one in case["lowered"] if one["error_N2"] is not None]
    lowers = sum(one["fall_N2"] > one["error_N2"] for one in tested)
    return [*cells, f"{lowers} of {len(tested)}", str(len(every) - len(some))]


def _worst(found: Sequence[Case]) -> str:
    """Return a sentence with the pad whose answer leaves most, and those that failed."""
    failed = [f"{case['index']} failed ({case['error']})." for case in found if "error" in case]
    sound = [case for case in found if "error" not in case]
    if not sound:
        return " ".join(failed)
    most = max(sound, key=lambda case: float(case["answer"]["ratio"]))
    named = " + ".join(most["effects"]) or "nothing"
    worst = f"The answer that leaves most is that of {most['index']} ({most['verdict']}: {named})."
    return " ".join([worst, *failed])


def _recorded(folders: Sequence[Path]) -> list[tuple[str, Make]]:
    """Pads of every CSV file, by names that begin with their kind."""
    files = [file for folder in folders for file in sorted(folder.glob("*.csv"))]
    for folder in {*folders} - {file.parent for file in files}:
        print(f"no CSV file in {folder}: left out", file=sys.stderr)
    return [
        (f"{file.parent.name}/{file.stem}/{pad.name}", partial(_same, pad))
        for file in files
        for pad in read_measurements(file).pads
    ]


def _same(pad: Pad) -> Pad:
    return pad


def _simulated(seed: int, count: int) -> list[tuple[str, Make]]:
    population = Population(seed)
    return [
        (f"{population.item(k).levels['kind']}/{population.key}/{k}", partial(_made, population, k))
        for k in range(count)
    ]


def _made(population: Population, index: int) -> Pad:
    return make_study(population, index).pad


def _checked(pads: dict[str, Make], bonded: Sequence[str], name: str) -> Case:
    """All three checks of one pad."""
    found: Case = {"index": name, "kind": name.split("/")[0]}
    try:
        pad = pads[name]()
        fixed = pad.units.bonded_default or name.split("/")[1] in bonded
        experiment, choices = prepare(pad), Choices(bonded=fixed)
        diagnosis = diagnose(experiment, choices, settings=THRESHOLDS)
        return found | checks(diagnosis) | {"fit": by_fit(experiment, choices)}
    except Exception as error:  # one bad pad must not end a run of many
        return found | {"error": f"{type(error).__name__}: {error}"}


def checks(diagnosis: Diagnosis) -> Case:
    """Return the checks of one answer."""
    work, result = diagnosis.work, diagnosis.result
    density = work.search.density
    plain = work.search.modes[work.search.baseline][0]
    steps = [stage.rmse for stage in result.stages]
    return {
        "verdict": result.verdict, "effects": list(result.effects),
        "plain": _fitted(density, plain), "answer": _fitted(density, work.selected),
        "steps": steps, "rises": rises(steps),
        "lowered": [_lowered(diagnosis, effect) for effect in result.effects],
    }  # fmt: skip


def by_fit(experiment: Experiment, choices: Choices) -> dict[str, float]:
    """Return what the best curve of ``qlvbayes fit`` leaves (N), and what least squares would."""
    trials = experiment.with_role("fit")
    plain, rng = predictor_of(experiment, choices, trials), np.random.default_rng(0)
    squares = scipys(plain, np.ones(plain.record.blocks.force.shape), rng)
    thetas = squares.thetas[0], find_start(experiment, choices, trials).normal.mean
    left = plain.residuals(plain.parameters.constants(np.stack(thetas)))
    least, rms = (rmse([one[plain.space.real]]) for one in left)
    return _compared(rms, min(rms, least))


def rises(steps: Sequence[float]) -> list[float]:
    """Factors by which an error rises from a step to the next, where it does."""
    factors = [after / before for before, after in pairwise(steps)]
    return [factor for factor in factors if factor > 1.0 + _ROUNDING]


def _fitted(density: Density, found: Candidate) -> dict[str, float]:
    """Return what a fit leaves of the block means (N), and what least squares would."""
    rms = _rms(density, found.point)
    return _compared(rms, least_squares(density, found.point, rms))


def _compared(rms: float, least: float) -> dict[str, float]:
    return {"rms_N": rms, "least_N": least, "ratio": rms / least if least > 0.0 else math.inf}


def least_squares(density: Density, point: Point, rms: float) -> float:
    """Least root mean square (N) that the same model leaves, of several starts.

    From a fit, from where coarse noise leads it, with its relaxation drawn anew, and near by.
    """
    hypothesis = point.own.hypothesis
    whitener = density.whitener.with_independent_noise(_BEFORE_PRIORS * rms)
    white = Density(density.space, Discrepancy.none(whitener, density.discrepancy.peak))
    rough = find_mode(density.coarse, hypothesis, point.theta)
    starts = around(density.space, hypothesis, point.theta, redrawn=3, moved=2)
    starts += [rough.point.theta] if rough else []
    modes = [find_mode(white, hypothesis, start) for start in starts]
    return min([rms, *(_rms(density, mode.point) for mode in modes if mode)])


def around(
    space: Space, hypothesis: Hypothesis, theta: Array, *, redrawn: int, moved: int, seed: int = 0
) -> list[Array]:
    """Return theta (F,), some with the relaxation drawn anew, and some with all moved."""
    own = space.parameters(hypothesis)
    found = [own.within(theta)]
    relaxing = space.indices_of(hypothesis, "relaxation")
    for drawn in space.prior_draws(hypothesis)[:redrawn, relaxing]:
        start = found[0].copy()
        start[relaxing] = drawn
        found.append(start)
    steps = np.random.default_rng(seed).standard_normal((moved, own.size))
    return found + list(own.within(theta + _FAR * own.length * steps))


def _rms(density: Density, point: Point) -> float:
    left = np.asarray(density.space.record.blocks.force) - point.predicted
    return rmse([left[density.space.real]])


def _lowered(diagnosis: Diagnosis, effect: str) -> Case:
    """By how much an effect lowers the mean square on tests left out, and its standard error."""
    work = diagnosis.work
    selected = work.selected
    fewer = work.search.without(selected, effect)
    if fewer is None:
        return {"effect": effect, "fall_N2": None, "error_N2": None}
    parts = leave_out(work.search.density, work.samples)
    with_it, without = (
        np.array([error([part]) ** 2 for part in predicted(work.samples, parts, one.mode)])
        for one in (selected, fewer)
    )
    fall, error = paired(without, with_it)
    return {"effect": effect, "fall_N2": fall, "error_N2": error}


def paired(before: np.ndarray, after: np.ndarray) -> tuple[float | None, float | None]:
    """Mean of before - after over the parts, and its standard error; None of fewer than two."""
    gaps = np.asarray(before) - np.asarray(after)
    if gaps.size < 2:
        return None, None
    return float(gaps.mean()), float(gaps.std(ddof=1) / math.sqrt(gaps.size))


if __name__ == "__main__":
    main()
