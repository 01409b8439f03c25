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


def evidence(density: Density, point: Point) -> Evidence:
    """Return the evidence about a mode."""
    theta = point.theta
    terms = density.terms_by_size(point)
    if _is_far(density, point):
        terms = terms._replace(gradient=np.zeros_like(terms.gradient))
    reach = _NEAR * point.own.length
    below = np.maximum(point.own.lowest - theta, -reach)
    above = np.minimum(point.own.highest - theta, reach)
    logs, shifts = laplace_by_size(terms, below, above)
    logs += density.discrepancy.log_prior
    best = int(np.argmax(logs))
    if not math.isfinite(logs[best]):
        return Evidence(
            -math.inf, logs, theta, np.eye(theta.size), np.zeros((theta.size, theta.size))
        )
    covariance = np.linalg.inv(terms.curvature[best] + np.diag(_widths(point) ** -2))
    return Evidence(
        float(logsumexp(logs)),
        logs,
        theta + shifts[best],
        covariance,
        positive_part(_discrepancy_moment(density, point, softmax(logs)) - covariance),
    )


def _discrepancy_moment(density: Density, point: Point, weights: Array) -> Array:
    r"""Return the second moment (F, F) of the parameters about the mode, given a discrepancy."""
    size = math.sqrt(float(weights @ density.discrepancy.sizes**2))
    if size == 0.0 and not any(point.separation.scatter.sizes):
        return np.zeros((point.theta.size, point.theta.size))
    whole = density.discrepancy.unseparated(size, point.separation)
    return second_moment(point.terms(whole), point.own.length)


def second_moment(terms: Terms, lengths: Array) -> Array:
    """Return the second moment (F, F) of parameters about the point of an expansion."""
    covariance = np.linalg.inv(terms.curvature + np.diag(lengths**-2.0))
    step = -covariance @ terms.gradient
    step /= max(1.0, float(np.max(np.abs(step) / lengths)))
    return np.asarray(covariance + np.outer(step, step))


def _is_far(density: Density, point: Point) -> bool:
    """Return whether a step from the point would still gain much."""
    terms = density.terms(point, density.likeliest_size(point))
    return predicted_decrease(terms, bounded_step(terms, 0.0, point)) > _FAR


def _widths(point: Point) -> Array:
    """Return the sd (F,) of parameters between two bounds; infinity for the others."""
    parameters = point.own
    between = np.isfinite(parameters.lowest) & np.isfinite(parameters.highest)
    return np.where(between, parameters.length, math.inf)


def laplace_by_size(terms: Terms, below: Array, above: Array) -> tuple[Array, Array]:
    """Return log evidences (S,) of the expansions of S sizes, and the normals' means (S, F)."""
    count = terms.gradient.shape[-1]
    diagonal = np.maximum(np.einsum("sff->sf", terms.curvature), 1e-300)
    scale = np.sqrt(diagonal[:, :, None] * diagonal[:, None, :])
    values, vectors = np.linalg.eigh(terms.curvature / scale)
    sound = values[:, 0] > _SINGULAR
    values = np.where(sound[:, None], values, 1.0)
    inverse = (vectors / values[:, None, :]) @ vectors.transpose(0, 2, 1) / scale
    shift = -np.einsum("sfg,sg->sf", inverse, terms.gradient)
    log_det = np.log(values).sum(axis=1) + np.log(diagonal).sum(axis=1)
    log = -terms.loss - 0.5 * np.einsum("sf,sf->s", terms.gradient, shift)
    log += 0.5 * (count * math.log(2.0 * math.pi) - log_det)
    bounded = np.isfinite(below) | np.isfinite(above)
    sds = np.sqrt(np.einsum("sff->sf", inverse)[:, bounded])
    mean = shift[:, bounded]
    log += _log_between((below[bounded] - mean) / sds, (above[bounded] - mean) / sds).sum(axis=1)
    return np.where(sound, log, -math.inf), shift


def _log_between(low: Array, high: Array) -> Array:
    """Return the log probability of a standard normal between two bounds, accurate in the tails."""
    turned = low > 0.0
    low, high = np.where(turned, -high, low), np.where(turned, -low, high)
    upper = log_ndtr(high)
    gap = np.minimum(log_ndtr(low) - upper, -1e-300)
    return np.asarray(upper + np.log(-np.expm1(gap)))
