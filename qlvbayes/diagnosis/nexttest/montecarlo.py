r"""What tests would tell, forces as they are: nested Monte Carlo with Laplace importance sampling.

Of an explanation and numbers drawn from the belief, and noise, readings y are made, and then

.. math:: I(g; y) = E \log_2 \frac{p(y | g)}{p(y)}, \qquad
          I(\phi; y | h) = E \log_2 \frac{p(y | \phi, h)}{p(y | h)}

for the cause g, one or more explanations h, and the constants phi that are asked for. Every
p(y | .) is an average over draws from a normal about the highest place of the numbers that are
left, with the curvature there (Beck et al. 2018, doi:10.1016/j.cma.2018.01.053): plain averages
over the prior underflow where tests tell much. The same readings with linear forces, of which the
mean is known, take most of the error away (a control variate).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from qlvbayes.diagnosis.nexttest.belief import STEP, Belief, Explanation
from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.errors import Errors, Whitening
from qlvbayes.diagnosis.nexttest.records import record_of
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.diagnosis.nexttest.screening import whitening
from qlvbayes.preprocess.record import Record

Array = NDArray[np.float64]

OUTER = 48
"""Readings that are made of a design."""
INNER = 12
"""Draws of the numbers, about each of these."""
_CLIMB = 2  # Gauss-Newton steps to the highest place
_FARTHEST = 4.0  # sds of the belief, of one step
_MANY = 4000  # linear readings, by which their mean for the cause is known
_LN2 = float(np.log(2.0))


@dataclass(frozen=True)
class Judged:
    """Bits for the constants and for the cause, each with the sd of its Monte Carlo error."""

    constants: float
    constants_error: float
    cause: float
    cause_error: float


class Trial:
    """Some tests, one after another, as whitened forces of any explanation."""

    def __init__(
        self, belief: Belief, designs: Sequence[Design], rig: Rig, errors: Errors, clock: float
    ) -> None:
        first = belief.explanations[0]
        self._parts: list[tuple[Record, Whitening]] = []
        for design in designs:
            record = record_of([design], rig, clock)
            force = first.forces(np.zeros((1, first.size)), record)[0, 0]
            self._parts.append((record, whitening(design, 0, record, rig, errors, force)))
            clock += design.wait + design.duration

    def forces(self, one: Explanation, z: Array) -> Array:
        """(K, n) of z (K, F)."""
        parts = [white(one.forces(z, record)[:, 0]) for record, white in self._parts]
        return np.concatenate(parts, axis=1)


def judged(
    belief: Belief,
    designs: Sequence[Design],
    rig: Rig,
    errors: Errors,
    asked: Sequence[str],
    *,
    clock: float = 0.0,
    seed: int = 0,
    outer: int = OUTER,
    inner: int = INNER,
) -> Judged:
    """Of the readings of all these tests together; the same seed gives the same."""
    rng = np.random.default_rng(seed)
    trial = Trial(belief, designs, rig, errors, clock)
    lines = Lines.of(trial, belief)
    p = belief.probabilities
    log_p = np.log(np.maximum(p, 1e-300))
    constants, cause = [], []
    for k, one in enumerate(belief.explanations):
        count = max(round(outer * p[k]), 4)
        z = rng.standard_normal((count, one.size))
        force = trial.forces(one, z)
        noise = rng.standard_normal(force.shape)
        readings = force + noise
        whole = [
            _log_marginals(trial, other, readings, np.zeros((count, other.size)),
                           np.zeros((count, other.size)), np.eye(other.size), inner, rng)
            for other in belief.explanations
        ]  # fmt: skip
        own = _own_group(belief, k)
        found = _bits_of_group(np.stack(whole), log_p, own)
        linear = lines.cause(k, z, noise, log_p, own)
        cause.append(found - linear + lines.cause_mean(k, log_p, own, seed))
        rows = one.asked(asked)
        known = _given(trial, one, rows, z, readings, noise, inner, rng)
        found = (known - whole[k]) / _LN2 if len(rows) else np.zeros(count)
        constants.append(found - lines.constants(k, rows, z, noise) + lines.constants_mean(k, rows))
    return Judged(*_mean(constants, p), *_mean(cause, p))


def _own_group(belief: Belief, k: int) -> list[int]:
    """Places of all explanations of k's cause."""
    return list(next(group for group in belief.groups if k in group))


