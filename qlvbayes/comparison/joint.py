"""Joint test of all shared constants of two pads."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import chi2

from qlvbayes.comparison.contrast import Contrast, Omnibus

FALSE_ALARMS = 0.01  # share of equal pairs that are called different
_LEAST = 1e-6  # fraction below which its logarithm is cut
_FRACTION = re.compile(r"c\[(\d+)\]")


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


def smallest_tail(contrasts: Sequence[Contrast], draws: int) -> Omnibus | None:
    """Return the smallest two-sided probability of a wrong direction, times their number."""
    if not contrasts:
        return None
    tails = [min(c.direction, 1.0 - c.direction) for c in contrasts]
    smallest = max(min(tails), 0.5 / draws)
    return Omnibus(None, len(tails), min(1.0, 2.0 * smallest * len(tails)), FALSE_ALARMS)


def _coordinates(
    draws: Mapping[str, np.ndarray], both: Sequence[Mapping[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Return transformed constants, nearer to normal, without the sum of the fractions."""
    coordinates = {}
    for name, values in draws.items():
        if _FRACTION.fullmatch(name):
            if name != "c[0]":
                coordinates[name] = _log(values) - _log(draws["c[0]"])
        elif all(np.min(side[name]) > 0.0 for side in both):
            coordinates[name] = np.log(values)
        else:
            coordinates[name] = np.asarray(values)
    return coordinates


def _log(fraction: np.ndarray) -> np.ndarray:
    return np.log(np.maximum(fraction, _LEAST))
