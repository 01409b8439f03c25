r"""Constants averaged over all hypotheses that have them.

With weights w proportional to the posterior probability of each hypothesis (Hoeting et al. 1999,
doi:10.1214/ss/1009212519),

.. math:: \mu = \sum_k w_k \mu_k, \quad \sigma^2 = \sum_k w_k (\sigma_k^2 + (\mu_k - \mu)^2)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import softmax

from qlvbayes.diagnosis.result import Estimate


def averaged(
    log_weights: Sequence[float], hypotheses: Sequence[Mapping[str, Estimate]]
) -> dict[str, Estimate]:
    """Mean and sd of every constant that all hypotheses have."""
    weights = softmax(np.asarray(log_weights, dtype=float))
    first, *others = hypotheses
    return {
        name: _mixture(weights, [found[name] for found in hypotheses])
        for name in first
        if all(name in found for found in others)
    }


def _mixture(weights: np.ndarray, found: Sequence[Estimate]) -> Estimate:
    means, sds = (np.array([getattr(e, key) for e in found]) for key in ("mean", "sd"))
    mean = float(weights @ means)
    variance = float(weights @ (sds**2 + (means - mean) ** 2))
    return Estimate(found[0].unit, mean, variance**0.5)