def _bits_of_group(logs: Array, log_p: Array, own: list[int]) -> Array:
    """Bits (K,) for a cause, the explanations own, of log p(y | h) (H, K)."""
    joint = logs + log_p[:, None]
    within = logsumexp(joint[own], axis=0) - logsumexp(log_p[own])
    return np.asarray((within - logsumexp(joint, axis=0)) / _LN2)


@dataclass(frozen=True, eq=False)
class Lines:
    """The same tests with forces that are linear in z: a control variate of known mean.

    forces (n,) at z = 0 and slopes (F, n) of every explanation, whitened.
    """

    forces: tuple[Array, ...]
    slopes: tuple[Array, ...]

    @classmethod
    def of(cls, trial: Trial, belief: Belief) -> Lines:
        """About z = 0."""
        forces, slopes = [], []
        for one in belief.explanations:
            nothing = np.zeros((1, one.size))
            left, own = _linear(trial, one, np.zeros((1, 1)), nothing, nothing, np.eye(one.size))
            forces.append(-left[0])
            slopes.append(own[0])
        return cls(tuple(forces), tuple(slopes))

    def _log_marginal(self, k: int, readings: Array, axes: Array | None = None) -> Array:
        """Log p(y) (K,) up to a constant, of readings (K, n); axes (k, F): what of z is summed."""
        own = self.slopes[k] if axes is None else axes @ self.slopes[k]
        left = readings - self.forces[k]
        precision = np.eye(len(own)) + own @ own.T
        taken = left @ own.T
        inside = np.einsum("kf,kf->k", taken, np.linalg.solve(precision, taken.T).T)
        log_det = np.linalg.slogdet(precision)[1]
        return np.asarray(-0.5 * (np.sum(left**2, axis=1) - inside + log_det))

    def cause(self, k: int, z: Array, noise: Array, log_p: Array, own: list[int]) -> Array:
        """Bits (K,) for the cause of readings by explanation k of z (K, F) and noise (K, n).

        own: the explanations of k's cause.
        """
        if len(log_p) == len(own):
            return np.zeros(len(z))
        readings = self.forces[k] + z @ self.slopes[k] + noise
        logs = np.stack([self._log_marginal(j, readings) for j in range(len(log_p))])
        return _bits_of_group(logs, log_p, own)

    def cause_mean(self, k: int, log_p: Array, own: list[int], seed: int) -> float:
        """Its mean, over so many draws that its own error does not count."""
        if len(log_p) == len(own):
            return 0.0
        rng = np.random.default_rng([seed, k])
        z = rng.standard_normal((_MANY, len(self.slopes[k])))
        noise = rng.standard_normal((_MANY, len(self.forces[k])))
        return float(self.cause(k, z, noise, log_p, own).mean())

    def constants(self, k: int, rows: Array, z: Array, noise: Array) -> Array:
        """Bits (K,) for what rows (r, F) say of explanation k's numbers, of the same readings."""
        if not len(rows):
            return np.zeros(len(z))
        readings = self.forces[k] + z @ self.slopes[k] + noise
        others = np.linalg.svd(rows)[2][len(rows) :]
        known = readings - z @ rows.T @ rows @ self.slopes[k]
        given = self._log_marginal(k, known, others)
        return np.asarray((given - self._log_marginal(k, readings)) / _LN2)

    def constants_mean(self, k: int, rows: Array) -> float:
        """Its mean, in closed form."""
        if not len(rows):
            return 0.0
        precision = np.eye(len(self.slopes[k])) + self.slopes[k] @ self.slopes[k].T
        left = rows @ np.linalg.solve(precision, rows.T)
        return float(-0.5 * np.linalg.slogdet(left)[1] / _LN2)


