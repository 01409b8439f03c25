"""Rates of finished studies with their bounds, by stratum; reliability, errors, coverage."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy.stats import binomtest

from blind.catalogue import FOREIGN, FORMS, FURTHER, OUTSIDE
from blind.constants import coverage
from blind.counting import (
    COUNTS,
    Case,
    Count,
    Rate,
    bound,
    counted,
    is_right,
    names_wrongly,
)
from blind.population import KINDS, Population
from qlvbayes.effects.catalogue import names

BINS = 10  # of stated probability: tenths
SEVERAL, WITH_LISTED = "several", "unlisted with listed"
"""Two listed effects, and an unlisted effect together with a listed one, in the confusion
matrix."""


@dataclass(frozen=True)
class Confusion:
    """Numbers of studies by what is hidden (``rows``) and by the verdict (``columns``)."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    counts: tuple[tuple[int, ...], ...]

    @classmethod
    def from_cases(cls, cases: Sequence[Case]) -> Confusion:
        """Count the studies; rows without any are left out."""
        listed = names()
        unlisted = (*FORMS, *FOREIGN, *OUTSIDE, *FURTHER)
        rows = ("none", *listed, SEVERAL, *unlisted, WITH_LISTED)
        left = ("ambiguous", "partly_explained", "unexplained", "failed")
        columns = ("none", *listed, SEVERAL, *left)
        pairs = [(_hidden(case), _verdict(case)) for case in cases]
        present = tuple(row for row in rows if any(hidden == row for hidden, _ in pairs))
        counts = tuple(tuple(pairs.count((row, column)) for column in columns) for row in present)
        return cls(present, columns, counts)


def _hidden(case: Case) -> str:
    if case["kind"] == "double":
        return SEVERAL
    if case["kind"] == "outside_beside":
        return WITH_LISTED
    return case["names"][0] if case["names"] else "none"


def _verdict(case: Case) -> str:
    if case["verdict"] == "adequate":
        return "none"
    if case["verdict"] == "missing_effect":
        if not case["effects"]:
            return "none"  # the rig's own gap alone
        return case["effects"][0] if len(case["effects"]) == 1 else SEVERAL
    return str(case["verdict"])


