"""Fit the constants by least squares from many starts, by the paper's two routes.

In one step (Eq. 9), all constants come from the ramp and the hold of one test together. In two
steps, m and b come from the fastest ramp taken as purely elastic, then the relaxation from the
hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import OptimizeResult
from scipy.optimize import least_squares as minimise

from qlvbayes.fitting.marginal_likelihood import has_uncertain_zeros, with_zero_errors
from qlvbayes.fitting.posterior import Predictor
from qlvbayes.inference.errors.whitening import stage_changes
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.io.wording import joined, plain
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.parameters import draw_priors
from qlvbayes.motion.experiment import Experiment, Trial

LARGEST_SD = 3.0  # natural lengths: of a direction that the data do not determine
_PRIOR_DRAWS = 96
_STARTS = 8  # draws of the priors, those nearest to the data, that are descended from
_BOUND_SDS = 5.0
_LINEAR = 4.0  # times the predicted rise of the sum of squares that a draw may have
_HALVINGS = 12  # of a draw's step: to 1/4000 of a prior's width
_TOGETHER = 256  # draws whose residuals are held together
_LITTLE = 1.0 / 3.0  # of a test from its first ramp on: less is said to be little
_AGREEMENT = 1.001  # starts within 0.1 % of the best cost count as agreeing


@dataclass(frozen=True)
class NormalApproximation:
    """A normal distribution over theta: mean (D,) and covariance (D, D)."""

    mean: np.ndarray
    covariance: np.ndarray

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Return draws (count, D)."""
        root = np.linalg.cholesky(self.covariance)
        return self.mean + rng.standard_normal((count, self.mean.size)) @ root.T


@dataclass(frozen=True)
class LeastSquares:
    """The optima of several starts, best first: thetas (D,) with their sums of squares."""

    thetas: tuple[np.ndarray, ...]
    costs: tuple[float, ...]

    @property
    def agreeing(self) -> int:
        """Return how many starts led to the best optimum."""
        return sum(cost <= _AGREEMENT * self.costs[0] + 1e-12 for cost in self.costs)


def least_squares(predictor: Predictor, scale: Array, rng: np.random.Generator) -> LeastSquares:
    """Minimise the sum of ((block mean - model)/scale)^2 over the model's free constants."""
    # the optimiser's tolerance on gradients is absolute
    scale = scale * float(np.max(np.abs(predictor.record.blocks.force)))
    own, draws = predictor.parameters, draw_priors(predictor.model, _PRIOR_DRAWS, rng)
    centre, distance = draws.mean(axis=0), _BOUND_SDS * draws.std(axis=0)
    bounds = own.within(centre - distance), own.within(centre + distance)
    draws = np.clip(draws, *bounds)
    sums = sums_of_squares(predictor, scale, draws)
    order = [k for k in np.argsort(sums) if np.isfinite(sums[k])]
    with np.errstate(over="ignore"):  # a sum that overflows is the worst
        optima = [_descend(predictor, scale, draws[k], bounds) for k in order[:_STARTS]]
    if not optima:
        raise NoFiniteForceError
    optima.sort(key=lambda result: result.cost)
    return LeastSquares(tuple(r.x for r in optima), tuple(2.0 * float(r.cost) for r in optima))


def _descend(
    predictor: Predictor, scale: Array, start: Array, bounds: tuple[Array, Array]
) -> OptimizeResult:
    """Return the optimum that a start leads to."""
    inside = np.clip(start, bounds[0] + 1e-9, bounds[1] - 1e-9)

    @lru_cache(maxsize=1)  # the derivatives come with the residuals: the optimiser asks for both
    def both(theta: bytes) -> tuple[Array, Array]:
        return residuals_and_slopes(predictor, scale, np.frombuffer(theta))

    return minimise(
        lambda theta: both(theta.tobytes())[0], inside, jac=lambda theta: both(theta.tobytes())[1],
        bounds=bounds, x_scale="jac", max_nfev=200,
    )  # fmt: skip


def residuals_and_slopes(predictor: Predictor, scale: Array, theta: Array) -> tuple[Array, Array]:
    """Return residuals (n,) of the block means over ``scale``, and their derivatives (n, D)."""
    _, forces, slopes = predictor.space.forces_and_slopes(predictor.hypothesis, theta)
    real = predictor.space.real
    values = ((np.asarray(predictor.record.blocks.force) - forces) / scale)[real]
    return values, -(slopes / scale)[:, real].T


