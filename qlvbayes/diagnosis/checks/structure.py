"""The structure that a model leaves in the phases of the tests: whether there is any, how large."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import jax
import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.special import ndtri
from scipy.stats import chi2

from qlvbayes.diagnosis.checks.samples import Samples, rmse
from qlvbayes.diagnosis.result import RemainingStructure
from qlvbayes.diagnosis.settings import CellTests, DiagnosisSettings
from qlvbayes.inference.density import Point
from qlvbayes.inference.errors.whitening import covariance, stage_changes
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.phases import Phase
from qlvbayes.motion.record import Blocks, Record

_RIDGE = 1e-9  # of a variance: lets a covariance without a white part be factorised


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
    r"""Test whether a hypothesis, fitted to block means (T, B), leaves structure in any phase.

    The noise was measured without the model. Under a right model the residual r is noise of
    covariance Sigma, minus the part that the fitted constants take. In each cell, which is a phase
    of a test, four smooth curves B (Legendre polynomials of order 0 to 3 over the cell's blocks)
    are tried. The phases of many cycles form one cell, whose curves repeat from cycle to cycle and
    may drift from one to the next. With the sensitivities J of the fitted constants,
    A = J^T Sigma^{-1} J,

    .. math:: T = s^T V^{-1} s, \quad
              s = B^T \Sigma^{-1} (r - J A^{-1} J^T \Sigma^{-1} r), \quad
              V = B^T \Sigma^{-1} B - B^T \Sigma^{-1} J A^{-1} J^T \Sigma^{-1} B

    is chi^2 with as many degrees of freedom as curves, in each cell (the worst one's p-value p_1 is
    corrected for their number by Sidak) and over all cells' curves together (p_a, which sees
    structure that is spread thinly). The smaller of both counts:

    .. math:: p = 1 - (1 - \min(p_1, p_a))^2.

    Sigma is that of the noise floor, which no structure inflates. The floor is uncertain: p is
    averaged over draws of it given the dwells alone. This is a posterior predictive p-value; where
    only the sd is uncertain, the mean is exactly that of the F test. Errors of the motion count as
    noise where the platen moves. Without any dwell it cannot be measured whether noise is
    correlated, and structure that looks like correlated noise is *not testable*.
    """
    residual = np.asarray(record.blocks.force) - point.predicted
    cells, curves = _cell_curves(experiment.trials, record.blocks, tests)
    sizes = np.abs(point.responses).max(axis=(1, 2))
    slopes = np.concatenate([point.responses[(sizes > 0.0) & np.isfinite(sizes)], point.scattered])
    shared = stage_changes(experiment.trials, record.blocks)
    vectors = np.concatenate([residual[None], slopes, curves, shared])
    floor, blocks = experiment.floor, jax.tree.map(np.asarray, record.blocks)
    floors, weights = floor.weighted(tests.draws if floor.is_sure else tests.doubtful)
    p_values = []
    for one in floors:
        products = _products(one, blocks, vectors, experiment.scales.force)
        products = _with_common(products, len(shared))
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
    return ps, combined(float(ps.min()), ps.size, _p_value(score, spread))


def _p_value(score: np.ndarray, spread: np.ndarray) -> float:
    """Return the p-value of s^T V^-1 s over the directions that the constants leave; 1 of none."""
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    values, vectors = np.linalg.eigh(spread / np.outer(scale, scale))
    kept = values > 1e-6
    if not kept.any():
        return 1.0
    part = (vectors.T @ (score / scale))[kept]
    return float(chi2.sf(np.sum(part**2 / values[kept]), kept.sum()))


def _products(floor: NoiseFloor, blocks: Blocks, vectors: np.ndarray, peak: float) -> np.ndarray:
    """Return the products v^T Sigma^-1 w (M, M) of vectors (M, T, B) under a noise floor."""
    total = np.zeros((len(vectors), len(vectors)))
    for k, real in enumerate(blocks.real):
        own: Blocks = jax.tree.map(lambda x, k=k, real=real: x[k][real], blocks)
        some = np.flatnonzero(np.any(vectors[:, k, real] != 0.0, axis=1))
        root = cholesky(covariance(floor, own, peak), lower=True, check_finite=False)
        white = solve_triangular(root, vectors[some, k][:, real].T, lower=True, check_finite=False)
        total[np.ix_(some, some)] += white.T @ white
    return total


def _with_common(products: np.ndarray, count: int) -> np.ndarray:
    """Return the products under noise to which the last ``count`` vectors are added as errors."""
    rest = len(products) - count
    known = products[rest:]
    taken = np.linalg.solve(np.eye(count) + known[:, rest:], known[:, :rest])
    return np.asarray(products[:rest, :rest] - known[:, :rest].T @ taken)


def _cell_curves(
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
            orders = [(positions[0], order) for order in range(count)]
            # of the drift from cycle to cycle; the first position has the constant already
            orders += [(x, 1 + n) for x in positions[1:] for n in range(min(tests.drifts, count))]
            begin = len(rows)
            for position, order in orders:
                curve = np.zeros(real.shape)
                curve[k, inside] = legendre.legval(position, np.eye(tests.curves)[order])
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
    """Return the blocks inside a cell, and their positions (-1 to 1) in a phase and in all."""
    parts = [np.flatnonzero((middle > p.start) & (middle <= p.stop)) for p in phases]
    parts = [part for part in parts if part.size]
    if not parts:
        return np.zeros(0, dtype=np.intp), []
    positions = [np.concatenate([_evenly_spaced(part.size) for part in parts])]
    if len(parts) > 1:
        positions.append(np.repeat(_evenly_spaced(len(parts)), [part.size for part in parts]))
    return np.concatenate(parts), positions


def _evenly_spaced(size: int) -> np.ndarray:
    """Return points (size,) from -1 to 1; a single point lies at 0."""
    return np.linspace(-1.0, 1.0, size) if size > 1 else np.zeros(1)


@dataclass(frozen=True)
class StructuredPart:
    """The structured part of the residual in one cell."""

    test: str
    phase: str
    start: float  # begin of the phase (s)
    n: int
    # rms, upper: root mean square (N), and its upper bound at 95 %
    rms: float
    upper: float
    bias: float  # mean of the fitted curve (N)
    shown: bool  # whether the cell stands out in the adequacy test


@dataclass(frozen=True)
class Remainder:
    """The structure that a model leaves, and whether all of it is below the tolerance."""

    small: bool
    record: RemainingStructure | None  # for ``diagnosis.json``; None without cells


def remainder(
    samples: Samples,
    residuals: Sequence[np.ndarray],
    tested: Adequacy,
    baseline: Sequence[np.ndarray],
    settings: DiagnosisSettings,
) -> Remainder:
    r"""Return the size of the structure in residuals, measured minus predicted force (N).

    The adequacy test says whether structure is certain, not whether it matters. In a cell of n
    samples with residual r and the noise at rest, covariance Sigma, the smooth curves B (rows:
    Legendre polynomials of order 0 to 3) are fitted by generalised least squares,

    .. math:: \hat\beta = C B \Sigma^{-1} r, \quad C = (B \Sigma^{-1} B^T)^{-1}, \quad
              Q = \hat\beta^T M \hat\beta, \quad M = B B^T / n

    Q is the mean square of the fitted curve; in combinations of curves whose noise is independent
    and of unit variance it is a sum of mu_k z_k^2 (mu the eigenvalues of MC), of which noise alone
    would make mu_k each. The structured part has the mean square

    .. math:: s^2 = \max\left(\sum_k \mu_k (z_k^2 - 1), 0\right)

    For its upper bound, combinations that stand out (abs(z) above 1.96) are taken to be 1.645 sds
    larger. The others count by what they hold beyond noise, as nothing certain is there to be
    bounded:

    .. math:: s_u^2 = \sum_k \mu_k u_k^2, \quad u_k = |z_k| + 1.645 \text{ or }
              u_k^2 = \max(z_k^2 - 1, 0)

    The remainder is small if this bound is below the tolerance, a share of the peak force, in every
    cell that stands out (p of the adequacy test below 5 %), and if the error over all samples
    exceeds the noise by less than the tolerance. The latter sees what no smooth curve shows.
    """
    noise = rmse([samples.floor(k) for k in range(len(samples.trials))])
    excess = float(np.sqrt(max(rmse(residuals) ** 2 - noise**2, 0.0)))
    own, before = (tuple(_cells(samples, some, tested, settings)) for some in (residuals, baseline))
    peak, sure = samples.experiment.scales.force, not tested.is_sound(settings)
    return sized(own, overall(before), excess, peak, settings.tolerance, sure=sure)


def sized(
    cells: Sequence[StructuredPart],
    before: float,
    excess: float,
    peak: float,
    tolerance: float,
    *,
    sure: bool = False,
) -> Remainder:
    """Return the remainder of cells, where the baseline model's structured part is ``before``."""
    shown = [cell for cell in cells if cell.shown]
    largest = max((cell.upper for cell in shown), default=0.0)
    small = 0.0 < tolerance * peak >= max(largest, excess)
    worst = max(shown or cells, key=lambda cell: cell.rms, default=None)
    if worst is None:
        return Remainder(small, None)
    record = RemainingStructure(
        rms=worst.rms,
        upper95=worst.upper,
        share_of_peak=worst.rms / peak,
        share_of_error=overall(cells) / before if before > 0.0 else None,
        test=worst.test,
        phase=worst.phase,
        bias=worst.bias,
        excess=excess,
        sure=sure,
        small=small,
    )
    return Remainder(small, record)


