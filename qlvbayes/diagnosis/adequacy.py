r"""Is structure left? Cell by cell (test and phase), against the noise measured without the model.

Under a right model the residual is noise of a known floor, less what the fitted constants take. In
each cell four smooth curves (Legendre polynomials of order 0 to 3 over the cell's blocks) are
tried (the phases of many cycles are one cell, whose curves repeat from cycle to cycle and may
drift from one to the next), and the generalised least-squares statistic

.. math:: s^T V^{-1} s / q, \quad s = B^T \Sigma^{-1} r, \quad
          V = B^T \Sigma^{-1} B - B^T \Sigma^{-1} J A^{-1} J^T \Sigma^{-1} B

has an F distribution with q and nu degrees of freedom, nu those of the floor's own estimate; so
has that of all cells' curves together, which sees what is spread thinly. The
noise is the fit's only as far as the rests alone, without any model, allow it (99.9 % by their
restricted likelihood; its white part may be what suits them) and with no memory longer than a
twentieth of a rest, which they could not tell from a trend: it cannot swallow structure by
swelling.

Where the fit needs more correlated noise than the floor has, that speaks too: with its sd and
correlation time, and what white noise suits them best, the rests lose so much likelihood that a
chi^2 with two degrees of freedom gives p_n (white noise may well grow while the platen moves: no
structure looks like it). With p_1 of the
worst cell (Sidak's correction for their number), p_a of all together and p_f of cells and noise by
Fisher's method,

.. math:: p = 2 \min(p_c, p_f), \quad p_c = 2 \min(p_1, p_a), \quad
          p_f = P(\chi^2_4 > -2 \ln p_c - 2 \ln p_n)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.stats import chi2, combine_pvalues
from scipy.stats import f as fisher

from qlvbayes.diagnosis.settings import Settings
from qlvbayes.experiment import Experiment, Trial
from qlvbayes.inference.gaussnewton import Point, pad_directions, predict_along
from qlvbayes.inference.linearised import whitened
from qlvbayes.inference.subset import Ensemble
from qlvbayes.kinematics.phases import Phase
from qlvbayes.noise import AbstractGaussian, Correlated
from qlvbayes.records.record import Blocks, Record

_ORDERS = 4
_ALLOWED = 0.5 * float(chi2.ppf(0.999, 3))  # log-likelihood of the rests that noise may lose
_TRIES = 21
_MEMORY = 0.05  # longest correlation time over a rest
_LEAST = 1e-12
_LITTLE = 0.03  # of the noise: the least that its correlated part can be told from none
_LEAST_P = 1e-300
_FEWEST = 3  # blocks a curve, at least
_MOST_APART = 5  # phases of a kind in a test: of more, as in cycles, one cell is made,
_CYCLE_ORDERS = 2  # whose mean over a cycle may drift by a straight line and a parabola


@dataclass(frozen=True)
class CellTest:
    """One cell: its phase's place in the test, how many curves were tried, and the p-value."""

    test: str
    phase: str
    start: float
    curves: int
    p_value: float


@dataclass(frozen=True)
class Adequacy:
    """Each cell, all together, and the noise that the fit needs; the module has the p-values."""

    cells: tuple[CellTest, ...]
    joint_p_value: float
    noise_p_value: float

    @property
    def cells_p_value(self) -> float:
        """Of the worst cell, corrected for their number, and of all together."""
        smallest = self.worst.p_value
        worst = float(-np.expm1(len(self.cells) * np.log1p(-smallest))) if smallest < 1.0 else 1.0
        return min(2.0 * min(worst, self.joint_p_value), 1.0)

    @property
    def p_value(self) -> float:
        """Of cells and noise."""
        cells = self.cells_p_value
        both = float(combine_pvalues([max(p, _LEAST_P) for p in (cells, self.noise_p_value)])[1])
        return min(2.0 * min(cells, both), 1.0)

    def is_sound(self, settings: Settings) -> bool:
        """Whether no structure is left that chance would not make."""
        return self.p_value >= settings.false_alarms

    @property
    def worst(self) -> CellTest:
        """The cell of smallest p-value."""
        return min(self.cells, key=lambda cell: cell.p_value)


