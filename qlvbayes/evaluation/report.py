"""All figures of a benchmark in one place, what is hidden against what is said among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.effects.catalogue import names
from qlvbayes.evaluation.constants import Constant, constants
from qlvbayes.evaluation.plan import Plan
from qlvbayes.evaluation.rate import Case, Rate
from qlvbayes.evaluation.reliability import Reliability
from qlvbayes.evaluation.scores import ceiling, could_be_seen, heldout, promised, rates
from qlvbayes.simulate import FORMS, OUTSIDE

_TWO, _SEVERAL = "two effects", "several"
_SHORT = ("index", "kind", "names", "protocol", "seen", "verdict", "effects", "group")


@dataclass(frozen=True)
class Confusion:
    """Counts [row][column]: studies with ``rows[row]`` hidden and ``columns[column]`` said."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    counts: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, cases: Sequence[Case]) -> Confusion:
        """Count; rows without any study are left out."""
        listed = names()
        rows = ("none", *listed, _TWO, *FORMS, *OUTSIDE)
        left = ("ambiguous", "partly_explained", "unexplained", "failed")
        columns = ("none", *listed, _SEVERAL, *left)
        pairs = [(truth(case), said(case)) for case in cases]
        present = tuple(row for row in rows if any(true == row for true, _ in pairs))
        counts = tuple(tuple(pairs.count((row, column)) for column in columns) for row in present)
        return cls(present, columns, counts)

    def as_dict(self) -> dict:
        """For JSON."""
        return {"rows": self.rows, "columns": self.columns, "counts": self.counts}


def truth(case: Case) -> str:
    """What is hidden, in a word."""
    if case["kind"] == "double":
        return _TWO
    return case["names"][0] if case["names"] else "none"


def said(case: Case) -> str:
    """What the verdict says, in a word."""
    if case["verdict"] == "adequate":
        return "none"
    if case["verdict"] == "missing_effect":
        return case["effects"][0] if len(case["effects"]) == 1 else _SEVERAL
    return str(case["verdict"])


@dataclass(frozen=True)
class Report:
    """What the studies of a plan say about the diagnosis.

    rates: [question][all, seen]; heldout: [kind]; reliability: over all studies, and seen: over
    those that could be seen; ceiling: what the noise lets any diagnosis name of single effects;
    promised: mean probability of the first-ranked hypothesis there.
    """

    plan: Plan
    cases: tuple[Case, ...]
    rates: dict[str, dict[str, Rate]]
    confusion: Confusion
    reliability: Reliability
    reliability_seen: Reliability
    heldout: dict[str, dict[str, float | int | None]]
    constants: dict[str, Constant]
    ceiling: float | None
    promised: float | None

    @classmethod
    def of(cls, plan: Plan, cases: Sequence[Case]) -> Report:
        """Score finished studies."""
        seen = could_be_seen(cases)
        return cls(
            plan,
            tuple(cases),
            rates(cases),
            Confusion.of(cases),
            Reliability.of(cases),
            Reliability.of(seen),
            heldout(cases),
            constants(cases),
            ceiling(cases),
            promised(cases),
        )

    @property
    def seconds(self) -> float | None:
        """Median time of a diagnosis, s."""
        found = [case["seconds"]["diagnose"] for case in self.cases if case["seconds"]]
        return float(np.median(found)) if found else None

    def as_dict(self) -> dict:
        """The content of ``benchmark.json``."""
        return {
            "schema": 1,
            "seed": self.plan.seed,
            "noise": self.plan.noise,
            "hidden_alone": list(self.plan.effects),
            "studies": len(self.cases),
            "median_seconds": self.seconds,
            "rates": {
                name: {which: rate.as_dict() for which, rate in found.items()}
                for name, found in self.rates.items()
            },
            "confusion": self.confusion.as_dict(),
            "reliability": {
                "all": self.reliability.as_dict(),
                "seen": self.reliability_seen.as_dict(),
            },
            "single_ceiling": self.ceiling,
            "single_promised": self.promised,
            "heldout_over_noise": self.heldout,
            "constants": {name: found.as_dict() for name, found in self.constants.items()},
            "cases": [{key: case[key] for key in _SHORT} for case in self.cases],
        }