def overall(cells: Sequence[StructuredPart]) -> float:
    """Return the root mean square of the structured part over the samples of all cells (N)."""
    count = sum(cell.n for cell in cells)
    return float(np.sqrt(sum(c.n * c.rms**2 for c in cells) / count)) if count else 0.0


def _cells(
    samples: Samples, residuals: Sequence[np.ndarray], tested: Adequacy, settings: DiagnosisSettings
) -> Iterator[StructuredPart]:
    """Yield the structured part of residuals (N) in each phase of each test."""
    shown = {(c.test, c.phase, c.start): c.p_value < settings.cells.level for c in tested.cells}
    for k, trial in enumerate(samples.trials):
        time, weights = trial.test.time[samples.rows[k]], samples.weights[k]
        for phase in trial.phases:
            here = (time > phase.start) & (time <= phase.stop)
            count = min(settings.cells.curves, int(here.sum()) // settings.cells.blocks)
            if not count:
                continue
            cell = (trial.name, phase.kind, phase.start)
            noise = _covariance(samples.experiment.floor, time[here], weights[here])
            size = structured(residuals[k][here], noise, count, settings.cells.level)
            yield StructuredPart(*cell, int(here.sum()), *size, shown.get(cell, False))


def _covariance(floor: NoiseFloor, time: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the covariance (n, n) of white and correlated noise at rest (N^2)."""
    apart = np.abs(time[:, None] - time) / floor.tau
    variance = (floor.white * weights) ** 2 + _RIDGE * (floor.white**2 + floor.ou**2)
    return floor.ou**2 * np.exp(-apart) + np.diag(variance)


def structured(
    residual: np.ndarray, covariance: np.ndarray, orders: int, level: float
) -> tuple[float, float, float]:
    """Return root mean square, upper bound and mean of a residual's structured part (N)."""
    positions = np.linspace(-1.0, 1.0, residual.size)
    curves = legendre.legvander(positions, orders - 1).T
    weighted = cho_solve(cho_factor(covariance), curves.T).T
    root = np.linalg.inv(np.linalg.cholesky(weighted @ curves.T)).T
    means, turned = np.linalg.eigh(root.T @ (curves @ curves.T) @ root / residual.size)
    z = turned.T @ root.T @ weighted @ residual
    beyond = means * (z**2 - 1.0)
    far, more = ndtri(1.0 - 0.5 * level), ndtri(1.0 - level)
    bound = np.where(np.abs(z) > far, means * (np.abs(z) + more) ** 2, beyond)
    rms, upper = (np.sqrt(max(np.sum(x), 0.0)) for x in (beyond, np.maximum(bound, 0.0)))
    return float(rms), float(upper), float(np.mean((root @ turned @ z) @ curves))
