r"""The expected information of tests by nested Monte Carlo, without linearising the forces.

It is the check of the closed form, by which ``qlvbayes design`` chooses. Readings y are simulated
from an explanation, parameters drawn from the belief, and noise. Then

.. math:: I(g; y) = E \log_2 \frac{p(y | g)}{p(y)}, \qquad
          I(\phi; y | h) = E \log_2 \frac{p(y | \phi, h)}{p(y | h)}

for the cause g, one or more explanations h, and the constants phi that are asked for. Every
p(y | .) is an average over draws from a normal about the mode of the remaining parameters, with the
curvature there (Laplace importance sampling; Beck et al. 2018, doi:10.1016/j.cma.2018.01.053), as
plain averages over the prior underflow where tests tell much. The same readings with linear forces
go the same way; as their mean is known, only the difference has a Monte Carlo error.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from qlvbayes.diagnosis.nexttest.belief import STEP
from qlvbayes.diagnosis.nexttest.records import record_of, whitening

_STEPS = 2  # Gauss-Newton steps to the mode
_FARTHEST = 4.0  # sds of the belief: longest step
_MANY = 4000  # sets of linear readings, so that the error of their mean does not count
_LN2 = float(np.log(2.0))


@dataclass(frozen=True)
class NestedBits:
    """Bits about constants and cause, each with the sd of its Monte Carlo error."""

    constants: float
    constants_error: float
    cause: float
    cause_error: float


class WhitenedTests:
    """A series of tests, for which it gives the whitened forces of any explanation.

    The belief's first explanation gives the noise that grows with the force; the first wait
    begins at ``clock`` (s).
    """

    def __init__(self, belief, designs, rig, errors, clock):
        first, self._parts = belief.explanations[0], []
        for design in designs:
            record = record_of([design], rig, clock)
            force = first.forces(np.zeros((1, first.size)), record)[0, 0]
            self._parts.append((record, whitening(design, 0, record, rig, errors, force)))
            clock += design.wait + design.duration

    def forces(self, one, z):
        """Return the whitened forces (K, n) of an explanation for z (K, F)."""
        parts = [white(one.forces(z, record)[:, 0]) for record, white in self._parts]
        return np.concatenate(parts, axis=1)


class LinearTests:
    """The same tests with forces that are linear in z, with their slopes at z = 0."""

    def __init__(self, tests, belief):
        self._own = {}
        for one in belief.explanations:
            rows = STEP * np.concatenate([np.zeros((1, one.size)), np.eye(one.size)])
            force = tests.forces(one, rows)
            self._own[id(one)] = force[0], (force[1:] - force[0]) / STEP

    def forces(self, one, z):
        """Return the whitened forces (K, n) of an explanation for z (K, F)."""
        force, slopes = self._own[id(one)]
        return force + z @ slopes

    def bits_for(self, one, rows):
        """Return the expected bits about directions, rows (r, F), of an explanation's z."""
        slopes = self._own[id(one)][1]
        left = rows @ np.linalg.solve(np.eye(one.size) + slopes @ slopes.T, rows.T)
        return float(-0.5 * np.linalg.slogdet(left)[1] / _LN2)


def nested_bits(belief, designs, rig, errors, names, *, seed=0, outer=48, inner=12):
    """Return the bits that all these tests together are expected to tell.

    ``names`` are the constants that are asked for; ``outer`` sets of readings, with ``inner`` pairs
    of draws for each.
    """
    tests = WhitenedTests(belief, designs, rig, errors, 0.0)
    linear = LinearTests(tests, belief)
    real = _simulated(tests, belief, names, seed, outer, inner)
    same = _simulated(linear, belief, names, seed, outer, inner)
    exact = [linear.bits_for(one, one.directions(names)) for one in belief.explanations]
    # about the cause there is no closed form; one pair of draws is exact where forces are linear
    many = [bits.mean() for bits in _simulated(linear, belief, (), seed + 1, _MANY, 1)[1]]
    means = []
    for bits, line, known in zip(real, same, (exact, many), strict=True):
        shift = [a - b + c for a, b, c in zip(bits, line, known, strict=True)]
        means += _mean(shift, belief.probabilities)
    return NestedBits(*means)


def _simulated(tests, belief, names, seed, outer, inner):
    """Return the bits about constants and cause of readings of each explanation."""
    p = belief.probabilities
    log_p = np.log(np.maximum(p, 1e-300))
    constants, cause = [], []
    for k, one in enumerate(belief.explanations):
        rng = np.random.default_rng([seed, k])
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
        own = list(next(group for group in belief.groups if k in group))
        joint = np.stack(whole) + log_p[:, None]
        within = logsumexp(joint[own], axis=0) - logsumexp(log_p[own])
        cause.append((within - logsumexp(joint, axis=0)) / _LN2)
        rows = one.directions(names)
        known = _log_given_constants(tests, one, rows, z, readings, noise, inner, rng)
        constants.append((known - whole[k]) / _LN2 if len(rows) else np.zeros(count))
    return constants, cause


def _mean(values, p):
    """Return the mean of finite values over explanations by their probability, with its error."""
    kept = [one[np.isfinite(one)] for one in values]
    if any(one.size < 2 for one in kept):
        return float("nan"), float("nan")
    mean = sum(q * one.mean() for q, one in zip(p, kept, strict=True))
    variance = sum(q**2 * one.var(ddof=1) / one.size for q, one in zip(p, kept, strict=True))
    return float(mean), float(np.sqrt(variance))


def _log_given_constants(tests, one, rows, z, readings, noise, inner, rng):
    """Return log p(y | phi) (K,), where phi are the constants along rows (r, F) of z (K, F)."""
    if len(rows) in (0, one.size):
        return -0.5 * np.sum(noise**2, axis=1)
    others = np.linalg.svd(rows)[2][len(rows) :]
    fixed = z @ rows.T @ rows
    return _log_marginals(tests, one, readings, fixed, z @ others.T, others.T, inner, rng)


def _log_marginals(tests, one, readings, fixed, start, basis, inner, rng):
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
    return logsumexp(logs, axis=1) - np.log(2 * inner) + volume


def _linearised(tests, one, readings, fixed, psi, basis):
    """Return residuals (K, n) at psi (K, k), and slopes (K, k, n) of the forces along psi."""
    count, size = psi.shape
    steps = STEP * np.concatenate([np.zeros((1, size)), np.eye(size)])
    z = fixed[:, None] + (psi[:, None] + steps) @ basis.T
    force = tests.forces(one, z.reshape(-1, one.size)).reshape(count, 1 + size, -1)
    return readings - force[:, 0], (force[:, 1:] - force[:, :1]) / STEP
