"""Count how often each hidden effect was named: one row an effect, from finished pads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from qlvbayes.diagnosis.decision import Verdict
from qlvbayes.evaluation.study import FAILED, NOTHING

_NAMING = (Verdict.MISSING_EFFECT, Verdict.PARTLY_EXPLAINED)


@dataclass(frozen=True)
class EffectRow:
    """Pads that hide one effect, by verdict.

    share: median of the effect's largest contribution over the peak force; named: exactly the
    effect; grouped: it is in the group of an ambiguous verdict; wrong: another effect is named,
    alone or with it; silent: nothing is named; failed: the program stopped.
    """

    effect: str
    pads: int
    share: float
    named: int
    grouped: int
    wrong: int
    silent: int
    failed: int

    @property
    def bounds(self) -> tuple[float, float]:
        """95 % bounds (Clopper and Pearson 1934) of the share in which the verdict is right."""
        right = self.silent if self.effect == NOTHING else self.named
        limits = binomtest(right, self.pads).proportion_ci()
        return float(limits.low), float(limits.high)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self) | {"bounds95": list(self.bounds)}


def rows(cases: Sequence[dict[str, Any]], names: Sequence[str]) -> list[EffectRow]:
    """Count the pads of each effect of which any are finished, in the order of the names."""
    found = []
    for name in names:
        some = [case for case in cases if case["hidden"] == name]
        if some:
            share = float(np.median([case["share"] for case in some]))
            kinds = [outcome(case) for case in some]
            counts = (kinds.count(kind) for kind in OUTCOMES)
            found.append(EffectRow(name, len(some), share, *counts))
    return found


OUTCOMES = ("named", "grouped", "wrong", "silent", FAILED)
"""What may become of a pad, in the order of the columns."""


def outcome(case: dict[str, Any]) -> str:
    """Return what became of a pad, one of `OUTCOMES`."""
    if case["verdict"] == FAILED:
        return FAILED
    ambiguous = case["verdict"] == Verdict.AMBIGUOUS
    named = set(case["effects"][:-1] if ambiguous else case["effects"])
    if case["verdict"] not in (*_NAMING, Verdict.AMBIGUOUS):
        named = set()
    if named - {case["hidden"]}:
        return "wrong"
    if named:
        return "named"
    return "grouped" if ambiguous and case["hidden"] in case["group"] else "silent"
