"""A pad without memory: contact laws for rigid-body simulators, with their error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls

from qlvbayes.fitting.prediction import representative_rows
from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, Pad, read_measurements
from qlvbayes.io.units import unit_system
from qlvbayes.laws.motion import Motion
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.facts import Covered
from qlvbayes.motion.phases import MOVING
from qlvbayes.motion.record import batch
from qlvbayes.use.exports.pad import ExportedPad

SI = unit_system("m", "N")
_RATES = 5  # loading rates, evenly in their logarithm from the slowest tested to the fastest
_RAMP = 100  # times in a ramp, and as many in a hold

Law = Callable[..., Floats]
"""Force (N) of depth (m), speed (m/s) and the law's constants."""


class PhaseLabel(NamedTuple):
    """One kind of phase of one test; role: fit, validate, or empty where there was no test."""

    test: str
    role: str
    phase: str


@dataclass(frozen=True, eq=False)
class Pressing:
    """Motions in SI units: the pad's own tests, or where they are not at hand ramps and holds.

    depth (m), speed (m/s), force (N): (n,) of all times of all motions, one after another, the
    force of the pad's model, effects and all; measured (N): of the tests, else the same as force;
    cells: tests and phases; cell: (n,) which of them a time is in; absent: why it is not the tests
    themselves, empty where it is.
    """

    depth: Floats
    speed: Floats
    force: Floats
    measured: Floats
    cells: tuple[PhaseLabel, ...]
    cell: NDArray[np.intp]
    absent: str = ""

    @property
    def weight(self) -> Floats:
        """(n,) by which every cell counts alike, however many times it has."""
        return np.asarray(1.0 / np.bincount(self.cell)[self.cell])

    @property
    def peaks(self) -> Floats:
        """(cells,) largest magnitude of the measured force (N) in the test of each."""
        size = np.abs(self.measured)
        top = np.array([np.max(size[self.cell == i]) for i in range(len(self.cells))])
        names = np.array([cell.test for cell in self.cells])
        return np.array([np.max(top[names == name]) for name in names])

    def errors(self, force: Floats) -> Floats:
        """Return the root mean square error (cells,) of a force (n,), over the test's peak."""
        squares = np.bincount(self.cell, weights=(force - self.measured) ** 2)
        return np.asarray(np.sqrt(squares / np.bincount(self.cell)) / self.peaks)

    def miss(self, force: Floats) -> Miss:
        """Return how far a force (n,) is from the measured one."""
        squares = self.errors(force) ** 2
        still = squares[[cell.phase not in MOVING for cell in self.cells]]
        off = np.abs(force - self.measured) / self.peaks[self.cell]
        whole, hold = (float(np.sqrt(np.mean(x))) if x.size else 0.0 for x in (squares, still))
        return Miss(whole, float(np.max(off)), hold, bool(self.absent))


@dataclass(frozen=True)
class Miss:
    """Error of a law without memory over the largest force, in all phases and in holds.

    modelled: whether it is the force of the pad's model, not the measured one.
    """

    rms: float
    largest: float
    hold: float
    modelled: bool

    def __str__(self) -> str:
        which, where = ("", "over the tested range") if self.modelled else ("measured ", "of tests")
        return (
            f"misses the {which}force by {self.rms:.0%} rms and {self.largest:.0%} at most of the "
            f"peak force {where}, by {self.hold:.0%} rms in holds"
        )


def pressing(pad: ExportedPad) -> Pressing:
    """Return the force of the middle draw, effects and all, along the pad's tests."""
    if pad.units.dimensionless:
        raise InputError(
            f"pad {pad.pad} has strain and stress, not displacement and force",
            remedy="use --to abaqus, febio or prony",
        )
    if pad.covered is None:
        raise InputError(
            f"the results of pad {pad.pad} do not say which depths and rates were tested",
            remedy="run qlvbayes fit, or use --to json",
        )
    tests, absent = own_tests(pad)
    if tests is None:
        rates = np.geomspace(pad.covered.slowest, pad.covered.fastest, _RATES)
        runs = [_planned(pad, pad.covered, rate) for rate in rates]
    else:
        runs = _tested(pad, tests)
    cells = list(dict.fromkeys(cell for run in runs for cell in run.cells))
    columns = (np.concatenate(x) for x in zip(*(run.columns for run in runs), strict=True))
    depth, speed, force, measured = columns
    metre = pad.units.factor_to(SI, "displacement")
    newton = pad.units.factor_to(SI, "force")
    return Pressing(
        depth=metre * depth,
        speed=metre * speed,
        force=newton * force,
        measured=newton * measured,
        cells=tuple(cells),
        cell=np.array([cells.index(cell) for run in runs for cell in run.cells]),
        absent=absent,
    )