def adequacy(experiment: Experiment, ensemble: Ensemble, point: Point) -> Adequacy:
    """Test what a fitted model leaves of every phase."""
    return adequacy_along(
        experiment,
        ensemble,
        point,
        *predict_along(ensemble, point.constants, pad_directions(point.slopes.T)),
    )


def adequacy_along(
    experiment: Experiment,
    ensemble: Ensemble,
    point: Point,
    predicted: np.ndarray,
    slopes: np.ndarray,
) -> Adequacy:
    """The same, given block means (T, B) and their slopes (K, T, B) along what was fitted."""
    record = ensemble.posterior.record
    residual = np.asarray(record.blocks.force) - predicted
    cells, curves = _curves(experiment.trials, record.blocks)
    noise = allowed_noise(ensemble, point, experiment)
    r, J, B = (
        whitened_vectors(noise, record, vectors) for vectors in (residual[None], slopes, curves)
    )
    left = B - (B @ J.T) @ np.linalg.solve(_information(J, point), J)
    score, spread = left @ r[0], left @ B.T
    freedom = floor_freedom(experiment)
    tests = []
    for cell, rows in cells:
        p, rank = _p_value(score[rows], spread[np.ix_(rows, rows)], freedom)
        tests.append(CellTest(cell[0], cell[1], cell[2], rank, p))
    joint, _ = _p_value(score, spread, freedom)
    return Adequacy(tuple(tests), joint, swollen(ensemble, point, experiment))


def is_sound(
    experiment: Experiment, ensemble: Ensemble, point: Point | None, settings: Settings
) -> bool:
    """Whether a model was fitted and leaves no structure."""
    if point is None:
        return False
    return adequacy(experiment, ensemble, point).is_sound(settings)


def swollen(ensemble: Ensemble, point: Point, experiment: Experiment) -> float:
    """P-value of the rests under the fit's correlated noise; 1 where that is below the floor's."""
    fitted, measured = _noises(ensemble, point, experiment)
    if fitted[1] <= measured[1]:  # always so where white noise was asked for
        return 1.0
    lost = experiment.floor.surprise_of_correlated(*fitted[1:])
    return float(chi2.sf(2.0 * max(lost, 0.0), 2))


def _noises(
    ensemble: Ensemble, point: Point, experiment: Experiment
) -> tuple[np.ndarray, np.ndarray]:
    """(3,) white sd, correlated sd and correlation time: fitted, and measured at rest."""
    floor = experiment.floor
    count = len(ensemble.posterior.noise.units)
    fitted = point.constants[-count:].copy()
    measured = np.array([floor.white, max(floor.ou, _LITTLE * floor.total), floor.tau])
    if count == 1:  # white noise was asked for
        fitted = np.array([fitted[0], 0.0, floor.tau])
        measured[:2] = floor.total, 0.0
    fitted[2] = min(fitted[2], max(floor.tau, _MEMORY * float(np.median(resting(experiment)))))
    return np.maximum(fitted, _LEAST), np.maximum(measured, _LEAST)


def allowed_noise(ensemble: Ensemble, point: Point, experiment: Experiment) -> Correlated:
    """The fitted noise, drawn towards the floor until the rests allow it.

    Where they do not, its white part is first what suits them best beside the correlated one.
    """
    floor, (fitted, measured) = experiment.floor, _noises(ensemble, point, experiment)
    if floor.surprise(*fitted) > _ALLOWED:
        fitted[0] = floor.white_beside(*fitted[1:])
    for share in np.linspace(0.0, 1.0, _TRIES):
        tried = fitted ** (1.0 - share) * measured**share
        if floor.surprise(*tried) <= _ALLOWED:
            break
    return Correlated(*(jnp.asarray(x) for x in tried))


def resting(experiment: Experiment) -> list[float]:
    """Lengths (s) of all holds and recoveries; 0 alone where there is none."""
    found = [
        phase.stop - phase.start
        for trial in experiment.trials
        for phase in trial.phases
        if phase.kind in ("hold", "recovery")
    ]
    return found or [0.0]


def floor_freedom(experiment: Experiment) -> float:
    """Degrees of freedom of the floor: independent stretches of the correlated part at rest."""
    floor = experiment.floor
    if floor.ou > 0.0:
        return max(0.5 * sum(resting(experiment)) / floor.tau, 5.0)
    return float(max(sum(t.test.time.size for t in experiment.trials) / 2, 5))