def _optimum(
    predictor: Predictor, scale: Array, rng: np.random.Generator
) -> tuple[NormalApproximation, int]:
    """Return the best optimum with its covariance s^2 (J^T J)^-1, and how many starts led to it."""
    fits = least_squares(predictor, scale, rng)
    theta = fits.thetas[0]
    values, slopes = residuals_and_slopes(predictor, scale, theta)
    variance = float(values @ values) / _freedom(predictor, scale, theta.size)
    curvature = slopes.T @ slopes / max(variance, 1e-300)
    covariance = covariance_from(curvature, predictor.parameters.length)
    return NormalApproximation(theta, covariance), fits.agreeing


def sums_of_squares(predictor: Predictor, scale: Array, thetas: Array) -> Array:
    """Return the sums (K,) of squared residuals over ``scale`` at thetas (K, D)."""
    sums = []
    for k in range(0, len(thetas), _TOGETHER):
        constants = predictor.parameters.constants(thetas[k : k + _TOGETHER])
        with np.errstate(over="ignore", invalid="ignore"):
            some = (predictor.residuals(constants) / scale)[:, predictor.space.real]
            sums.append(np.sum(some**2, axis=1))
    return np.concatenate(sums)


def _freedom(predictor: Predictor, scale: Array, size: int) -> int:
    """Return by how many the block means that count outnumber the parameters, at least 1."""
    return max(int(np.sum(predictor.space.real & np.isfinite(scale))) - size, 1)


def covariance_from(curvature: Array, lengths: Array) -> Array:
    """Return the inverse of a curvature (D, D), with sds of ``LARGEST_SD`` lengths at most."""
    scaled = curvature * np.outer(lengths, lengths)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    limited = np.maximum(values, 1.0 / LARGEST_SD**2)
    return np.asarray((vectors / limited) @ vectors.T * np.outer(lengths, lengths))


@dataclass(frozen=True)
class LeastSquaresFit:
    """The normal approximation over the free constants.

    predictor: the model over the fitted tests; scale: divisors (T, B) of the residuals, infinite
    where none counts; agreeing: how many starts led to the best optimum; moves: changes (S, D) of
    the optimum for one standard error of each of S measured contacts, which no scatter of residuals
    shows.
    """

    predictor: Predictor
    normal: NormalApproximation
    scale: Array
    agreeing: int
    moves: Array

    @property
    def residual_sd(self) -> float:
        """Return the root mean square (N) of the residuals of the fitted block means."""
        counting = np.where(np.isinf(self.scale), np.inf, 1.0)
        values, _ = residuals_and_slopes(self.predictor, counting, self.normal.mean)
        return float(np.sqrt(values @ values / max(int(np.sum(np.isfinite(self.scale))), 1)))

    def draws(self, count: int, rng: np.random.Generator) -> Array:
        """Return draws (count, D) that fit about as well as the normal approximation says."""
        mean, draws = (
            self.normal.mean,
            self.predictor.parameters.within(self.normal.draw(count, rng)),
        )
        values, slopes = residuals_and_slopes(self.predictor, self.scale, mean)
        cost = float(values @ values)
        slack = cost * mean.size / _freedom(self.predictor, self.scale, mean.size)
        for _ in range(_HALVINGS):
            expected = np.sum(((draws - mean) @ slopes.T) ** 2, axis=1)
            sums = sums_of_squares(self.predictor, self.scale, draws)
            far = ~(sums <= cost + slack + _LINEAR * expected)
            if not far.any():
                break
            draws[far] = 0.5 * (draws[far] + mean)
        return draws


def one_step(
    experiment: Experiment, predictor: Predictor, rng: np.random.Generator
) -> LeastSquaresFit:
    """Return the fit that minimises the time integral of squared residuals of ramp and hold."""
    trials = experiment.with_role("fit")
    scale = _scale(predictor, trials, ("ramp", "hold"), weighted=True)
    normal, agreeing = _optimum(predictor, scale, rng)
    moves = contact_moves(predictor, scale, normal.mean, trials)
    return LeastSquaresFit(predictor, normal, scale, agreeing, moves)


