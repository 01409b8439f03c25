r"""The evidence of a hypothesis about a mode, the discrepancy's size summed over.

At every size s the density is taken as normal about the mode (Laplace), cut where a number
would fall beyond its bounds l_j and h_j:

.. math:: Z = \sum_s p(s)\, e^{-\ell_s + \frac12 g_s^T H_s^{-1} g_s} (2\pi)^{F/2} |H_s|^{-1/2}
          \prod_j \left[\Phi\left(\frac{h_j - \mu_j}{\sigma_j}\right)
          - \Phi\left(\frac{l_j - \mu_j}{\sigma_j}\right)\right]

with loss, gradient and curvature at the mode under that size: where the force is linear in what is
free it is exact. A number counts as far as a normal laid about the mode may tell, some natural
lengths: under a size that leaves it open the normal's own mean may lie anywhere. An amplitude's
prior leaves out what is too small to matter (`noticeable`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp, softmax

from qlvbayes.inference.density import Density, Point, Terms
from qlvbayes.inference.modes import bounded_step, promised

Array = NDArray[np.float64]


_FAR = 2.0  # log density below a mode, from which nothing normal can be laid about a place
_NEAR = 6.0  # natural lengths from a place, up to which a normal may stand for the density
_SINGULAR = 1e-14  # least eigenvalue of a scaled curvature that is told from nothing


@dataclass(frozen=True, eq=False)
class Evidence:
    """Log evidence; by_size (S,): of every size of the discrepancy, with its prior.

    mean (F,) and covariance (F, F): of the free numbers at the likeliest size, without the bounds
    (a number between two counts as normal with the sd that it has there); spread (F, F): by how
    much more what is missed may have moved them, over all sizes.
    """

    log: float
    by_size: Array
    mean: Array
    covariance: Array
    spread: Array

    def probability_above(self, sizes: Array, size: float) -> float:
        """Posterior probability that the discrepancy is larger than a size (N)."""
        return float(np.exp(logsumexp(self.by_size[sizes > size]) - self.log))


def evidence(density: Density, point: Point) -> Evidence:
    """About a mode.

    Where a step still promises much, nothing of what it promises is counted: a normal about the
    place itself, which says too little.
    """
    own = point.theta
    terms = density.terms_by_size(point)
    if _is_far(density, point):
        terms = terms._replace(gradient=np.zeros_like(terms.gradient))
    near = _NEAR * point.own.length
    below = np.maximum(point.own.lowest - own, -near)
    above = np.minimum(point.own.highest - own, near)
    logs, shifts = normals(terms, below, above)
    logs += density.discrepancy.log_prior
    best = int(np.argmax(logs))
    if not math.isfinite(logs[best]):
        return Evidence(-math.inf, logs, own, np.eye(own.size), np.zeros((own.size, own.size)))
    covariance = np.linalg.inv(terms.curvature[best] + np.diag(_widths(point) ** -2))
    return Evidence(
        float(logsumexp(logs)),
        logs,
        own + shifts[best],
        covariance,
        beyond(_spread(density, point, softmax(logs)), covariance),
    )


def _spread(density: Density, point: Point, weights: Array) -> Array:
    r"""(F, F) by how much what is missed may have moved the numbers, by the weights of its sizes.

    What the slopes have followed is not seen, but what they have not tells of it: beside a
    discrepancy that is not separated the numbers would be moved by \Delta, and be known to within
    H^{-1}. Their second moment about the fitted ones, \Delta \Delta^T + H^{-1}, is what they may be
    off by.
    """
    size = math.sqrt(float(weights @ density.discrepancy.sizes**2))
    if size == 0.0:
        return np.zeros((point.theta.size, point.theta.size))
    terms = point.terms(density.discrepancy.at(size))
    return moved(terms.gradient, terms.curvature, point.own.length)


def moved(gradient: Array, curvature: Array, lengths: Array) -> Array:
    """(F, F) second moment of numbers of a gradient and curvature (F,), (F, F) of minus the log.

    lengths (F,): natural ones, by no more than which a number is moved.
    """
    covariance = np.linalg.inv(curvature + np.diag(lengths**-2.0))
    step = -covariance @ gradient
    step /= max(1.0, float(np.max(np.abs(step) / lengths)))
    return np.asarray(covariance + np.outer(step, step))


def beyond(second: Array, known: Array) -> Array:
    """(F, F) what a second moment has more than a covariance, in the directions where it has."""
    values, vectors = np.linalg.eigh(second - known)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _is_far(density: Density, point: Point) -> bool:
    """Whether a step still promises much."""
    here = density.terms(point, density.likeliest_size(point))
    return promised(here, bounded_step(here, 0.0, point)) > _FAR


def _widths(point: Point) -> Array:
    """(F,) sd of a number that may lie anywhere between two bounds; of others infinite."""
    own = point.own
    between = np.isfinite(own.lowest) & np.isfinite(own.highest)
    return np.where(between, own.length, math.inf)


def normals(terms: Terms, below: Array, above: Array) -> tuple[Array, Array]:
    """Log evidence (S,) of terms of S sizes, and the normals' means (from the point).

    below, above (F,): the bounds from the point. Minus infinity where the curvature is not positive
    definite.
    """
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
    own = shift[:, bounded]
    log += _log_between((below[bounded] - own) / sds, (above[bounded] - own) / sds).sum(axis=1)
    return np.where(sound, log, -math.inf), shift


def _log_between(low: Array, high: Array) -> Array:
    """Log probability of a standard normal between two bounds, far out in a tail too."""
    turned = low > 0.0
    low, high = np.where(turned, -high, low), np.where(turned, -low, high)
    upper = log_ndtr(high)
    gap = np.minimum(log_ndtr(low) - upper, -1e-300)
    return np.asarray(upper + np.log(-np.expm1(gap)))
