r"""How right the pad's constants are, without the hidden effect and with it.

Which relaxation mode is the extra one is a matter of name, as the data see their sum alone. With an
extra mode, :math:`G = (1 - c) \sum_k c_k e^{-v_k t} + c e^{-v t}`: a fit may call one of the pad's
own modes the extra one, and the extra one its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.evaluation.rate import Case, Rate

EXTRA = "extra_relaxation_mode"
HALF_WIDTH = 1.645  # sds, of a 90 % interval


@dataclass(frozen=True)
class Constant:
    """One constant of the pad over the studies in which one effect is hidden and could be seen.

    before, after: how often mean ± 1.645 sd holds the truth, of the plain model and of the last
    one; off_before, off_after: median of abs(mean - truth)/sd.
    """

    name: str
    before: Rate
    after: Rate
    off_before: float
    off_after: float

    def as_dict(self) -> dict:
        """For JSON."""
        return {
            "coverage_before": self.before.as_dict(),
            "coverage_after": self.after.as_dict(),
            "median_error_over_sd_before": _finite(self.off_before),
            "median_error_over_sd_after": _finite(self.off_after),
        }


def constants(cases: Sequence[Case]) -> dict[str, Constant]:
    """One entry a constant, and ``all`` of them together.

    A study that is told on laws without a constant of that name says nothing of it.
    """
    some = [c for c in cases if c["kind"] == "single" and c["seen"] and "stages" in c]
    told = {name: [_off(c, name) for c in some if name in _told(c)] for name in _names(some)}
    off = {name: np.array(values) for name, values in told.items() if values}
    if off:
        off["all"] = np.concatenate(list(off.values()))
    return {name: _constant(name, values) for name, values in off.items()}


def _names(cases: Sequence[Case]) -> list[str]:
    return list(cases[0]["constants"]) if cases else []


def _off(case: Case, name: str) -> tuple[float, float]:
    """abs(mean - truth)/sd of the plain model and of the last one."""
    first, last = case["stages"][0], case["stages"][-1]
    before = _off_at(case["constants"], first["parameters"], name)
    return before, _off_at(_renamed(case, last), _told(case), name)


def _told(case: Case) -> Mapping:
    """Mean and sd of the constants of the laws told, averaged over what is likely."""
    averaged: Mapping = case.get("found", case["stages"][-1]["parameters"])
    return averaged


def _renamed(case: Case, stage: Mapping) -> Mapping[str, float]:
    """The true constants, modes under the names of the fit."""
    truth: Mapping[str, float] = case["constants"]
    if EXTRA not in stage["effects"] or case["names"] != [EXTRA]:
        return truth
    means = {key: mean for key, (mean, _) in stage["parameters"].items()}
    return named_as_fitted(truth, case["hidden"][0]["parameters"], means)


def _off_at(truth: Mapping[str, float], found: Mapping, name: str) -> float:
    mean, sd = found[name]
    return abs(mean - truth[name]) / sd if sd > 0.0 else np.inf


def _constant(name: str, off: np.ndarray) -> Constant:
    before, after = (Rate(int(hits), len(off)) for hits in (off <= HALF_WIDTH).sum(axis=0))
    return Constant(name, before, after, *map(float, np.median(off, axis=0)))


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


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
