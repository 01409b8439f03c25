"""All figures of the wide population: rates with their bounds, by stratum, and reliability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.evaluation.counting import COUNTS, Count, bound, counted, is_right, names_wrongly
from qlvbayes.evaluation.population import STRATA
from qlvbayes.evaluation.rate import Case, Rate

_BINS = 5  # of stated probability: fifths, as tenths would hold too few studies


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
        """Mean probability of the first-ranked hypothesis against its share right, by fifths.

        Of the studies with nothing or one listed effect hidden.
        """
        pairs = [_first(c) for c in self.cases if c["kind"] in ("none", "single")]
        known = [pair for pair in pairs if pair is not None]
        rows = []
        for k in range(_BINS):
            some = [p for p in known if min(int(p[0] * _BINS), _BINS - 1) == k]
            if some:
                rate = Rate(sum(right for _, right in some), len(some))
                rows.append({"mean": float(np.mean([p for p, _ in some])), **_shown(rate, True)})
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


def _first(case: Case) -> tuple[float, bool] | None:
    ranked = case.get("probabilities")
    if not ranked:
        return None
    best = max(ranked, key=lambda name: ranked[name])
    return ranked[best], best == (case["names"][0] if case["names"] else "none")
