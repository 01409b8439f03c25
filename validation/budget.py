"""Does what is fitted follow the readings? Three checks of records and simulated pads; a page.

(a) The root mean square of what a fit leaves of the block means is at most 1.05 times that of least
squares of the same model on the same block means: of the plain model, and of the answer's.
(b) Along the steps of an answer the error of the fit never rises. (c) An effect that is named
lowers the error on tests left out by more than its standard error (paired, over the tests; only
counted).

Every CSV file of the folders given counts by its folder's name, pads of the wide population by what
is hidden. Interrupted, the same command goes on where it was; `--finished` writes what there is.
"""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from blind.case import THRESHOLDS
from blind.counting import Case
from blind.population import Population
from blind.store import Store, run_missing, store_path
from blind.study import make_study
from budget_page import budget_page
from page import Origin
from starts import around

from qlvbayes.cli.console import counting
from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.heldout import held_out
from qlvbayes.diagnosis.checks.samples import rmse
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.fitting import compiled
from qlvbayes.fitting.fit import build_posterior, separated_start
from qlvbayes.fitting.optimum import least_squares_points
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.modes import find_mode, rough_mode
from qlvbayes.io.data import Pad, read_measurements
from qlvbayes.io.files import write_json, write_whole
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.parallel.engines import opened_engine

ROOT = Path(__file__).resolve().parents[1]
_BEFORE_PRIORS = 0.3  # sd of the white noise of least squares over what a fit leaves: readings rule
_ROUNDING = 1e-3  # share by which an error may rise from step to step

Make = Callable[[], Pad]


def main() -> None:
    options = _options()
    pads = dict(_recorded(options.folders)) | dict(_simulated(options.seed, options.pads))
    store = Store(store_path(ROOT / "build" / "validation", "budget"), "budget")
    if not options.finished:
        check = partial(_checked, pads, options.bonded.split(","))
        with opened_engine(options.jobs) as engine, counting("pads") as report:
            run_missing(check, store, pads, report, engine)
    found = [store.cases[name] for name in pads if name in store.cases]
    command = shlex.join([".venv/bin/python", "validation/budget.py", *sys.argv[1:]])
    origin = Origin.now(command, ROOT)
    write_whole(options.output, budget_page(found, len(pads), origin).encode())
    write_json(options.output.with_suffix(".json"), {"schema": 1, "cases": found})
    print(options.output)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, help="of CSV files; absent ones are left")
    parser.add_argument("--pads", type=int, default=100, help="of the wide population")
    parser.add_argument("--seed", type=int, default=418, help="of the wide population")
    parser.add_argument(
        "--bonded", default="adhesive_shear", help="files whose specimens are fixed to the platen"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--finished", action="store_true", help="write the page, run nothing")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "budget.md")
    return parser.parse_args()


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
    found: Case = {"plan": "budget", "index": name, "kind": name.split("/")[0]}
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
    plain, rng = build_posterior(experiment, choices, trials), np.random.default_rng(0)
    points = least_squares_points(plain, experiment.floor, rng)
    points.append(separated_start(experiment, choices, trials, rng)[1].mean)
    real = np.asarray(plain.record.blocks.real)
    *least, rms = (rmse([compiled.response(plain, point)[1][real]]) for point in points)
    return _compared(rms, min(rms, *least))


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
    white = Density(density.space, whitener, Discrepancy.none(whitener, density.discrepancy.peak))
    rough = rough_mode(density, hypothesis, point.theta)
    starts = around(density.space, hypothesis, point.theta, redrawn=3, moved=2)
    starts += [rough.point.theta] if rough else []
    modes = [find_mode(white, hypothesis, start) for start in starts]
    return min([rms, *(_rms(density, mode.point) for mode in modes if mode)])


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
    with_it, without = (
        np.array(held_out(work.search.density, work.samples, one).by_part) ** 2
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
