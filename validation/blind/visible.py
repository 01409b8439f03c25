r"""Say whether the tests can show a hidden effect at all, from the simulator alone.

The pattern of an effect is the difference of two simulations without noise, with it and without,
both with all other hidden effects. The part of it that no constant of the pad takes is what is left
after a least-squares fit of the simulator's own slopes by its law's constants (finite differences
in their logarithms), all whitened by the true covariance of the errors:

.. math:: \chi^2 = \min_x |L^{-1} (p - S x)|^2, \qquad L L^T = \Sigma.

An effect with k constants could be seen where :math:`\chi^2 - k \ln(1 + \chi^2) > 10`, twice the
log Bayes factor with each constant known to about :math:`1/\chi` of its prior. Nothing of the
model or of the diagnosis takes part.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import log1p

import numpy as np
from scipy.linalg import solve_triangular

from blind.study import BlindStudy
from qlvbayes.simulate import Effect

SEEN = 10.0  # expected 2 ln(Bayes factor)
_MOST = 150  # samples a test: errors with a memory make the rest nearly the same
_STEP = 1e-3  # of a constant's logarithm
_FLOOR = 1e-4  # share of the peak force that counts as error where there is none


def visible(study: BlindStudy) -> dict[str, float]:
    """Return the expected 2 ln(Bayes factor) of each hidden effect, by name."""
    if not study.effects:
        return {}
    samples = [_some(t.size) for t in study.times]
    times = [t[k] for t, k in zip(study.times, samples, strict=True)]
    whole = study.forces(study.law, study.effects, times)
    factors = _factors(study, times, whole)
    slopes = _slopes(study, times, whole)
    evidence = {}
    for effect in study.effects:
        others = [other for other in study.effects if other is not effect]
        rest = study.forces(study.law, others, times)
        pattern = [a - b for a, b in zip(whole, rest, strict=True)]
        evidence[effect.name] = _expected_evidence(_unexplained(factors, pattern, slopes), effect)
    return evidence


def _expected_evidence(chi2: float, effect: Effect) -> float:
    count = sum(isinstance(value, float) for value in effect.parameters.values())
    return chi2 - count * log1p(chi2)


def _unexplained(
    factors: Sequence[np.ndarray], pattern: Sequence[np.ndarray], slopes: Sequence[np.ndarray]
) -> float:
    """Return chi^2 of the part of a pattern that the slopes (n, k) of no test explain."""
    left = np.concatenate(
        [solve_triangular(f, p, lower=True) for f, p in zip(factors, pattern, strict=True)]
    )
    taken = np.concatenate(
        [solve_triangular(f, s, lower=True) for f, s in zip(factors, slopes, strict=True)]
    )
    scale = np.linalg.norm(taken, axis=0)
    taken = taken / np.where(scale > 0.0, scale, 1.0)
    x, *_ = np.linalg.lstsq(taken, left, rcond=None)
    return float(np.sum((left - taken @ x) ** 2))


def _slopes(
    study: BlindStudy, times: Sequence[np.ndarray], whole: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Return dF/dln(constant) of the law, (n, k) for each test."""
    constants = study.law.constants
    columns = []
    for k, value in enumerate(constants):
        moved = (*constants[:k], value * (1.0 + _STEP), *constants[k + 1 :])
        changed = study.forces(study.law.with_constants(moved), study.effects, times)
        columns.append([(a - b) / _STEP for a, b in zip(changed, whole, strict=True)])
    return [np.column_stack(test) for test in zip(*columns, strict=True)]


def _factors(
    study: BlindStudy, times: Sequence[np.ndarray], whole: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Return the Cholesky factor of the errors' covariance of every test."""
    factors = []
    for motion, t, force in zip(study.session.motions.values(), times, whole, strict=True):
        speed, slope = motion.velocity(t), np.gradient(force, t)
        covariance = study.cell.covariance(t, force, slope, speed, study.peak)
        if study.gain is not None:  # of all errors: the encoder's are small against such noise
            gain = study.gain.at(t, motion.duration)
            covariance = covariance * np.outer(gain, gain)
        floor = (_FLOOR * study.peak) ** 2 * np.eye(t.size)
        factors.append(np.linalg.cholesky(covariance + floor))
    return factors


def _some(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, _MOST)).astype(int))
