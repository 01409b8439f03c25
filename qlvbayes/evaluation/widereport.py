"""All figures of the wide population: rates with their bounds, by stratum, and reliability."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from qlvbayes.evaluation.counting import COUNTS, Count, bound, counted, is_right, names_wrongly
from qlvbayes.evaluation.population import STRATA
from qlvbayes.evaluation.rate import Case, Rate
from qlvbayes.evaluation.reliability import BINS, tenths


@dataclass(frozen=True)
class WideReport:
    """Finished studies of one seed and what they say."""

    seed: int
    cases: tuple[Case, ...]

    def rate(self, count: Count) -> Rate:
        """One rate over all studies."""
        return counted(self.cases, count)

    def by_level(self) -> dict[str, dict[str, dict[str, dict]]]:
        """[stratum][level]: right by kind and wrong names, of the studies that could be seen."""
        found: dict[str, dict[str, dict[str, dict]]] = {}
        for stratum, levels in STRATA.items():
            found[stratum] = {}
            for level in levels:
                some = [c for c in self.cases if c["strata"][stratum] == level and c["seen"]]
                right, wrong = Rate.of(some, is_right), Rate.of(some, names_wrongly)
                every = sum(c["strata"][stratum] == level for c in self.cases)
                found[stratum][level] = {
                    "studies": every, "right": _shown(right, True), "wrong": _shown(wrong, False),
                }  # fmt: skip
        return found

    def reliability(self) -> list[dict]:
        """Stated probability of an effect against the share in which it is hidden, by tenths.

        Of every listed effect of every study; ``kept`` are those that no veto refused.
        """
        told = [one for case in self.cases for one in _stated(case)]
        place = tenths(np.array([one.probability for one in told])).tolist()
        rows = []
        for k in sorted(set(place)):
            some = [one for one, its in zip(told, place, strict=True) if its == k]
            kept = [one for one in some if not one.refused]
            rows.append(
                {
                    "low": k / BINS,
                    "high": (k + 1) / BINS,
                    "all": _right(some),
                    "kept": _right(kept),
                }
            )
        return rows

    @property
    def seconds(self) -> float | None:
        """Median time of a study, s."""
        found = [sum(c["seconds"].values()) for c in self.cases if c["seconds"]]
        return float(np.median(found)) if found else None

    def as_dict(self) -> dict:
        """For JSON, with every study whole."""
        return {
            "schema": 1,
            "population": "wide",
            "seed": self.seed,
            "studies": len(self.cases),
            "median_seconds": self.seconds,
            "rates": {c.name: _shown(self.rate(c), c.good) for c in COUNTS},
            "strata": self.by_level(),
            "reliability": self.reliability(),
            "cases": list(self.cases),
        }


def _shown(rate: Rate, good: bool) -> dict:
    limit = bound(rate, good) if rate.n else None
    return {"hits": rate.hits, "n": rate.n, "share": rate.share, "bound95": limit}


@dataclass(frozen=True)
class _Stated:
    """One effect of one study: its probability, whether it is hidden, whether a veto refused it."""

    probability: float
    hidden: bool
    refused: bool


def _stated(case: Case) -> Iterator[_Stated]:
    """Every effect ranked, less those that count neither as wanted nor as wrong."""
    hidden = set(case["names"]).union(*case["kin"].values())
    refused = {name for name, _ in case.get("refused", ())}
    for name, probability in case.get("probabilities", {}).items():
        alone = case | {"verdict": "missing_effect", "effects": [name]}
        wrong = names_wrongly(alone)
        if name != "none" and (wrong or name in hidden):
            yield _Stated(probability, not wrong, name in refused)


def _right(some: Sequence[_Stated]) -> dict:
    """Mean probability and share hidden, with its two-sided 95 % bounds (Clopper-Pearson)."""
    if not some:
        return {"mean": None, "hits": 0, "n": 0, "share": None, "bounds95": None}
    rate = Rate(sum(one.hidden for one in some), len(some))
    limits = binomtest(rate.hits, rate.n).proportion_ci()
    return {
        "mean": float(np.mean([one.probability for one in some])),
        "hits": rate.hits, "n": rate.n, "share": rate.share,
        "bounds95": [float(limits.low), float(limits.high)],
    }  # fmt: skip
