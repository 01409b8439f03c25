r"""What no model on the list explains, as a Gaussian process: an alarm, not an explanation.

The residuals of the last model are taken as a smooth unknown function plus the noise floor that was
measured without the model (Kennedy and O'Hagan 2001, doi:10.1111/1467-9868.00294):

.. math::
    r = \delta(x) + \delta_{test}(x) + \epsilon, \quad
    k(x, x') = g g' [phase = phase'] [a^2 k_t k_d k_v + (p^2 k_t k_d) [test = test']]

with Matern-3/2 correlations k_t, k_d and k_v over the logarithm of the time since the phase began,
the depth and the logarithm of the loading rate; g is 1 where the force is largest and a half where
there is none. One function is shared by all tests, another is each test's own. It keeps the
intervals of predictions honest. It says nothing about what is missing, and its mean must not be
read as a correction of the material's constants.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.optimize import minimize
from scipy.stats import norm, t
from tinygp import GaussianProcess, kernels
from tinygp.noise import Dense

from qlvbayes.diagnosis.verdict import Work
from qlvbayes.experiment import Experiment, Trial
from qlvbayes.inference import compiled
from qlvbayes.inference.gaussnewton import Point, climb, predict_along
from qlvbayes.kinematics.phases import KINDS
from qlvbayes.records.record import Blocks

_MOST = 300  # points that the process is fitted to
_STEPS = 30  # of the optimiser
_SHARE = 0.9  # of the predictive intervals
_UNKNOWN = 1e6  # variance that takes a point out, over the residuals' mean square
_LEAST_NOISE = 1e-6  # sd, over the largest force, that keeps the covariance invertible
_FAR = 4.0  # from the first guess of a log scale
_CLIMB = 12  # steps of the model's refit
_DRAWS = 16  # of the constants
_LEAST = 0.5  # of the discrepancy's size where there is no force


Numbers = Any  # an array of JAX or of numpy


class Inputs(NamedTuple):
    """Where the process is looked at, each (N,).

    log_time: since the phase began; depth: in units of the largest; log_rate: of the first ramp;
    size: g; phase: its kind; test: which.
    """

    log_time: Numbers
    depth: Numbers
    log_rate: Numbers
    size: Numbers
    phase: Numbers
    test: Numbers


class _Kernel(kernels.Kernel):
    """The covariance above.

    log_scales: log of a, p (N), and of the lengths in time, depth and rate.
    """

    log_scales: Array

    def evaluate(self, X1: Any, X2: Any) -> Array:
        shared, own, time, depth, rate = jnp.exp(self.log_scales)
        near = _matern(X1.log_time, X2.log_time, time) * _matern(X1.depth, X2.depth, depth)
        near *= X1.size * X2.size * (X1.phase == X2.phase)
        alike = shared**2 * _matern(X1.log_rate, X2.log_rate, rate)
        return near * (alike + own**2 * (X1.test == X2.test))


def _matern(one: Array, two: Array, length: Array) -> Array:
    return kernels.Matern32(length).evaluate(one, two)


class _Data(NamedTuple):
    """Points of all tests: residuals (N,), covariance of their noise (N, N), and inputs."""

    inputs: Any
    residual: Numbers
    noise: Numbers


@jax.jit
def _loss(log_scales: Array, data: _Data, middle: Array) -> tuple[Array, Array]:
    """Minus log marginal likelihood, with a wide normal (sd 1.5) about ``middle``; gradient."""

    def loss(x: Array) -> Array:
        return -_process(x, data).log_probability(data.residual) + jnp.sum((x - middle) ** 2) / (
            2.0 * 1.5**2
        )

    return jax.value_and_grad(loss)(log_scales)


def _process(log_scales: Array, data: _Data) -> GaussianProcess:
    return GaussianProcess(_Kernel(log_scales), data.inputs, noise=Dense(data.noise))


@jax.jit
def _conditional(log_scales: Array, data: _Data, at: Any) -> tuple[Array, Array]:
    """Mean and variance (M,) of the discrepancy at other inputs."""
    process = _process(log_scales, data)
    cross = process.kernel(data.inputs, at)
    white = process.solver.solve_triangular(cross)
    mean = white.T @ process.solver.solve_triangular(data.residual)
    return mean, jnp.maximum(process.kernel(at) - jnp.sum(white**2, axis=0), 0.0)


@dataclass(frozen=True, eq=False)
class Band:
    """One test's samples (n,): mean and sd (N) of the discrepancy there, noise not included."""

    mean: np.ndarray
    sd: np.ndarray