class _MotionRun(NamedTuple):
    """One motion: of each time its cell, and depth, speed, modelled and measured force."""

    cells: list[PhaseLabel]
    columns: tuple[Floats, Floats, Floats, Floats]


def _planned(pad: ExportedPad, reach: Covered, rate: float) -> _MotionRun:
    end = reach.depth / rate
    ramp = np.linspace(0.0, end, _RAMP + 1)
    hold = end + reach.hold * np.linspace(0.0, 1.0, _RAMP + 1)[1:]
    time = np.concatenate([ramp, hold])
    depth = np.minimum(rate * time, reach.depth)
    rising = time <= end
    speed = np.where(rising, rate, 0.0)
    motion = Motion(*map(jnp.asarray, (time, depth, speed, np.zeros_like(time))))
    force = np.asarray(pad.model.force(motion))
    name = f"{rate:.3g} {pad.units.speed}"
    cells = [PhaseLabel(name, "", "ramp" if moves else "hold") for moves in rising]
    return _MotionRun(cells, (depth, speed, force, force))


def _tested(pad: ExportedPad, tests: Experiment) -> list[_MotionRun]:
    samples = [representative_rows(trial) for trial in tests.trials]
    records = map(tests.reduced, tests.trials, samples)
    mean = eqx.filter_vmap(lambda model, x: x.average(model.force(x.motion)), in_axes=(None, 0))
    averages = np.asarray(eqx.filter_jit(mean)(pad.model, batch(list(records))))
    runs = []
    for trial, rows, force in zip(tests.trials, samples, averages, strict=True):
        time = trial.test.time[rows]
        columns = (
            trial.trajectory.displacement(time),
            trial.trajectory.velocity(time),
            force[: rows.size],
            trial.test.force[rows],
        )
        cells = [PhaseLabel(trial.name, trial.role, str(kind)) for kind in trial.phase_of(time)]
        runs.append(_MotionRun(cells, columns))
    return runs


def fitted(columns: Sequence[Floats], pressed: Pressing) -> Floats:
    """Return the factors, none below zero, that bring the columns closest to the model's force."""
    root = np.sqrt(pressed.weight)
    sizes = np.array([float(np.max(np.abs(column))) for column in columns])
    matrix = np.stack([root * x / size for x, size in zip(columns, sizes, strict=True)], axis=-1)
    return np.asarray(nnls(matrix, root * pressed.force)[0] / sizes)


def closest(
    law: Law,
    pressed: Pressing,
    start: Sequence[float],
    low: Sequence[float] | float = 0.0,
    high: Sequence[float] | float = np.inf,
) -> list[float]:
    """Return a law's constants, between two bounds, that bring it closest to the model's force."""
    root = np.sqrt(pressed.weight)
    begin = np.maximum(start, low)

    def off(parameters: Floats) -> Floats:
        return root * (law(pressed.depth, pressed.speed, *parameters) - pressed.force)

    scale = np.where(begin > 0.0, begin, 1.0)
    fit = least_squares(off, begin, bounds=(low, high), x_scale=scale, xtol=1e-12, ftol=1e-12)
    return [float(value) for value in fit.x]


def own_tests(pad: ExportedPad) -> tuple[Experiment | None, str]:
    """Return all tests of a pad as the fit saw them; else None, and why."""
    if pad.data is None:
        if not pad.source:
            return None, "the results do not say which file was fitted"
        if not Path(pad.source).is_file():
            return None, f"{pad.origin} is not where it was; --data FILE says where the tests are"
    study = read_measurements(pad.data or pad.source)
    if study.sha256 != pad.sha256:
        if pad.data is None:
            return None, f"{pad.origin} has changed since the fit"
        raise InputError(
            f"not the file that pad {pad.pad} was fitted to", file=pad.data, remedy="fit it again"
        )
    choices = pad.choices
    tests = choices.prepare(_pad_of(study, pad.pad), all_tests=pad.all_tests)
    return replace(tests, rested=choices.rested), ""


def _pad_of(study: Measurements, name: str) -> Pad:
    """Return the pad of that name, or the only one of its file, which is named after the file."""
    if len(study.pads) == 1:
        return study.pads[0]
    stem = Path(study.source).name.split(".")[0]
    known = {f"{stem}-{pad.name}": pad for pad in study.pads} | {x.name: x for x in study.pads}
    return known[name] if name in known else study.pad(name)
