"""How right the pad's constants are, without the hidden effect and with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.evaluation.modes import EXTRA, named_as_fitted
from qlvbayes.evaluation.rate import Case, Rate

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
    """One entry a constant, and ``all`` of them together."""
    some = [c for c in cases if c["kind"] == "single" and c["seen"] and "stages" in c]
    off = {name: np.array([_off(c, name) for c in some]) for name in _names(some)}
    if off:
        off["all"] = np.concatenate(list(off.values()))
    return {name: _constant(name, values) for name, values in off.items()}


def _names(cases: Sequence[Case]) -> list[str]:
    return list(cases[0]["constants"]) if cases else []


def _off(case: Case, name: str) -> tuple[float, float]:
    """abs(mean - truth)/sd of the plain model and of the last one."""
    first, last = case["stages"][0], case["stages"][-1]
    averaged = case.get("found", last["parameters"])
    before = _off_at(case["constants"], first["parameters"], name)
    return before, _off_at(_renamed(case, last), averaged, name)


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