@dataclass(frozen=True)
class HeldOutCoverage:
    """Share of each left-out test's samples within their 90 % predictive intervals.

    without: of the model with the noise floor; fitted: of the model with the noise as fitted, which
    may have swollen; honest: with the discrepancy and the noise floor.
    """

    without: tuple[float, ...]
    fitted: tuple[float, ...]
    honest: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """The process fitted to what one model leaves of all tests. An alarm, not an explanation.

    log_scales (5,): log of the sizes a and p (N), of the lengths over log time, depth (of the
    largest) and log rate; sd: typical size (N), root mean square over the points.
    """

    work: Work
    point: Point
    data: _Data
    log_scales: np.ndarray
    sd: float

    def predict(self) -> list[Band]:
        """The discrepancy at the samples of every trial."""
        forces = self.work.samples.predict(self.point.constants[None])[0]
        return [
            _band(self.work, self.data, self.log_scales, k, force) for k, force in enumerate(forces)
        ]

    @cached_property
    def held_out_coverage(self) -> HeldOutCoverage:
        """Model and process refitted with each test left out in turn."""
        shares = [_left_out(self, k) for k in range(len(self.work.samples.trials))]
        return HeldOutCoverage(*zip(*shares, strict=True))


def fit_discrepancy(work: Work, point: Point) -> Discrepancy:
    """Fit the process to the residuals of a model, by the highest marginal likelihood."""
    data = _data(work, point)
    log_scales = _fit(data, _guess(data))
    mean, variance = _conditional(log_scales, data, data.inputs)
    real = np.asarray(data.inputs.test) >= 0
    sd = float(np.sqrt(np.mean((np.asarray(mean) ** 2 + np.asarray(variance))[real])))
    return Discrepancy(work, point, data, log_scales, sd)


def _fit(data: _Data, start: np.ndarray) -> np.ndarray:
    middle = _guess(data)

    def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = _loss(x, data, middle)
        return float(value), np.asarray(slope)

    limits = list(zip(middle - _FAR, middle + _FAR, strict=True))
    found = minimize(
        loss, start, jac=True, method="L-BFGS-B", bounds=limits, options={"maxiter": _STEPS}
    )
    return np.asarray(found.x)


def _guess(data: _Data) -> np.ndarray:
    """Sizes as the residuals', a length of two in time and rate, a third of the depth."""
    known = data.residual[data.residual != 0.0]
    size = 0.5 * np.log(np.mean(known**2)) if known.size else 0.0
    return np.array([size, size, np.log(2.0), np.log(0.3), np.log(2.0)])


def _inputs(
    experiment: Experiment, trial: Trial, k: int, time: np.ndarray, force: np.ndarray
) -> Inputs:
    """Inputs at some times of trial k, where the model's force is ``force``."""
    scales = experiment.scales
    starts = np.array([phase.start for phase in trial.phases])
    place = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, None)
    kinds = np.array([KINDS.index(phase.kind) for phase in trial.phases])
    share = np.minimum(np.abs(force) / scales.force, 1.0)
    return Inputs(
        log_time=np.log(np.maximum(time - starts[place], 0.0) + scales.shortest),
        depth=trial.trajectory.displacement(time) / scales.depth,
        log_rate=np.full(time.shape, np.log(max(trial.rate, 1e-9))),
        size=_LEAST + (1.0 - _LEAST) * share,
        phase=kinds[place].astype(float),
        test=np.full(time.shape, float(k)),
    )


