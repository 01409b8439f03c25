r"""The expected information of tests by nested Monte Carlo, without linearising the forces.

Readings y are simulated from an explanation, parameters drawn from the belief, and noise. Then

.. math:: I(g; y) = E \log_2 \frac{p(y | g)}{p(y)}, \qquad
          I(\phi; y | h) = E \log_2 \frac{p(y | \phi, h)}{p(y | h)}

for the cause g, one or more explanations h, and the constants phi that are asked for. Every
p(y | .) is an average over draws from a normal about the mode of the remaining parameters, with the
curvature there (Laplace importance sampling; Beck et al. 2018, doi:10.1016/j.cma.2018.01.053), as
plain averages over the prior underflow where tests tell much. The same readings with linear forces,
whose mean is known, serve as a control variate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from qlvbayes.diagnosis.nexttest.belief import STEP, Belief, Explanation
from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.errors import ReadingErrors, Whitening
from qlvbayes.diagnosis.nexttest.records import record_of
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.diagnosis.nexttest.screening import whitening
from qlvbayes.motion.record import Record

Array = NDArray[np.float64]

OUTER = 48
"""Sets of readings that are simulated."""
INNER = 12
"""Pairs of draws of the parameters for each of these."""
_STEPS = 2  # Gauss-Newton steps to the mode
_FARTHEST = 4.0  # sds of the belief: longest step
_MANY = 4000  # sets of linear readings from which the control variate's mean is known
_LN2 = float(np.log(2.0))


@dataclass(frozen=True)
class MonteCarloBits:
    """Bits about the constants and about the cause, each with the sd of its Monte Carlo error."""

    constants: float
    constants_error: float
    cause: float
    cause_error: float


class WhitenedTests:
    """A series of tests, for which it gives the whitened forces of any explanation.

    Parameters
    ----------
    belief
        The belief, whose first explanation gives the noise that grows with the force.
    designs
        The tests, one after another.
    rig
        Limits of the rig.
    errors
        Errors of the readings.
    clock
        Time (s) at which the first test's wait begins.
    """

    def __init__(
        self,
        belief: Belief,
        designs: Sequence[Design],
        rig: Rig,
        errors: ReadingErrors,
        clock: float,
    ) -> None:
        first = belief.explanations[0]
        self._parts: list[tuple[Record, Whitening]] = []
        for design in designs:
            record = record_of([design], rig, clock)
            force = first.forces(np.zeros((1, first.size)), record)[0, 0]
            self._parts.append((record, whitening(design, 0, record, rig, errors, force)))
            clock += design.wait + design.duration

    def forces(self, one: Explanation, z: Array) -> Array:
        """Return the whitened forces (K, n) of an explanation for z (K, F)."""
        parts = [white(one.forces(z, record)[:, 0]) for record, white in self._parts]
        return np.concatenate(parts, axis=1)


def monte_carlo_bits(
    belief: Belief,
    designs: Sequence[Design],
    rig: Rig,
    errors: ReadingErrors,
    names: Sequence[str],
    *,
    clock: float = 0.0,
    seed: int = 0,
    outer: int = OUTER,
    inner: int = INNER,
) -> MonteCarloBits:
    """Return the bits that all these tests together are expected to tell.

    Parameters
    ----------
    belief
        Explanations with their probabilities.
    designs
        The tests, one after another.
    rig
        Limits of the rig.
    errors
        Errors of the readings.
    names
        Names of the constants that are asked for.
    clock
        Time (s) at which the first test's wait begins.
    seed
        Seed of the draws; the same seed gives the same bits.
    outer, inner
        Sets of readings, and pairs of draws for each of them.
    """
    rng = np.random.default_rng(seed)
    tests = WhitenedTests(belief, designs, rig, errors, clock)
    linear = LinearTests.from_tests(tests, belief)
    p = belief.probabilities
    log_p = np.log(np.maximum(p, 1e-300))
    constants, cause = [], []
    for k, one in enumerate(belief.explanations):
        count = max(round(outer * p[k]), 4)
        z = rng.standard_normal((count, one.size))
        force = tests.forces(one, z)
        noise = rng.standard_normal(force.shape)
        readings = force + noise
        whole = [
            _log_marginals(tests, other, readings, np.zeros((count, other.size)),
                           np.zeros((count, other.size)), np.eye(other.size), inner, rng)
            for other in belief.explanations
        ]  # fmt: skip
        own = _own_group(belief, k)
        bits = _bits_of_group(np.stack(whole), log_p, own)
        control = linear.cause(k, z, noise, log_p, own)
        cause.append(bits - control + linear.cause_mean(k, log_p, own, seed))
        rows = one.directions(names)
        known = _log_given_constants(tests, one, rows, z, readings, noise, inner, rng)
        bits = (known - whole[k]) / _LN2 if len(rows) else np.zeros(count)
        control = linear.constants(k, rows, z, noise)
        constants.append(bits - control + linear.constants_mean(k, rows))
    return MonteCarloBits(*_mean(constants, p), *_mean(cause, p))


def _own_group(belief: Belief, k: int) -> list[int]:
    """Return the indices of all explanations of k's cause."""
    return list(next(group for group in belief.groups if k in group))


