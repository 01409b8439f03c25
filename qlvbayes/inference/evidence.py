r"""The evidence of a hypothesis about a mode, the discrepancy's size summed over.

At every size s the density is taken as normal about the mode (Laplace), cut where an amplitude
would fall below its bound:

.. math:: Z = \sum_s p(s)\, e^{-\ell_s + \frac12 g_s^T H_s^{-1} g_s} (2\pi)^{F/2} |H_s|^{-1/2}
          \prod_j \Phi(\mu_j / \sigma_j)

with loss, gradient and curvature at the mode under that size: where the force is linear in what is
free it is exact. An amplitude's prior leaves out what is too small to matter (`noticeable`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.special import log_ndtr, logsumexp

from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.modes import bounded_step, promised

Array = NDArray[np.float64]


_FAR = 2.0  # log density below a mode, from which nothing normal can be laid about a place


@dataclass(frozen=True, eq=False)
class Evidence:
    """Log evidence; by_size (S,): of every size of the discrepancy, with its prior.

    mean (F,) and covariance (F, F): of the free numbers at the likeliest size, without the bounds.
    """

    log: float
    by_size: Array
    mean: Array
    covariance: Array

    def probability_above(self, sizes: Array, size: float) -> float:
        """Posterior probability that the discrepancy is larger than a size (N)."""
        return float(np.exp(logsumexp(self.by_size[sizes > size]) - self.log))


def evidence(density: Density, point: Point, *, linear: bool = False) -> Evidence:
    """About a mode; linear: the force is taken as linear in what is free, wherever the place is.

    Else, where a step still promises much, nothing of what it promises is counted: a normal about
    the place itself, which says too little.
    """
    lowest, length, own = point.own.lowest, point.own.length, point.theta
    logs, best = [], (-math.inf, own, np.eye(own.size))
    here = density.terms(point, density.likeliest_size(point))
    step = bounded_step(here, 0.0, lowest - own, length)
    still = not linear and promised(here, step) > _FAR
    for size, log_prior in zip(
        density.discrepancy.sizes, density.discrepancy.log_prior, strict=True
    ):
        found = _normal(density, point, float(size), lowest - own, still)
        log = -math.inf
        if found is not None:
            log, shift, covariance = found[0] + log_prior, found[1], found[2]
            if log > best[0]:
                best = (log, own + shift, covariance)
        logs.append(log)
    return Evidence(float(logsumexp(logs)), np.array(logs), best[1], best[2])


def _normal(
    density: Density, point: Point, size: float, room: Array, still: bool
) -> tuple[float, Array, Array] | None:
    """Log evidence at one size, and the normal's mean (from the point) and covariance.

    still: the mean is the point.
    """
    terms = density.terms(point, size)
    if still:
        terms = terms._replace(gradient=np.zeros_like(terms.gradient))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(terms.curvature), 1e-300))
    try:
        factor = cho_factor(terms.curvature * np.outer(scale, scale), lower=True)
    except LinAlgError:
        return None
    inverse = cho_solve(factor, np.eye(scale.size)) * np.outer(scale, scale)
    shift = -inverse @ terms.gradient
    log_det = 2.0 * float(np.log(np.diag(factor[0])).sum() - np.log(scale).sum())
    log = -terms.loss - 0.5 * float(terms.gradient @ shift)
    log += 0.5 * (scale.size * math.log(2.0 * math.pi) - log_det)
    bounded = np.isfinite(room)
    inside = (shift - room)[bounded] / np.sqrt(np.diag(inverse)[bounded])
    return log + float(log_ndtr(inside).sum()), shift, inverse