def _mean(values: Sequence[Array], p: Array) -> tuple[float, float]:
    """Over explanations by their probability, and its error; what failed is left out."""
    kept = [one[np.isfinite(one)] for one in values]
    if any(one.size < 2 for one in kept):
        return float("nan"), float("nan")
    mean = sum(q * one.mean() for q, one in zip(p, kept, strict=True))
    variance = sum(q**2 * one.var(ddof=1) / one.size for q, one in zip(p, kept, strict=True))
    return float(mean), float(np.sqrt(variance))


def _given(
    trial: Trial,
    one: Explanation,
    rows: Array,
    z: Array,
    readings: Array,
    noise: Array,
    inner: int,
    rng: np.random.Generator,
) -> Array:
    """Log p(y | phi) (K,) at the constants phi, rows (r, F), that z (K, F) has."""
    if len(rows) in (0, one.size):
        return np.asarray(-0.5 * np.sum(noise**2, axis=1))
    others = np.linalg.svd(rows)[2][len(rows) :]
    fixed = z @ rows.T @ rows
    return _log_marginals(trial, one, readings, fixed, z @ others.T, others.T, inner, rng)


def _log_marginals(
    trial: Trial,
    one: Explanation,
    readings: Array,
    fixed: Array,
    start: Array,
    basis: Array,
    inner: int,
    rng: np.random.Generator,
) -> Array:
    """Log of p(y | fixed) (K,) up to a constant, z = fixed + basis psi summed over psi ~ N(0, 1).

    readings (K, n); fixed (K, F); start (K, k): from where the highest psi is looked for; basis
    (F, k).
    """
    count, size = start.shape
    place = start
    for _ in range(_CLIMB):
        residual, slopes = _linear(trial, one, readings, fixed, place, basis)
        curvature = np.eye(size) + slopes @ np.swapaxes(slopes, 1, 2)
        slope = np.einsum("kfn,kn->kf", slopes, residual) - place
        step = np.linalg.solve(curvature, slope[..., None])[..., 0]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        place = place + step * np.minimum(1.0, _FARTHEST / np.maximum(length, 1e-300))
    roots = np.linalg.inv(np.linalg.cholesky(curvature))  # root^T root = covariance
    half = rng.standard_normal((count, inner, size))
    normal = np.concatenate([half, -half], axis=1)  # in pairs: what is odd about the place cancels
    psi = place[:, None] + np.einsum("kgf,kmg->kmf", roots, normal)
    z = fixed[:, None] + psi @ basis.T
    force = trial.forces(one, z.reshape(-1, one.size)).reshape(count, 2 * inner, -1)
    logs = -0.5 * np.sum((readings[:, None] - force) ** 2, axis=2)
    # prior over proposal: both normal, of which the factors 2 pi cancel
    logs += 0.5 * np.sum(normal**2, axis=2) - 0.5 * np.sum(psi**2, axis=2)
    logs = np.where(np.isfinite(logs), logs, -np.inf)
    volume = np.log(np.abs(np.einsum("kff->kf", roots))).sum(axis=1)
    return np.asarray(logsumexp(logs, axis=1) - np.log(2 * inner) + volume)


def _linear(
    trial: Trial, one: Explanation, readings: Array, fixed: Array, place: Array, basis: Array
) -> tuple[Array, Array]:
    """Residual (K, n) at psi = place (K, k), and slopes (K, k, n) of the forces along psi."""
    count, size = place.shape
    steps = STEP * np.concatenate([np.zeros((1, size)), np.eye(size)])
    z = fixed[:, None] + (place[:, None] + steps) @ basis.T
    force = trial.forces(one, z.reshape(-1, one.size)).reshape(count, 1 + size, -1)
    return readings - force[:, 0], (force[:, 1:] - force[:, :1]) / STEP