def whitened_vectors(noise: AbstractGaussian, record: Record, vectors: np.ndarray) -> np.ndarray:
    """(M, T*B) vectors (M, T, B) filtered to unit white noise if they are it, 16 at a time."""
    out = []
    for first in range(0, len(vectors), 16):
        some = vectors[first : first + 16]
        full = np.concatenate([some, np.zeros((16 - len(some), *some.shape[1:]))])
        out.append(np.asarray(whitened(noise, record, jnp.asarray(full)))[: len(some)])
    found = np.concatenate(out)
    return found.reshape(len(found), -1)


def _information(J: np.ndarray, point: Point) -> np.ndarray:
    """(K, K): of the sensitivities; padding and what the data leave open kept finite."""
    matrix = J @ J.T
    free = point.gradient.size
    ridge = np.ones(len(J))
    ridge[:free] = 1e-9 * np.maximum(np.diag(matrix)[:free], 1e-3)
    return matrix + np.diag(ridge)


def _curves(
    trials: Sequence[Trial], blocks: Blocks
) -> tuple[list[tuple[tuple[str, str, float], list[int]]], np.ndarray]:
    """Cells (test, phase, start) with the rows of their curves, and the curves (M, T, B)."""
    first, last, real = (np.asarray(x) for x in (blocks.first, blocks.last, blocks.real))
    cells: list[tuple[tuple[str, str, float], list[int]]] = []
    rows: list[np.ndarray] = []
    for k, trial in enumerate(trials):
        middle = np.where(real[k], 0.5 * (first[k] + last[k]), np.inf)
        for phases in _pooled(trial.phases):
            inside, places = _places(middle, phases)
            count = min(_ORDERS, inside.size // _FEWEST)
            if not count:
                continue
            begin = len(rows)
            for place in places:
                for order in range(count if place is places[0] else min(_CYCLE_ORDERS, count)):
                    curve = np.zeros(real.shape)
                    skip = 0 if place is places[0] else 1  # the level is in already
                    curve[k, inside] = legendre.legval(place, np.eye(_ORDERS)[order + skip])
                    rows.append(curve)
            cell = (trial.name, phases[0].kind, phases[0].start)
            cells.append((cell, list(range(begin, len(rows)))))
    return cells, np.array(rows)


def _pooled(phases: Sequence[Phase]) -> list[list[Phase]]:
    """Phases by themselves; those of many cycles together, by kind."""
    kinds = {phase.kind: [p for p in phases if p.kind == phase.kind] for phase in phases}
    found: list[list[Phase]] = []
    for same in kinds.values():
        found += [same] if len(same) > _MOST_APART else [[phase] for phase in same]
    return sorted(found, key=lambda same: same[0].start)


def _places(
    middle: np.ndarray, phases: Sequence[Phase]
) -> tuple[NDArray[np.intp], list[np.ndarray]]:
    """Blocks inside, their places (-1 to 1) in their phase and, of many, among the cycles."""
    parts = [np.flatnonzero((middle > p.start) & (middle <= p.stop)) for p in phases]
    parts = [part for part in parts if part.size]
    if not parts:
        return np.zeros(0, dtype=np.intp), [np.zeros(0)]
    places = [_spread(part.size) for part in parts]
    if len(parts) == 1:
        return parts[0], places
    cycle = np.repeat(_spread(len(parts)), [part.size for part in parts])
    return np.concatenate(parts), [np.concatenate(places), cycle]


def _spread(size: int) -> np.ndarray:
    return np.linspace(-1.0, 1.0, size) if size > 1 else np.zeros(1)


def _p_value(score: np.ndarray, spread: np.ndarray, freedom: float) -> tuple[float, int]:
    """Of some curves' statistic, and how many of them the constants leave."""
    statistic, rank = _quadratic(score, spread)
    return (float(fisher.sf(statistic / rank, rank, freedom)) if rank else 1.0), rank


def _quadratic(score: np.ndarray, spread: np.ndarray) -> tuple[float, int]:
    """s^T V^-1 s over the directions that the constants leave, and how many those are."""
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    values, vectors = np.linalg.eigh(spread / np.outer(scale, scale))
    kept = values > 1e-6
    part = (vectors.T @ (score / scale))[kept]
    return float(np.sum(part**2 / values[kept])), int(kept.sum())