def _bits_of_group(logs: Array, log_p: Array, own: list[int]) -> Array:
    """Return the bits (K,) about a cause, the explanations ``own``, from log p(y | h) (H, K)."""
    joint = logs + log_p[:, None]
    within = logsumexp(joint[own], axis=0) - logsumexp(log_p[own])
    return np.asarray((within - logsumexp(joint, axis=0)) / _LN2)


@dataclass(frozen=True, eq=False)
class LinearTests:
    """The same tests with forces that are linear in z: a control variate of known mean.

    Parameters
    ----------
    forces
        Whitened forces (n,) of every explanation at z = 0.
    slopes
        Their slopes (F, n) along z.
    """

    forces: tuple[Array, ...]
    slopes: tuple[Array, ...]

    @classmethod
    def from_tests(cls, tests: WhitenedTests, belief: Belief) -> LinearTests:
        """Return the tests linearised about z = 0."""
        forces, slopes = [], []
        for one in belief.explanations:
            zero = np.zeros((1, one.size))
            left, own = _linearised(tests, one, np.zeros((1, 1)), zero, zero, np.eye(one.size))
            forces.append(-left[0])
            slopes.append(own[0])
        return cls(tuple(forces), tuple(slopes))

    def _log_marginal(self, k: int, readings: Array, axes: Array | None = None) -> Array:
        """Return log p(y) (K,) of readings (K, n), up to a constant.

        axes (k, F): the directions of z that are integrated over, by default all.
        """
        own = self.slopes[k] if axes is None else axes @ self.slopes[k]
        left = readings - self.forces[k]
        precision = np.eye(len(own)) + own @ own.T
        taken = left @ own.T
        inside = np.einsum("kf,kf->k", taken, np.linalg.solve(precision, taken.T).T)
        log_det = np.linalg.slogdet(precision)[1]
        return np.asarray(-0.5 * (np.sum(left**2, axis=1) - inside + log_det))

    def cause(self, k: int, z: Array, noise: Array, log_p: Array, own: list[int]) -> Array:
        """Return the bits (K,) about the cause, of explanation k with z (K, F) and noise (K, n).

        own: indices of the explanations of k's cause.
        """
        if len(log_p) == len(own):
            return np.zeros(len(z))
        readings = self.forces[k] + z @ self.slopes[k] + noise
        logs = np.stack([self._log_marginal(j, readings) for j in range(len(log_p))])
        return _bits_of_group(logs, log_p, own)

    def cause_mean(self, k: int, log_p: Array, own: list[int], seed: int) -> float:
        """Return the mean of `cause`, over so many draws that its own error does not count."""
        if len(log_p) == len(own):
            return 0.0
        rng = np.random.default_rng([seed, k])
        z = rng.standard_normal((_MANY, len(self.slopes[k])))
        noise = rng.standard_normal((_MANY, len(self.forces[k])))
        return float(self.cause(k, z, noise, log_p, own).mean())

    def constants(self, k: int, rows: Array, z: Array, noise: Array) -> Array:
        """Return the bits (K,) about directions, rows (r, F), of explanation k's parameters."""
        if not len(rows):
            return np.zeros(len(z))
        readings = self.forces[k] + z @ self.slopes[k] + noise
        others = np.linalg.svd(rows)[2][len(rows) :]
        known = readings - z @ rows.T @ rows @ self.slopes[k]
        given = self._log_marginal(k, known, others)
        return np.asarray((given - self._log_marginal(k, readings)) / _LN2)

    def constants_mean(self, k: int, rows: Array) -> float:
        """Return the mean of `constants`, in closed form."""
        if not len(rows):
            return 0.0
        precision = np.eye(len(self.slopes[k])) + self.slopes[k] @ self.slopes[k].T
        left = rows @ np.linalg.solve(precision, rows.T)
        return float(-0.5 * np.linalg.slogdet(left)[1] / _LN2)


