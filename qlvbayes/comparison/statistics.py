"""Statistics of a comparison: the joint test of all shared constants, and the spread of specimens.

Of two fluids with several specimens each, the draws are those of the fluids' own values.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from qlvbayes.comparison.contrast import Contrast, Omnibus

FALSE_ALARMS = 0.01  # share of equal pairs that are called different
_LEAST = 1e-6  # fraction below which its logarithm is cut
_FRACTION = re.compile(r"c\[(\d+)\]")
SPREAD = 0.3  # scale of the prior of the spread between specimens, relative
DRAWS = 4000  # of a fluid's own value
_POINTS = 2000  # of the grid of the spread


class Specimens(NamedTuple):
    """Posterior means and sds (n,) of one quantity of the specimens of one fluid."""

    mean: np.ndarray
    sd: np.ndarray


def joint_test(first: Mapping[str, np.ndarray], second: Mapping[str, np.ndarray]) -> Omnibus | None:
    r"""Return the chi-square of the difference between the posteriors' means.

    .. math:: T = (x_1 - x_2)^T (S_1 + S_2)^{-1} (x_1 - x_2)

    with means x and covariances S of the logarithms of positive constants, of log(c_i/c_0), and of
    the others themselves. For equal pads T is chi-square, as far as the posteriors are normal and
    their priors weak (Wald 1943, doi:10.1090/S0002-9947-1943-0012401-3). Constants that vary in
    neither are left out; None where none is left.
    """
    moved = [_coordinates(draws, (first, second)) for draws in (first, second)]
    names = [k for k in moved[0] if any(np.ptp(m[k]) > 0.0 for m in moved)]
    if not names:
        return None
    tables = [np.stack([m[k] for k in names]) for m in moved]
    gap = tables[0].mean(axis=1) - tables[1].mean(axis=1)
    spread = sum(np.cov(table).reshape(len(names), -1) for table in tables)
    scale = np.sqrt(np.diag(spread))  # scaled to one size, so that the rank is well defined
    statistic = float(
        (gap / scale) @ np.linalg.pinv(spread / np.outer(scale, scale)) @ (gap / scale)
    )
    p_value = float(chi2.sf(statistic, len(names)))
    return Omnibus(statistic, len(names), p_value, FALSE_ALARMS)


def smallest_tail(contrasts: Sequence[Contrast], over: str) -> Omnibus | None:
    """Return the smallest two-sided probability of a wrong direction, times their number."""
    if not contrasts:
        return None
    tails = [min(c.direction, 1.0 - c.direction) for c in contrasts]
    smallest = max(min(tails), 0.5 / DRAWS)
    return Omnibus(None, len(tails), min(1.0, 2.0 * smallest * len(tails)), FALSE_ALARMS, over)


def _coordinates(
    draws: Mapping[str, np.ndarray], both: Sequence[Mapping[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Return transformed constants, nearer to normal, without the sum of the fractions."""
    coordinates = {}
    for name, values in draws.items():
        if _FRACTION.fullmatch(name):
            if name != "c[0]":
                share, lasting = np.maximum([values, draws["c[0]"]], _LEAST)
                coordinates[name] = np.log(share) - np.log(lasting)
        else:
            positive = all(np.min(side[name]) > 0.0 for side in both)
            coordinates[name] = np.log(values) if positive else np.asarray(values)
    return coordinates


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