def _data(work: Work, point: Point) -> _Data:
    """Block means of every test, evenly thinned and filled up to one size."""
    blocks = jax.tree.map(np.asarray, work.ensemble.posterior.record.blocks)
    still = np.zeros((1, point.constants.size))
    predicted, _ = predict_along(work.ensemble, point.constants, still)
    inputs = [np.append(np.zeros((_MOST, 5)), np.full((_MOST, 1), -1.0), axis=1)]
    residual, noise, at = np.zeros(_MOST), np.eye(_MOST), 0
    for k, trial in enumerate(work.experiment.trials):
        rows = _thinned(np.flatnonzero(blocks.real[k]), _MOST // len(work.experiment.trials))
        own = jax.tree.map(lambda x, k=k, rows=rows: x[k, rows], blocks)
        force = predicted[k, rows]
        here = slice(at, at + rows.size)
        residual[here] = own.force - force
        noise[here, here] = _floor(work.experiment, own)
        middle = 0.5 * (own.first + own.last)
        inputs.insert(-1, np.stack(_inputs(work.experiment, trial, k, middle, force), axis=1))
        at += rows.size
    filler = np.arange(_MOST) >= at
    noise[filler, filler] = _UNKNOWN * np.mean(residual**2)
    return _Data(Inputs(*np.concatenate(inputs)[:_MOST].T), residual, noise)


def _thinned(rows: np.ndarray, most: int) -> np.ndarray:
    """At most so many, evenly taken."""
    return rows[np.unique(np.linspace(0, rows.size - 1, min(most, rows.size)).astype(int))]


def _floor(experiment: Experiment, blocks: Blocks) -> np.ndarray:
    """Covariance (N, N) of the noise floor of one test's block means (N^2)."""
    floor = experiment.floor
    first, last, count, weight = map(
        np.asarray, (blocks.first, blocks.last, blocks.count, blocks.weight)
    )
    white = (floor.white * weight) ** 2 / count + (_LEAST_NOISE * experiment.scales.force) ** 2
    return np.diag(white) + floor.ou**2 * _averaged(first, last, floor.tau)


def _averaged(first: np.ndarray, last: np.ndarray, tau: float) -> np.ndarray:
    r"""Correlation (N, N) of averages over stretches of an Ornstein-Uhlenbeck process.

    Of lengths x, y in units of tau and a gap d between them: e^{-d} f(x) f(y), f(x) =
    (1 - e^{-x})/x; of a stretch with itself: 2 (x - 1 + e^{-x})/x^2.
    """
    length = np.maximum((last - first) / tau, 1e-6)
    mean = -np.expm1(-length) / length
    gap = np.maximum(first[None, :] - last[:, None], 0.0) / tau
    far = np.exp(-np.maximum(gap, gap.T)) * np.outer(mean, mean)
    own = np.where(
        length < 1e-3, 1.0 - length / 3.0, 2.0 * (length + np.expm1(-length)) / length**2
    )
    np.fill_diagonal(far, own)
    return far


def _band(work: Work, data: _Data, log_scales: np.ndarray, k: int, force: np.ndarray) -> Band:
    """The discrepancy at the samples of trial k, where the model's force is ``force``."""
    samples = work.samples
    trial, rows = samples.trials[k], samples.rows[k]
    at = _inputs(work.experiment, trial, k, trial.test.time[rows], force)
    width = samples.posterior.record.blocks.force.shape[1]  # one size for all trials
    full = Inputs(*(np.pad(x, (0, width - x.size), mode="edge") for x in at))
    mean, variance = _conditional(log_scales, data, full)
    return Band(np.asarray(mean)[: rows.size], np.sqrt(np.asarray(variance)[: rows.size]))


def _left_out(fitted: Discrepancy, k: int) -> tuple[float, float, float]:
    """Coverages of test k, model and process fitted to the others."""
    work, samples = fitted.work, fitted.work.samples
    others = 1.0 - np.eye(len(samples.trials))[k]
    if not others.any():  # one test stands for itself
        others = np.ones(1)
    point = climb(work.ensemble, fitted.point.subset, fitted.point.theta, others, _CLIMB)
    force, model_sd = _spread(work, point, k)
    data = _data(work, point)
    data = data if others[k] else _without(data, k)
    band = _band(work, data, _fit(data, fitted.log_scales), k, force)
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
    weight = np.asarray(samples.posterior.record.blocks.weight)[k, : samples.rows[k].size]
    noise = samples.posterior.with_constants(jnp.asarray(point.constants))[1]
    return np.hypot(floor.white * weight, floor.ou), np.asarray(
        noise.sample_sd(jnp.asarray(weight))
    )


def _covered(error: np.ndarray, half: np.ndarray) -> float:
    return float(np.mean(np.abs(error) <= half))


def _without(data: _Data, k: int) -> _Data:
    """The same points, nothing known of those of test k."""
    unknown = np.asarray(data.inputs.test) == k
    noise = np.array(data.noise)
    noise[unknown] = 0.0
    noise[:, unknown] = 0.0
    noise[unknown, unknown] = _UNKNOWN * np.mean(data.residual**2)
    return data._replace(noise=noise, residual=np.where(unknown, 0.0, data.residual))


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