def _mean(values: Sequence[Array], p: Array) -> tuple[float, float]:
    """Return the mean over explanations by their probability, with its error.

    Values that are not finite are left out.
    """
    kept = [one[np.isfinite(one)] for one in values]
    if any(one.size < 2 for one in kept):
        return float("nan"), float("nan")
    mean = sum(q * one.mean() for q, one in zip(p, kept, strict=True))
    variance = sum(q**2 * one.var(ddof=1) / one.size for q, one in zip(p, kept, strict=True))
    return float(mean), float(np.sqrt(variance))


def _log_given_constants(
    tests: WhitenedTests,
    one: Explanation,
    rows: Array,
    z: Array,
    readings: Array,
    noise: Array,
    inner: int,
    rng: np.random.Generator,
) -> Array:
    """Return log p(y | phi) (K,), where phi are the constants along rows (r, F) of z (K, F)."""
    if len(rows) in (0, one.size):
        return np.asarray(-0.5 * np.sum(noise**2, axis=1))
    others = np.linalg.svd(rows)[2][len(rows) :]
    fixed = z @ rows.T @ rows
    return _log_marginals(tests, one, readings, fixed, z @ others.T, others.T, inner, rng)


def _log_marginals(
    tests: WhitenedTests,
    one: Explanation,
    readings: Array,
    fixed: Array,
    start: Array,
    basis: Array,
    inner: int,
    rng: np.random.Generator,
) -> Array:
    """Return log p(y | fixed) (K,) up to a constant.

    z = fixed + basis psi is integrated over psi ~ N(0, 1). Shapes: readings (K, n), fixed (K, F),
    start (K, k) of the search for the mode of psi, basis (F, k).
    """
    count, size = start.shape
    mode = start
    for _ in range(_STEPS):
        residual, slopes = _linearised(tests, one, readings, fixed, mode, basis)
        curvature = np.eye(size) + slopes @ np.swapaxes(slopes, 1, 2)
        slope = np.einsum("kfn,kn->kf", slopes, residual) - mode
        step = np.linalg.solve(curvature, slope[..., None])[..., 0]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        mode = mode + step * np.minimum(1.0, _FARTHEST / np.maximum(length, 1e-300))
    roots = np.linalg.inv(np.linalg.cholesky(curvature))  # root^T root = covariance
    half = rng.standard_normal((count, inner, size))
    normal = np.concatenate([half, -half], axis=1)  # in pairs: what is odd about the mode cancels
    psi = mode[:, None] + np.einsum("kgf,kmg->kmf", roots, normal)
    z = fixed[:, None] + psi @ basis.T
    force = tests.forces(one, z.reshape(-1, one.size)).reshape(count, 2 * inner, -1)
    logs = -0.5 * np.sum((readings[:, None] - force) ** 2, axis=2)
    # prior over proposal: both normal, of which the factors 2 pi cancel
    logs += 0.5 * np.sum(normal**2, axis=2) - 0.5 * np.sum(psi**2, axis=2)
    logs = np.where(np.isfinite(logs), logs, -np.inf)
    volume = np.log(np.abs(np.einsum("kff->kf", roots))).sum(axis=1)
    return np.asarray(logsumexp(logs, axis=1) - np.log(2 * inner) + volume)


def _linearised(
    tests: WhitenedTests,
    one: Explanation,
    readings: Array,
    fixed: Array,
    psi: Array,
    basis: Array,
) -> tuple[Array, Array]:
    """Return residuals (K, n) at psi (K, k), and slopes (K, k, n) of the forces along psi."""
    count, size = psi.shape
    steps = STEP * np.concatenate([np.zeros((1, size)), np.eye(size)])
    z = fixed[:, None] + (psi[:, None] + steps) @ basis.T
    force = tests.forces(one, z.reshape(-1, one.size)).reshape(count, 1 + size, -1)
    return readings - force[:, 0], (force[:, 1:] - force[:, :1]) / STEP
