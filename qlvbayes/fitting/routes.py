"""Fit the constants by the paper's two least-squares routes.

In one step (Eq. 9), all constants come from the ramp and the hold of one test together. In two
steps, m and b come from the fastest ramp taken as purely elastic, then the relaxation from the
hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from qlvbayes.fitting.least_squares import (
    NormalApproximation,
    least_squares,
    normal_approximation,
    residuals_and_slopes,
)
from qlvbayes.fitting.marginal_likelihood import has_uncertain_zeros, with_zero_errors
from qlvbayes.fitting.posterior import Predictor
from qlvbayes.inference.common_errors import stage_changes
from qlvbayes.io.arrays import Array
from qlvbayes.io.wording import joined, plain
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.motion.experiment import Experiment, Trial

_LITTLE = 1.0 / 3.0  # of a test from its first ramp on: less is said to be little
_AGREEMENT = 1.001  # starts within 0.1 % of the best cost count as agreeing


@dataclass(frozen=True)
class LeastSquaresFit:
    """The normal approximation over the free constants.

    scale: divisors (T, B) of the residuals, infinite where none counts; residual_sd: root mean
    square of the block means' residuals (N); agreeing: how many starts led to the best optimum;
    moves: changes (S, D) of the optimum for one standard error of each of S measured contacts,
    which no scatter of residuals shows.
    """

    normal: NormalApproximation
    scale: Array
    residual_sd: float
    agreeing: int
    moves: Array


def one_step(
    experiment: Experiment, predictor: Predictor, rng: np.random.Generator
) -> LeastSquaresFit:
    """Return the fit that minimises the time integral of squared residuals of ramp and hold."""
    trials = experiment.with_role("fit")
    scale = _scale(predictor, [_span(trial, ("ramp", "hold")) for trial in trials], weighted=True)
    fits = least_squares(predictor, scale, rng)
    normal, _ = normal_approximation(predictor, scale, fits.thetas[0])
    moves = contact_moves(predictor, scale, normal.mean, trials)
    return _finished(predictor, scale, normal, _agreeing(fits.costs), moves)


def two_step(
    experiment: Experiment, predictor: Predictor, rng: np.random.Generator
) -> LeastSquaresFit:
    """Return the fit of elastic constants to the fastest ramp, then of relaxation to the hold."""
    fastest = max(experiment.trials, key=lambda trial: trial.rate)
    model, noise = predictor.model, predictor.noise
    elastic_alone = replace(model, relaxation=Prony(np.array([1.0, 0.0]), np.array([1.0])))
    ramp = Predictor.from_model(elastic_alone, noise, experiment.record([fastest]))
    ramp_scale = _scale(ramp, [_span(fastest, ("ramp",))], weighted=False)
    ramp_fits = least_squares(ramp, ramp_scale, rng)
    first, _ = normal_approximation(ramp, ramp_scale, ramp_fits.thetas[0])

    elastic = ramp.parameters.model_at(ramp.parameters.constants(first.mean[None])[0]).elastic
    hold = Predictor.from_model(replace(model, elastic=elastic), noise, predictor.record)
    trials = experiment.with_role("fit")
    hold_scale = _scale(hold, [_span(trial, ("hold",)) for trial in trials], weighted=True)
    hold_fits = least_squares(hold, hold_scale, rng)
    second, _ = normal_approximation(hold, hold_scale, hold_fits.thetas[0])

    mean = np.concatenate([first.mean, second.mean])
    normal = NormalApproximation(mean, block_diag(first.covariance, second.covariance))
    agreeing = min(_agreeing(ramp_fits.costs), _agreeing(hold_fits.costs))
    return _finished(predictor, hold_scale, normal, agreeing, np.zeros((0, mean.size)))


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
    of_tests = np.eye(len(trials))[:, :, None] * np.asarray(blocks.zero)
    changes = np.concatenate([of_tests, stage_changes(trials, blocks)])
    scaled = (changes / scale)[:, predictor.space.real]
    _, slopes = residuals_and_slopes(predictor, scale, theta)
    return np.asarray(np.linalg.lstsq(slopes, scaled[scaled.any(axis=1)].T)[0].T)


def _span(trial: Trial, kinds: tuple[str, ...]) -> tuple[float, float]:
    """Return beginning and end (s) of the first ramp and its hold, or of one of these."""
    phases = trial.used_phases
    ramps = [k for k, phase in enumerate(phases) if phase.kind == "ramp"]
    first = ramps[0] if ramps else 0
    chosen = [p for p in phases[first : first + 2] if p.kind in kinds]
    chosen = chosen or list(phases)
    return chosen[0].start, chosen[-1].stop


def part_notice(experiment: Experiment, method: str) -> tuple[str, ...]:
    """Return a sentence on the tests of which a route uses a small part only."""
    spans = [(trial, _span(trial, ("ramp", "hold"))) for trial in experiment.with_role("fit")]
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


def _scale(predictor: Predictor, spans: list[tuple[float, float]], *, weighted: bool) -> Array:
    """Return the divisors (T, B) of residuals, which are infinite outside the spans."""
    blocks = predictor.record.blocks
    first, last, count = (np.asarray(x) for x in (blocks.first, blocks.last, blocks.count))
    middle = 0.5 * (first + last)
    low, high = (np.array(x)[:, None] for x in zip(*spans, strict=True))
    weight = count
    if weighted:
        edges = np.concatenate([first, last[:, -1:]], axis=1)
        weight = np.maximum(np.diff(edges, axis=1), 1e-9)
    inside = (middle >= low) & (middle <= high) & np.asarray(blocks.real)
    weight = weight / np.mean(weight[inside])
    return np.where(inside, 1.0 / np.sqrt(weight), np.inf)


def _agreeing(costs: tuple[float, ...]) -> int:
    """Return how many costs are as low as the first one."""
    return sum(cost <= _AGREEMENT * costs[0] + 1e-12 for cost in costs)


def _finished(
    predictor: Predictor, scale: Array, normal: NormalApproximation, agreeing: int, moves: Array
) -> LeastSquaresFit:
    """Return the fit with the root mean square of its residuals over the fitted blocks."""
    counting = np.where(np.isinf(scale), np.inf, 1.0)
    values, _ = residuals_and_slopes(predictor, counting, normal.mean)
    count = max(int(np.sum(np.isfinite(scale))), 1)
    sd = float(np.sqrt(values @ values / count))
    return LeastSquaresFit(normal, scale, sd, agreeing, moves)
