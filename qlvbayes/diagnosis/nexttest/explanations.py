"""Explanations of a pad's tests, each with a normal distribution of its constants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate, described
from qlvbayes.diagnosis.nexttest.belief import Explanation
from qlvbayes.inference.density import Density
from qlvbayes.inference.forward.forces import Forces
from qlvbayes.io.arrays import Array
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import described_model
from qlvbayes.model.parameters import fields_of, filled, unit_kinds
from qlvbayes.motion.record import Record

_DRAWS = 384  # of each round of importance sampling
_ROUNDS = 3  # each draws from a normal with the moments of the round before
_WIDER = 1.2  # factor of the sds from which a round draws
_SOUND = 0.2  # share of effective draws from which Laplace's normal is used as it is
_LEAST_EFFECTIVE = 60.0  # draws; weights are tempered where there are fewer


def explanation_of_mode(
    density: Density, candidate: Candidate, probability: float, cause: str = ""
) -> Explanation:
    """Return the explanation from a hypothesis about one of its modes."""
    space, hypothesis, own = density.space, candidate.hypothesis, candidate.point.own
    mean, root = _moments(density, candidate)
    kept = len(own.names) - len(own.noise.units)  # the noise's come last and are fixed

    def constants(z: Array) -> Array:
        return own.constants(own.within(mean + z @ root.T))[:, :kept]

    def run(rows: Array, record: Record) -> Array:
        noise = np.tile(own.fixed[kept:], (len(rows), 1))
        return space.forces(hypothesis, np.concatenate([rows, noise], axis=1), record)

    centre = own.constants(own.within(mean)[None])[0]
    model = own.model_at(centre)
    fractions, rates = model.relaxation.spectrum()
    return Explanation(
        described(hypothesis),
        probability,
        root.shape[1],
        tuple(own.names[:kept]),
        tuple(unit_kinds(own)[:kept]),
        constants,
        run,
        np.asarray(fractions)[1:],
        np.asarray(rates),
        cause,
    )


def _moments(density: Density, candidate: Candidate) -> tuple[Array, Array]:
    """Return the mean (F,) of the free parameters, and a root (F, F) of their covariance."""
    mean, root = candidate.point.theta, _root(candidate.evidence.covariance)
    rng = np.random.default_rng(0)
    for k in range(_ROUNDS):
        normal = rng.standard_normal((_DRAWS, mean.size))
        theta = mean + _WIDER * normal @ root.T
        log = _log_density(density, candidate, theta) + 0.5 * np.sum(normal**2, 1)
        if not np.isfinite(log).any() or (k == 0 and _effective(log) > _SOUND * _DRAWS):
            break
        weights = _tempered(log)
        mean = weights @ theta
        spread = (theta - mean) * np.sqrt(weights)[:, None]
        root = _root(spread.T @ spread)
    return mean, root


def _log_density(density: Density, candidate: Candidate, theta: Array) -> Array:
    """Return the log posterior density (K,) of rows theta (K, F), up to a constant."""
    point, own, hypothesis = candidate.point, candidate.point.own, candidate.hypothesis
    inside = np.all((theta >= own.lowest) & (theta <= own.highest), axis=1)
    change = point.predicted - density.space.forces(hypothesis, own.constants(own.within(theta)))
    left = density.whitener(np.nan_to_num(change, posinf=0.0, neginf=0.0)) + point.residual
    misfit = density.discrepancy.at(candidate.mode.size, point.separation).squares(left)
    apart, prior = theta - point.theta, point.prior
    loss = apart @ prior.gradient + 0.5 * np.einsum("kf,fg,kg->k", apart, prior.curvature, apart)
    sound = inside & np.isfinite(change).all(axis=(1, 2))
    return np.where(sound, -0.5 * misfit - loss, -np.inf)


def _effective(log: Array) -> float:
    """Return the effective number of draws with log weights (K,)."""
    weights = np.exp(log - log.max())
    return float(weights.sum() ** 2 / np.sum(weights**2))


def _tempered(log: Array) -> Array:
    """Return weights (K,) of sum 1, tempered until their effective number is large enough."""
    for power in (1.0, 0.5, 0.25, 0.1, 0.03, 0.01):
        if _effective(power * log) >= _LEAST_EFFECTIVE:
            break
    weights = np.exp(power * (log - log.max()))
    return np.asarray(weights / weights.sum())


def _root(covariance: Array) -> Array:
    """Return a root (F, F) of a covariance (F, F)."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


_CONSTANT = 1e-12  # of the largest variance, below which nothing varies in a direction
_FRACTIONS = "c["  # prefix of the constants that sum to one


def explanation_of_draws(
    choices: Choices, names: Sequence[str], draws: Array, depth: float
) -> Explanation:
    """Return the explanation from draws (n, P) of a fit; ``depth`` (mm) is the largest."""
    model = described_model(choices, depth)
    fields = list(fields_of(model))
    own = [name for field in fields for name in field.names]
    values = np.stack([draws[:, list(names).index(name)] for name in own], axis=1)
    in_log = np.all(values > 0.0, axis=0)
    scaled = np.where(in_log, np.log(np.where(in_log, values, 1.0)), values)
    mean, root = scaled.mean(axis=0), _varying_root(np.atleast_2d(np.cov(scaled.T)))
    shares = np.array([name.startswith(_FRACTIONS) for name in own])
    sums = bool(shares.any()) and np.allclose(values[:, shares].sum(axis=1), 1.0)

    def constants(z: Array) -> Array:
        rows = mean + z @ root.T
        rows[:, in_log] = np.exp(rows[:, in_log])
        if sums:
            rows[:, shares] /= rows[:, shares].sum(axis=1, keepdims=True)
        return rows

    forces = Forces()

    def run(rows: Array, record: Record) -> Array:
        return forces.over(filled(model, rows.T), len(rows), record)

    whole = filled(model, constants(np.zeros((1, root.shape[1])))[0])
    fractions, rates = whole.relaxation.spectrum()
    words = " + ".join((choices.elastic, choices.relaxing, *choices.effects))
    return Explanation(
        words,
        1.0,
        root.shape[1],
        tuple(own),
        tuple(field.unit for field in fields for _ in field.names),
        constants,
        run,
        np.asarray(fractions)[1:],
        np.asarray(rates),
    )


def _varying_root(covariance: Array) -> Array:
    """Return a root (P, F) of a covariance (P, P), without directions in which nothing varies."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _CONSTANT * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))