@dataclass(frozen=True)
class Report:
    """Finished studies of one population, and their rates."""

    population: Population
    cases: tuple[Case, ...]

    @property
    def seen(self) -> tuple[Case, ...]:
        """Studies whose hidden effects the tests could show; where nothing is hidden, all."""
        return tuple(case for case in self.cases if case["seen"])

    def rate(self, count: Count) -> Rate:
        """Return one rate over all studies that could be seen."""
        return counted(self.cases, count)

    def by_level(self) -> dict[str, dict[str, dict[str, dict]]]:
        """Return [stratum][level]: right by kind and wrong names, of the studies that were seen."""
        strata: dict[str, dict[str, dict[str, dict]]] = {}
        for stratum, levels in self.population.strata.items():
            strata[stratum] = {}
            for level in levels:
                some = [case for case in self.seen if case["strata"][stratum] == level]
                right, wrong = (Rate.from_cases(some, hit) for hit in (is_right, names_wrongly))
                every = sum(case["strata"][stratum] == level for case in self.cases)
                strata[stratum][level] = {
                    "studies": every, "right": _bounded(right, True),
                    "wrong": _bounded(wrong, False),
                }  # fmt: skip
        return strata

    def reliability(self) -> list[dict]:
        """Return the stated probability of an effect against the share in which it is hidden.

        Every listed effect of every study counts, by tenths of probability; ``kept`` are those that
        no veto refused.
        """
        stated = [one for case in self.cases for one in _stated(case)]
        probability = np.array([one.probability for one in stated])
        tenth = np.minimum((probability * BINS).astype(int), BINS - 1).tolist()
        rows = []
        for k in sorted(set(tenth)):
            some = [one for one, its in zip(stated, tenth, strict=True) if its == k]
            kept = [one for one in some if not one.refused]
            row = {"low": k / BINS, "high": (k + 1) / BINS, "all": _right(some)}
            rows.append(row | {"kept": _right(kept)})
        return rows

    def heldout(self) -> dict[str, dict[str, float | int | None]]:
        """Return the medians of `heldout_ratios` by kind, of the studies that could be seen."""
        medians: dict[str, dict[str, float | int | None]] = {}
        for kind in KINDS:
            ratios = heldout_ratios([case for case in self.seen if case["kind"] == kind])
            before, after = np.median(ratios, axis=0).tolist() if ratios else (None, None)
            medians[kind] = {"n": len(ratios), "plain": before, "final": after}
        return medians

    @property
    def seconds(self) -> float | None:
        """Median time of a study, s."""
        times = [sum(case["seconds"].values()) for case in self.cases if case["seconds"]]
        return float(np.median(times)) if times else None

    def as_dict(self) -> dict:
        """Return plain values for JSON, with every study whole."""
        return {
            "schema": 1,
            "population": "paper" if self.population.paper else "wide",
            "seed": self.population.seed,
            "noise": self.population.noise if self.population.paper else None,
            "hidden_alone": list(self.population.effects),
            "studies": len(self.cases),
            "median_seconds": self.seconds,
            "rates": {c.name: _bounded(self.rate(c), c.good) for c in COUNTS},
            "strata": self.by_level(),
            "reliability": self.reliability(),
            "confusion": asdict(Confusion.from_cases(self.cases)),
            "heldout_over_noise": self.heldout(),
            "constants": {name: one.as_dict() for name, one in coverage(self.cases).items()},
            "cases": list(self.cases),
        }


def heldout_ratios(cases: Sequence[Case]) -> list[tuple[float, float]]:
    """Return the error on left-out tests over the noise, of the first model and the last one.

    Studies without left-out tests, or in which the program stopped, are skipped.
    """
    ratios = []
    for case in cases:
        stages = case.get("stages", ())
        errors = [stage["heldout_rmse"] for stage in (*stages[:1], *stages[-1:])]
        if errors and None not in errors:
            ratios.append((errors[0] / case["floor"], errors[1] / case["floor"]))
    return ratios


def _bounded(rate: Rate, good: bool) -> dict:
    limit = bound(rate, good) if rate.n else None
    return {"hits": rate.hits, "n": rate.n, "share": rate.share, "bound95": limit}


@dataclass(frozen=True)
class _StatedProbability:
    """One effect of one study: its probability, whether it is hidden, and whether refused."""

    probability: float
    hidden: bool
    refused: bool


def _stated(case: Case) -> Iterator[_StatedProbability]:
    """Yield every effect ranked, less those that count neither as wanted nor as wrong."""
    hidden = set(case["names"]).union(*case["kin"].values())
    refused = {name for name, _ in case.get("refused", ())}
    for name, probability in case.get("probabilities", {}).items():
        alone = case | {"verdict": "missing_effect", "effects": [name]}
        wrong = names_wrongly(alone)
        if name != "none" and (wrong or name in hidden):
            yield _StatedProbability(probability, not wrong, name in refused)


def _right(some: Sequence[_StatedProbability]) -> dict:
    """Return the mean probability and the share hidden with its two-sided 95 % bounds.

    The bounds are those of Clopper and Pearson (1934).
    """
    if not some:
        return {"mean": None, "hits": 0, "n": 0, "share": None, "bounds95": None}
    rate = Rate(sum(one.hidden for one in some), len(some))
    limits = binomtest(rate.hits, rate.n).proportion_ci()
    return {
        "mean": float(np.mean([one.probability for one in some])),
        "hits": rate.hits, "n": rate.n, "share": rate.share,
        "bounds95": [float(limits.low), float(limits.high)],
    }  # fmt: skip
