"""Hierarchical comparison of two fluids, each with several specimens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SPREAD = 0.3  # scale of the prior of the spread between specimens, relative
DRAWS = 4000
_POINTS = 2000


@dataclass(frozen=True)
class Specimens:
    """Posterior means and sds (n,) of one quantity of the specimens of one fluid."""

    mean: np.ndarray
    sd: np.ndarray


def fluid_draws(
    groups: Sequence[Sequence[np.ndarray]], rng: np.random.Generator
) -> list[np.ndarray]:
    """Return draws (4000,) of one quantity of each fluid, from draws (n,) of its specimens."""
    logs = all(np.min(draws) > 0.0 for group in groups for draws in group)
    moved = [[np.log(x) if logs else x for x in group] for group in groups]
    seen = [
        Specimens(np.array([x.mean() for x in group]), np.array([x.std() for x in group]))
        for group in moved
    ]
    size = 1.0 if logs else float(np.mean([np.mean(np.abs(s.mean)) for s in seen]))
    if size == 0.0:
        return [np.zeros(DRAWS) for _ in groups]
    spreads, weights = spread_posterior(seen, SPREAD * size)
    chosen = spreads[rng.choice(len(spreads), DRAWS, p=weights)]
    columns = []
    for specimens in seen:
        centre, variance = _centre(specimens, chosen)
        draws = centre + np.sqrt(variance) * rng.standard_normal(DRAWS)
        columns.append(np.exp(draws) if logs else draws)
    return columns


def spread_posterior(groups: Sequence[Specimens], scale: float) -> tuple[np.ndarray, np.ndarray]:
    r"""Return a grid of the spread tau between specimens, and its probabilities.

    .. math:: y_{gj} \sim N(\theta_{gj}, s_{gj}), \theta_{gj} \sim N(\mu_g, \tau),
              p(\mu_g) \propto 1, \tau \sim \text{half-Cauchy}(\text{scale})

    with theta and mu integrated out in closed form (Gelman et al., Bayesian Data Analysis, 3rd ed.,
    section 5.4; the prior: Gelman 2006, doi:10.1214/06-BA117A).
    """
    # even in the prior's own probability, so that the prior's weights are equal
    quantile = (np.arange(_POINTS) + 0.5) / _POINTS
    spreads = scale * np.tan(0.5 * np.pi * quantile)
    log_density = np.zeros(_POINTS)
    for specimens in groups:
        variances = spreads[:, None] ** 2 + specimens.sd**2
        centre, variance = _centre(specimens, spreads)
        misfit = (specimens.mean - centre[:, None]) ** 2 / variances
        log_density += 0.5 * np.log(variance)
        log_density -= 0.5 * np.sum(np.log(variances) + misfit, axis=1)
    weights = np.exp(log_density - log_density.max())
    return spreads, weights / weights.sum()


def _centre(specimens: Specimens, spreads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and variance (T,) of a fluid's own value, given the spread (T,)."""
    precision = 1.0 / (spreads[:, None] ** 2 + specimens.sd**2)
    variance = 1.0 / precision.sum(axis=1)
    return variance * (precision * specimens.mean).sum(axis=1), variance
