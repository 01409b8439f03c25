r"""Coverage of the pad's constants, without the hidden effect and with it.

Which relaxation mode is called the extra one is arbitrary, as the data show only the sum. With an
extra mode, :math:`G = (1 - c) \sum_k c_k e^{-v_k t} + c e^{-v t}`: a fit may call one of the pad's
own modes the extra one, and the extra one its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from blind.counting import Case, Rate
from blind.laws import Law

EXTRA = "extra_relaxation_mode"
HALF_WIDTH = 1.645  # sds, of a 90 % interval
_LAWS = ("exponential", "prony:2")  # elastic, relaxation: their constants have the fit's names


@dataclass(frozen=True)
class Coverage:
    """Coverage of one constant over the studies in which one effect is hidden and can be seen.

    before, after: how often mean ± 1.645 sd contains the truth, in the model without effects and in
    the last one; error_before, error_after: median of abs(mean - truth)/sd.
    """

    name: str
    before: Rate
    after: Rate
    error_before: float
    error_after: float


def coverage(cases: Sequence[Case]) -> dict[str, Coverage]:
    """Return the coverage of each constant, and of all together under ``all``.

    Studies count whose pad has the paper's laws and whose diagnosis ended with them.
    """
    errors: dict[str, list[tuple[float, float]]] = {}
    for case in cases:
        for name, pair in errors_of(case).items():
            errors.setdefault(name, []).append(pair)
    if errors:
        errors["all"] = [pair for pairs in errors.values() for pair in pairs]
    return {name: _coverage(name, np.array(pairs)) for name, pairs in errors.items()}


def errors_of(case: Case) -> dict[str, tuple[float, float]]:
    """Return abs(mean - truth)/sd of each constant, before and after; empty if it does not count.

    A study that was kept with its errors only has them under ``errors``.
    """
    if "errors" in case:
        return {name: (before, after) for name, (before, after) in case["errors"].items()}
    counts = case["kind"] == "single" and case["seen"] and _has_the_papers_laws(case)
    return _errors(case) if counts else {}


def _has_the_papers_laws(case: Case) -> bool:
    law, stages = case.get("law", {}), case.get("stages", ())
    pairs = [(law.get("elastic"), law.get("relaxation")), *(tuple(s["base"]) for s in stages)]
    return len(stages) > 0 and set(pairs) == {_LAWS}


def _errors(case: Case) -> dict[str, tuple[float, float]]:
    """Return abs(mean - truth)/sd of each constant, in the first model and in the last one."""
    truth = true_values(Law(**case["law"]))
    first, last = case["stages"][0]["parameters"], case["stages"][-1]["parameters"]
    renamed = truth
    if EXTRA in case["stages"][-1]["effects"] and case["names"] == [EXTRA]:
        means = {key: mean for key, (mean, _) in last.items()}
        renamed = named_as_fitted(truth, case["hidden"][0]["parameters"], means)
    averaged: Mapping = case.get("found", last)
    return {
        name: (_error(truth[name], *first[name]), _error(renamed[name], *averaged[name]))
        for name in truth
        if name in first and name in averaged
    }


def true_values(law: Law) -> dict[str, float]:
    """Return the constants of the paper's laws by the names that a fit gives them."""
    values = dict(zip(("m", "b"), law.curve, strict=True))
    values |= {f"c[{k}]": c for k, c in enumerate(law.c)}
    return values | {f"v[{k}]": v for k, v in enumerate(law.v, start=1)}


def _error(truth: float, mean: float, sd: float) -> float:
    return abs(mean - truth) / sd if sd > 0.0 else np.inf


def _coverage(name: str, errors: np.ndarray) -> Coverage:
    before, after = (Rate(int(hits), len(errors)) for hits in (errors <= HALF_WIDTH).sum(axis=0))
    return Coverage(name, before, after, *map(float, np.median(errors, axis=0)))


def named_as_fitted(
    truth: Mapping[str, float], hidden: Mapping[str, float], fitted: Mapping[str, float]
) -> dict[str, float]:
    """Return the true constants under the names that a fit with an extra mode gave its modes.

    truth: constants with c[0], c[1], v[1] (1/s) and so on, fastest mode first; hidden: c and v of
    the extra mode; fitted: constants by name, with those of the extra mode. Of all choices of the
    mode that is called the extra one, that whose rates are nearest to the fitted ones, in ratio, is
    used.
    """
    names = [name for name in truth if name.startswith("v[")]
    rates = np.array([*(truth[name] for name in names), hidden["v"]])
    shares = np.array([truth[name.replace("v", "c")] for name in names]) * (1.0 - hidden["c"])
    shares = np.append(shares, hidden["c"])
    fitted_rates = np.array([*(fitted[name] for name in names), fitted[f"{EXTRA}.v"]])
    orders = [_with_extra(k, rates) for k in range(rates.size)]
    order = min(orders, key=lambda order: np.abs(np.log(rates[order] / fitted_rates)).sum())
    own, left = order[:-1], 1.0 - shares[order[-1]]
    values = dict(truth) | {"c[0]": truth["c[0]"] * (1.0 - hidden["c"]) / left}
    values |= {name.replace("v", "c"): shares[k] / left for name, k in zip(names, own, strict=True)}
    return values | {name: rates[k] for name, k in zip(names, own, strict=True)}


def _with_extra(k: int, rates: np.ndarray) -> np.ndarray:
    """Return the indices of the modes, fastest first, with the k-th at the end as the extra one."""
    order = np.argsort(-rates)
    return np.append(order[order != k], k)
