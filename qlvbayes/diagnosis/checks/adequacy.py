r"""The adequacy test: whether a model leaves structure in any cell, which is a phase of a test.

The noise was measured without the model. Under a right model the residual r is noise of covariance
Sigma, minus the part that the fitted constants take. In each cell four smooth curves B (Legendre
polynomials of order 0 to 3 over the cell's blocks) are tried. The phases of many cycles form one
cell, whose curves repeat from cycle to cycle and may drift from one to the next. With the
sensitivities J of the fitted constants, A = J^T Sigma^{-1} J,

.. math:: T = s^T V^{-1} s, \quad
          s = B^T \Sigma^{-1} (r - J A^{-1} J^T \Sigma^{-1} r), \quad
          V = B^T \Sigma^{-1} B - B^T \Sigma^{-1} J A^{-1} J^T \Sigma^{-1} B

is chi^2 with as many degrees of freedom as curves, in each cell (the worst one's p-value p_1 is
corrected for their number by Sidak) and over all cells' curves together (p_a, which sees structure
that is spread thinly). The smaller of both counts:

.. math:: p = 1 - (1 - \min(p_1, p_a))^2.

Sigma is that of the noise floor, which no structure inflates. The floor is uncertain: p is averaged
over draws of it given the dwells alone. This is a posterior predictive p-value; where only the sd
is uncertain, the mean is exactly that of the F test. Errors of the motion count as noise where the
platen moves. Without any dwell it cannot be measured whether noise is correlated, and structure
that looks like correlated noise is *not testable*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.stats import chi2

from qlvbayes.diagnosis.settings import CellTests, DiagnosisSettings
from qlvbayes.inference.density import Point
from qlvbayes.inference.errors.whitening import covariance, stage_changes
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.phases import Phase
from qlvbayes.motion.record import Blocks, Record


@dataclass(frozen=True)
class CellTest:
    """The test of one cell."""

    test: str
    phase: str
    start: float  # begin of the phase (s)
    p_value: float  # p-value of the statistic of its curves


@dataclass(frozen=True)
class Adequacy:
    """The adequacy of one hypothesis."""

    cells: tuple[CellTest, ...]
    p_value: float  # p-value of the whole test, p
    testable: bool = True  # whether a dwell shows if noise is correlated

    def is_sound(self, settings: DiagnosisSettings) -> bool:
        """Return whether chance explains all structure that is left."""
        return self.p_value >= settings.false_alarms


def adequacy(experiment: Experiment, record: Record, point: Point, tests: CellTests) -> Adequacy:
    """Test whether a hypothesis, fitted to block means (T, B), leaves structure in any phase."""
    residual = np.asarray(record.blocks.force) - point.predicted
    cells, curves = cell_curves(experiment.trials, record.blocks, tests)
    sizes = np.abs(point.responses).max(axis=(1, 2))
    slopes = np.concatenate([point.responses[(sizes > 0.0) & np.isfinite(sizes)], point.scattered])
    shared = stage_changes(experiment.trials, record.blocks)
    vectors = np.concatenate([residual[None], slopes, curves, shared])
    peak = experiment.scales.force
    blocks = _by_test(record.blocks)
    floor = experiment.floor
    floors, weights = floor.weighted(tests.draws if floor.is_sure else tests.doubtful)
    p_values = []
    for one in floors:
        products = _with_common(_products(one, blocks, vectors, peak), len(shared))
        p_values.append(_p_values(products, len(slopes), [rows for _, rows in cells]))
    cell_ps = np.average([ps for ps, _ in p_values], axis=0, weights=weights)
    whole = np.average([p for _, p in p_values], axis=0, weights=weights)
    tested = tuple(CellTest(*cell, float(p)) for (cell, _), p in zip(cells, cell_ps, strict=True))
    return Adequacy(tested, float(whole), floor.testable)


def combined(worst: float, cells: int, joint: float) -> float:
    """Return the p-value of the test, from the worst cell's (not corrected) and the joint one."""
    one = -np.expm1(cells * np.log1p(-min(worst, 1.0 - 1e-16)))
    least = min(float(one), joint)
    return float(least * (2.0 - least))


def _p_values(
    products: np.ndarray, slopes: int, cells: list[list[int]]
) -> tuple[np.ndarray, float]:
    """Return the p-values of each cell, and of the whole test."""
    J, B = slice(1, 1 + slopes), slice(1 + slopes, None)
    information = products[J, J]
    ridge = 1e-9 * np.maximum(np.diag(information), 1e-3)
    taken = np.linalg.solve(information + np.diag(ridge), products[J])
    left = products[B] - products[B, J] @ taken
    score, spread = left[:, 0], left[:, B]
    ps = np.array([_p_value(score[rows], spread[np.ix_(rows, rows)]) for rows in cells])
    joint = _p_value(score, spread)
    return ps, combined(float(ps.min()), ps.size, joint)


