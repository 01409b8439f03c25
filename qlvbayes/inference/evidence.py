r"""Compute the evidence of a hypothesis by Laplace's method about a mode.

The density is taken as normal about the mode at every size s of the discrepancy, truncated at the
bounds l_j and h_j of the parameters, and the sizes are summed over:

.. math:: Z = \sum_s p(s)\, e^{-\ell_s + \frac12 g_s^T H_s^{-1} g_s} (2\pi)^{F/2} |H_s|^{-1/2}
          \prod_j \left[\Phi\left(\frac{h_j - \mu_j}{\sigma_j}\right)
          - \Phi\left(\frac{l_j - \mu_j}{\sigma_j}\right)\right]

Loss, gradient and curvature are those at the mode under each size. The result is exact where the
force is linear in the free parameters. The normal is also truncated some natural lengths from the
mode, as far as it can represent the density: its mean may lie anywhere under a size that leaves a
parameter undetermined. The prior of an amplitude excludes effects that are too small to matter
(`amplitude_prior`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, logsumexp, softmax

from qlvbayes.inference.density import Density, Point, Terms, positive_part
from qlvbayes.inference.modes import bounded_step, predicted_decrease
from qlvbayes.io.arrays import Array

_FAR = 2.0  # predicted gain of log density above which a point counts as far from a mode
_NEAR = 6.0  # natural lengths from a point up to which a normal may represent the density
_NEGLIGIBLE = 35.0  # log evidence below the likeliest size's from which a size is left out
_SINGULAR = 1e-14  # eigenvalues of a scaled curvature below this count as zero


@dataclass(frozen=True, eq=False)
class Evidence:
    """The log evidence of a hypothesis about one mode, with the normal approximation there."""

    log: float
    by_size: Array  # (S,): log evidence of each size of the discrepancy, prior included
    # mean (F,) and covariance (F, F): of the free parameters at the likeliest size, without the
    # bounds (a parameter between two bounds counts as normal with the sd that it has there)
    mean: Array
    covariance: Array
    # (F, F): additional covariance by which the discrepancy may have moved the parameters, over all
    # sizes
    spread: Array

    def probability_above(self, sizes: Array, size: float) -> float:
        """Return the posterior probability that the discrepancy is larger than a size (N)."""
        return float(np.exp(logsumexp(self.by_size[sizes > size]) - self.log))


def evidence(density: Density, point: Point, guess: float = 0.0) -> Evidence:
    """Return the evidence about a mode; ``guess`` (N) is near the likeliest size, if known.

    Sizes of the discrepancy that are e^35 times less probable than the likeliest are left out.
    """
    theta, reach = point.theta, _NEAR * point.own.length
    below = np.maximum(point.own.lowest - theta, -reach)
    above = np.minimum(point.own.highest - theta, reach)
    sizes, log_prior = density.discrepancy.sizes, density.discrepancy.log_prior
    likeliest = density.likeliest_size(point, guess)
    there = density.terms(point, likeliest)
    # whether a step from the point would still gain much
    far = predicted_decrease(there, bounded_step(there, 0.0, point)) > _FAR
    logs, known = np.full(sizes.size, -math.inf), {}
    start = int(np.argmin(np.abs(sizes - likeliest)))
    for way in (range(start, sizes.size), range(start - 1, -1, -1)):
        for k in way:
            terms = density.terms(point, float(sizes[k]))
            if far:
                terms = terms._replace(gradient=np.zeros_like(terms.gradient))
            log, shift = laplace(terms, below, above)
            logs[k], known[k] = log + log_prior[k], (terms, shift)
            if logs[k] < logs.max() - _NEGLIGIBLE:
                break
    best = int(np.argmax(logs))
    nothing = np.zeros((theta.size, theta.size))
    if not math.isfinite(logs[best]):
        return Evidence(-math.inf, logs, theta, np.eye(theta.size), nothing)
    terms, shift = known[best]
    # a parameter between two bounds has the sd that its prior has
    between = np.isfinite(point.own.lowest) & np.isfinite(point.own.highest)
    widths = np.where(between, point.own.length, math.inf)
    covariance = np.asarray(np.linalg.inv(terms.curvature + np.diag(widths**-2)))
    # what a discrepancy of the mean square size may have moved the parameters by
    size, moment = math.sqrt(float(softmax(logs) @ sizes**2)), nothing
    if size > 0.0 or any(point.separation.scatter.sizes):
        whole = point.separation.unseparated(density.discrepancy.at(size))
        moment = second_moment(point.terms(whole), point.own.length)
    spread = positive_part(moment - covariance)
    return Evidence(float(logsumexp(logs)), logs, theta + shift, covariance, spread)


def second_moment(terms: Terms, lengths: Array) -> Array:
    """Return the second moment (F, F) of parameters about the point of an expansion."""
    covariance = np.linalg.inv(terms.curvature + np.diag(lengths**-2.0))
    step = -covariance @ terms.gradient
    step /= max(1.0, float(np.max(np.abs(step) / lengths)))
    return np.asarray(covariance + np.outer(step, step))


def laplace(terms: Terms, below: Array, above: Array) -> tuple[float, Array]:
    """Return the log evidence of an expansion, and by how much (F,) its normal's mean is off."""
    diagonal = np.maximum(np.diag(terms.curvature), 1e-300)
    scale = np.sqrt(np.outer(diagonal, diagonal))
    values, vectors = np.linalg.eigh(terms.curvature / scale)
    if not values[0] > _SINGULAR:
        return -math.inf, np.zeros_like(terms.gradient)
    inverse = (vectors / values) @ vectors.T / scale
    shift = -inverse @ terms.gradient
    log = -float(terms.loss) - 0.5 * float(terms.gradient @ shift)
    log += 0.5 * (diagonal.size * math.log(2.0 * math.pi) - np.log(values).sum())
    log -= 0.5 * np.log(diagonal).sum()
    bounded = np.isfinite(below) | np.isfinite(above)
    sds, mean = np.sqrt(np.diag(inverse)[bounded]), shift[bounded]
    log += _log_between((below[bounded] - mean) / sds, (above[bounded] - mean) / sds).sum()
    return log, shift


def _log_between(low: Array, high: Array) -> Array:
    """Return the log probability of a standard normal between two bounds, accurate in the tails."""
    turned = low > 0.0
    low, high = np.where(turned, -high, low), np.where(turned, -low, high)
    upper = log_ndtr(high)
    gap = np.minimum(log_ndtr(low) - upper, -1e-300)
    return np.asarray(upper + np.log(-np.expm1(gap)))
