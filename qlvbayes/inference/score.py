r"""What an effect more promises, from the slope of the force at its null alone.

Beside a mode of curvature H and gradient g, a new amplitude a with whitened slope k adds (a score
test; Rao 1948, doi:10.1017/S0305004100023987)

.. math:: u = J Q k, \quad \kappa = k^T Q k - u^T H^{-1} u + \pi'', \quad
          \gamma = -k^T Q r - u^T H^{-1} g + \pi'

and where the force is linear in all that is free the log evidence rises by

.. math:: \tfrac12 \gamma^2/\kappa - \tfrac12 \ln (\kappa / 2 \pi) + \ln \pi(a_0)
          + \ln P(a\ \text{above its least value}),

at every size of the discrepancy, over which evidences are summed. An effect whose force begins
without a slope (a tension that lets go at its strength) is taken along secants instead, over a
quarter, a half, one and two sds of its amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from qlvbayes.inference.density import Density, Extension, Point

Array = NDArray[np.float64]


def promised_evidence(
    density: Density, point: Point, by_size: Array, added: Sequence[Extension]
) -> Array:
    """(K,) log evidence of K hypotheses of one effect more than the point's.

    by_size: the point's own evidence at every size of the discrepancy.
    """
    more = np.array([one.white for one in added])
    slope, prior_curvature, log_prior, least = np.array([_prior_of(one) for one in added]).T
    total = []
    for size, log in zip(density.discrepancy.sizes.tolist(), by_size, strict=True):
        gradient, free = point.beyond(more, density.discrepancy.at(size, point.separation))
        curvature = np.maximum(np.diag(free), 0.0) + prior_curvature
        gradient += slope
        gain = 0.5 * gradient**2 / curvature - 0.5 * np.log(curvature / (2.0 * math.pi))
        inside = log_ndtr(-(gradient / curvature + least) * np.sqrt(curvature))
        total.append(log + gain + log_prior + inside)
    return np.asarray(logsumexp(total, axis=0))


def _prior_of(one: Extension) -> tuple[float, float, float, float]:
    """Gradient and curvature of minus the amplitude's log prior, its log density, least step."""
    place = float(one.theta[one.number])
    own = one.own.quadratic(one.number)
    apart = place - own.mean
    log = own.top - 0.5 * own.precision * apart**2
    return own.precision * apart, own.curvature, log, own.lowest - place
