r"""Which relaxation mode is the extra one is a matter of name: the data see their sum alone.

With an extra mode, :math:`G = (1 - c) \sum_k c_k e^{-v_k t} + c e^{-v t}`. A fit may call one of
the pad's own modes the extra one, and the extra one its own.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

EXTRA = "extra_relaxation_mode"


def named_as_fitted(
    truth: Mapping[str, float], hidden: Mapping[str, float], fitted: Mapping[str, float]
) -> dict[str, float]:
    """The pad's true constants under the names that a fit with an extra mode gave its modes.

    truth: constants with c[0], c[1], v[1] (1/s) and so on, fastest mode first; hidden: c and v of
    the extra mode; fitted: constants by name, the extra mode's too. Of all ways to call one mode
    the extra one, that whose rates are nearest to the fitted ones, in ratio, is taken.
    """
    names = [name for name in truth if name.startswith("v[")]
    rates = np.array([*(truth[name] for name in names), hidden["v"]])
    shares = np.array([truth[name.replace("v", "c")] for name in names]) * (1.0 - hidden["c"])
    shares = np.append(shares, hidden["c"])
    found = np.array([*(fitted[name] for name in names), fitted[f"{EXTRA}.v"]])
    orders = [_with_extra(k, rates) for k in range(rates.size)]
    order = min(orders, key=lambda order: np.abs(np.log(rates[order] / found)).sum())
    own, left = order[:-1], 1.0 - shares[order[-1]]
    values = dict(truth) | {"c[0]": truth["c[0]"] * (1.0 - hidden["c"]) / left}
    values |= {name.replace("v", "c"): shares[k] / left for name, k in zip(names, own, strict=True)}
    return values | {name: rates[k] for name, k in zip(names, own, strict=True)}


def _with_extra(k: int, rates: np.ndarray) -> np.ndarray:
    """Places of the modes, fastest first, the k-th at the end as the extra one."""
    order = np.argsort(-rates)
    return np.append(order[order != k], k)