def two_step(
    experiment: Experiment, predictor: Predictor, rng: np.random.Generator
) -> LeastSquaresFit:
    """Return the fit of elastic constants to the fastest ramp, then of relaxation to the hold."""
    fastest = max(experiment.trials, key=lambda trial: trial.rate)
    model, noise = predictor.model, predictor.noise
    elastic_alone = replace(model, relaxation=Prony(np.array([1.0, 0.0]), np.array([1.0])))
    ramp = Predictor.from_model(elastic_alone, noise, experiment.record([fastest]))
    ramp_scale = _scale(ramp, [fastest], ("ramp",), weighted=False)
    first, agreeing = _optimum(ramp, ramp_scale, rng)

    elastic = ramp.parameters.model_at(ramp.parameters.constants(first.mean[None])[0]).elastic
    hold = Predictor.from_model(replace(model, elastic=elastic), noise, predictor.record)
    hold_scale = _scale(hold, experiment.with_role("fit"), ("hold",), weighted=True)
    second, also = _optimum(hold, hold_scale, rng)

    mean = np.concatenate([first.mean, second.mean])
    normal = NormalApproximation(mean, block_diag(first.covariance, second.covariance))
    moves = np.zeros((0, mean.size))
    return LeastSquaresFit(predictor, normal, hold_scale, min(agreeing, also), moves)


def contact_moves(
    predictor: Predictor, scale: Array, theta: Array, trials: Sequence[Trial]
) -> Array:
    r"""Return what one standard error of each of S contacts moves an optimum by, (S, D).

    With the derivatives J (n, D) of the residuals, and the change u of the predicted block means
    over the same ``scale``, the move is :math:`(J^T J)^{-1} J^T u`, to first order.
    """
    own = predictor.parameters
    model = own.model_at(own.constants(theta[None])[0])
    if not has_uncertain_zeros(model, trials):
        return np.zeros((0, theta.size))
    blocks = with_zero_errors(predictor.record, trials, model).blocks
    tests = np.eye(len(trials))[:, :, None]
    zero, tare = np.asarray(blocks.zero), np.asarray(blocks.tare)
    changes = np.concatenate([tests * zero, tests * tare, stage_changes(trials, blocks)])
    scaled = (changes / scale)[:, predictor.space.real]
    _, slopes = residuals_and_slopes(predictor, scale, theta)
    return np.asarray(np.linalg.lstsq(slopes, scaled[scaled.any(axis=1)].T)[0].T)


def _span(trial: Trial, kinds: tuple[str, ...]) -> tuple[float, float]:
    """Return beginning and end (s) of the first ramp and its hold, or of one of these."""
    phases = trial.used_phases
    first = next((k for k, phase in enumerate(phases) if phase.kind == "ramp"), 0)
    chosen = [p for p in phases[first : first + 2] if p.kind in kinds] or phases
    return chosen[0].start, chosen[-1].stop


def part_notice(experiment: Experiment, method: str) -> tuple[str, ...]:
    """Return a sentence on the tests of which a route uses a small part only."""
    spans = ((trial, _span(trial, ("ramp", "hold"))) for trial in experiment.with_role("fit"))
    parts = [
        f"{plain(start)} to {plain(stop)} s of test {trial.name}, which ends at "
        f"{plain(trial.used_phases[-1].stop)} s"
        for trial, (start, stop) in spans
        if stop - start < _LITTLE * (trial.used_phases[-1].stop - start)
    ]
    if not parts:
        return ()
    return (
        f"pad {experiment.pad}: {method} uses only the first ramp and what follows at once, which "
        f"is {joined(parts)}; --method emcee uses whole tests",
    )


def _scale(
    predictor: Predictor, trials: Sequence[Trial], kinds: tuple[str, ...], *, weighted: bool
) -> Array:
    """Return the divisors (T, B) of residuals, which are infinite outside the trials' spans."""
    blocks = predictor.record.blocks
    first, last, count = (np.asarray(x) for x in (blocks.first, blocks.last, blocks.count))
    middle = 0.5 * (first + last)
    low, high = np.array([_span(trial, kinds) for trial in trials]).T[:, :, None]
    weight = count
    if weighted:
        edges = np.concatenate([first, last[:, -1:]], axis=1)
        weight = np.maximum(np.diff(edges, axis=1), 1e-9)
    inside = (middle >= low) & (middle <= high) & np.asarray(blocks.real)
    weight = weight / np.mean(weight[inside])
    return np.where(inside, 1.0 / np.sqrt(weight), np.inf)
