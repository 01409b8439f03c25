r"""Constants where several effects explain the tests alike: averaged by evidence.

With weights w proportional to the evidence of each explanation (Hoeting et al. 1999,
doi:10.1214/ss/1009212519),

.. math:: \mu = \sum_k w_k \mu_k, \quad \sigma^2 = \sum_k w_k (\sigma_k^2 + (\mu_k - \mu)^2)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import softmax

from qlvbayes.diagnosis.verdict import Estimate


def averaged(
    log_evidences: Sequence[float], explanations: Sequence[Mapping[str, Estimate]]
) -> dict[str, Estimate]:
    """Mean and sd of every constant that all explanations have."""
    weights = softmax(np.asarray(log_evidences, dtype=float))
    first, *others = explanations
    return {
        name: _mixture(weights, [found[name] for found in explanations])
        for name in first
        if all(name in found for found in others)
    }


def _mixture(weights: np.ndarray, found: Sequence[Estimate]) -> Estimate:
    means, sds = (np.array([getattr(e, key) for e in found]) for key in ("mean", "sd"))
    mean = float(weights @ means)
    variance = float(weights @ (sds**2 + (means - mean) ** 2))
    return Estimate(found[0].unit, mean, variance**0.5)