def _by_test(blocks: Blocks) -> list[tuple[np.ndarray, Blocks]]:
    """Return for each test which of its blocks (B,) are no padding, and these blocks."""
    arrays = jax.tree.map(np.asarray, blocks)
    return [
        (real, jax.tree.map(lambda x, k=k, real=real: x[k][real], arrays))
        for k, real in enumerate(arrays.real)
    ]


def _products(
    floor: NoiseFloor, tests: list[tuple[np.ndarray, Blocks]], vectors: np.ndarray, peak: float
) -> np.ndarray:
    """Return the products v^T Sigma^-1 w (M, M) of vectors (M, T, B) under a noise floor."""
    total = np.zeros((len(vectors), len(vectors)))
    for k, (real, of_test) in enumerate(tests):
        some = np.flatnonzero(np.any(vectors[:, k, real] != 0.0, axis=1))
        root = cholesky(covariance(floor, of_test, peak), lower=True, check_finite=False)
        white = solve_triangular(root, vectors[some, k][:, real].T, lower=True, check_finite=False)
        total[np.ix_(some, some)] += white.T @ white
    return total


def _with_common(products: np.ndarray, count: int) -> np.ndarray:
    """Return the products under noise to which the last ``count`` vectors are added as errors."""
    rest = len(products) - count
    known = products[rest:]
    taken = np.linalg.solve(np.eye(count) + known[:, rest:], known[:, :rest])
    return np.asarray(products[:rest, :rest] - known[:, :rest].T @ taken)


def cell_curves(
    trials: Sequence[Trial], blocks: Blocks, tests: CellTests
) -> tuple[list[tuple[tuple[str, str, float], list[int]]], np.ndarray]:
    """Return the cells and the smooth curves (M, T, B) that are tried in them."""
    first, last, real = (np.asarray(x) for x in (blocks.first, blocks.last, blocks.real))
    cells: list[tuple[tuple[str, str, float], list[int]]] = []
    rows: list[np.ndarray] = []
    for k, trial in enumerate(trials):
        middle = np.where(real[k], 0.5 * (first[k] + last[k]), np.inf)
        for phases in _pooled(trial.phases, tests.apart):
            inside, positions = _positions(middle, phases)
            count = min(tests.curves, inside.size // tests.blocks)
            if not count:
                continue
            begin = len(rows)
            for position in positions:
                is_first = position is positions[0]
                for order in range(count if is_first else min(tests.drifts, count)):
                    curve = np.zeros(real.shape)
                    skip = 0 if is_first else 1  # the first position has the constant already
                    coefficients = np.eye(tests.curves)[order + skip]
                    curve[k, inside] = legendre.legval(position, coefficients)
                    rows.append(curve)
            cell = (trial.name, phases[0].kind, phases[0].start)
            cells.append((cell, list(range(begin, len(rows)))))
    return cells, np.array(rows)


def _pooled(phases: Sequence[Phase], apart: int) -> list[list[Phase]]:
    """Return the phases that form each cell: one phase, or all of one kind in many cycles."""
    kinds = {phase.kind: [p for p in phases if p.kind == phase.kind] for phase in phases}
    cells: list[list[Phase]] = []
    for same in kinds.values():
        cells += [same] if len(same) > apart else [[phase] for phase in same]
    return sorted(cells, key=lambda same: same[0].start)


def _positions(
    middle: np.ndarray, phases: Sequence[Phase]
) -> tuple[NDArray[np.intp], list[np.ndarray]]:
    """Return the blocks inside a cell, and their positions (-1 to 1) within it."""
    parts = [np.flatnonzero((middle > p.start) & (middle <= p.stop)) for p in phases]
    parts = [part for part in parts if part.size]
    if not parts:
        return np.zeros(0, dtype=np.intp), [np.zeros(0)]
    positions = [_evenly_spaced(part.size) for part in parts]
    if len(parts) == 1:
        return parts[0], positions
    cycle = np.repeat(_evenly_spaced(len(parts)), [part.size for part in parts])
    return np.concatenate(parts), [np.concatenate(positions), cycle]


def _evenly_spaced(size: int) -> np.ndarray:
    """Return points (size,) from -1 to 1; a single point lies at 0."""
    return np.linspace(-1.0, 1.0, size) if size > 1 else np.zeros(1)


def _p_value(score: np.ndarray, spread: np.ndarray) -> float:
    """Return the p-value of some curves' statistic; 1 where the constants take all of them."""
    statistic, rank = _quadratic(score, spread)
    return float(chi2.sf(statistic, rank)) if rank else 1.0


def _quadratic(score: np.ndarray, spread: np.ndarray) -> tuple[float, int]:
    """Return s^T V^-1 s over the directions that the constants leave, and their number."""
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    values, vectors = np.linalg.eigh(spread / np.outer(scale, scale))
    kept = values > 1e-6
    part = (vectors.T @ (score / scale))[kept]
    return float(np.sum(part**2 / values[kept])), int(kept.sum())
