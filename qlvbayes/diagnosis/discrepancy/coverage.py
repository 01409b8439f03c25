"""How many samples of left-out tests lie within their predictive intervals."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from scipy.stats import norm, t

from qlvbayes.diagnosis.discrepancy.band import band_of
from qlvbayes.diagnosis.discrepancy.points import residuals_of, without_test
from qlvbayes.diagnosis.discrepancy.process import fit_scales
from qlvbayes.diagnosis.verdict import Work
from qlvbayes.inference import compiled
from qlvbayes.inference.gaussnewton import Point, climb

_SHARE = 0.9  # of the predictive intervals
_CLIMB = 12  # steps of the model's refit
_DRAWS = 16  # of the constants


@dataclass(frozen=True)
class HeldOutCoverage:
    """Share of each left-out test's samples within their 90 % predictive intervals.

    without: of the model with the noise floor; fitted: of the model with the noise as fitted, which
    may have swollen; honest: with the discrepancy and the noise floor.
    """

    without: tuple[float, ...]
    fitted: tuple[float, ...]
    honest: tuple[float, ...]


def held_out_coverage(work: Work, point: Point, log_scales: np.ndarray) -> HeldOutCoverage:
    """Model and process refitted with each test left out in turn, from the fit to all."""
    shares = [_left_out(work, point, log_scales, k) for k in range(len(work.samples.trials))]
    return HeldOutCoverage(*zip(*shares, strict=True))


def _left_out(work: Work, whole: Point, log_scales: np.ndarray, k: int) -> tuple[float, ...]:
    """Coverages of test k, model and process fitted to the others."""
    samples = work.samples
    others = 1.0 - np.eye(len(samples.trials))[k]
    if not others.any():  # one test stands for itself
        others = np.ones(1)
    point = climb(work.ensemble, whole.subset, whole.theta, others, _CLIMB)
    force, model_sd = _spread(work, point, k)
    residuals = residuals_of(work, point)
    residuals = residuals if others[k] else without_test(residuals, k)
    band = band_of(work, residuals, fit_scales(residuals, log_scales), k, force)
    error = samples.trials[k].test.force[samples.rows[k]] - force
    floor, noise = _noise_sds(work, point, k)
    wide = float(norm.ppf(0.5 + 0.5 * _SHARE))
    # the size of a test's own function is known from as many tests only
    wider = float(t.ppf(0.5 + 0.5 * _SHARE, max(others.sum() - 1.0, 1.0)))
    without = wide * np.hypot(floor, model_sd)
    return (
        _covered(error, without),
        _covered(error, wide * np.hypot(noise, model_sd)),
        _covered(error - band.mean, np.hypot(without, wider * band.sd)),
    )


def _noise_sds(work: Work, point: Point, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Sds (n,) of trial k's samples by the floor and by the fitted noise (N)."""
    samples, floor = work.samples, work.experiment.floor
    weight = np.asarray(samples.record.blocks.weight)[k, : samples.rows[k].size]
    noise = samples.ensemble.posterior.with_constants(jnp.asarray(point.constants))[1]
    return np.hypot(floor.white * weight, floor.ou), np.asarray(
        noise.sample_sd(jnp.asarray(weight))
    )


def _covered(error: np.ndarray, half: np.ndarray) -> float:
    return float(np.mean(np.abs(error) <= half))


def _spread(work: Work, point: Point, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Force (n,) of trial k's samples, and its sd by what the constants leave open."""
    rng = np.random.default_rng(0)
    free = point.subset.theta
    thetas = np.tile(point.theta, (_DRAWS, 1))
    thetas[:, free] = rng.multivariate_normal(point.theta[free], point.covariance, _DRAWS)
    drawn = compiled.constants(work.ensemble.posterior, jnp.asarray(thetas))
    constants = point.subset.nulled(np.asarray(drawn))
    found = work.samples.predict(np.concatenate([point.constants[None], constants]))
    forces = np.stack([force[k] for force in found])
    return forces[0], forces[1:].std(axis=0)
