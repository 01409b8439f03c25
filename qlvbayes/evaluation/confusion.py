"""The confusion matrix: what is hidden against what the verdict says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qlvbayes.effects.catalogue import names
from qlvbayes.evaluation.rate import Case
from qlvbayes.simulate import FORMS, OUTSIDE

_TWO, _SEVERAL = "two effects", "several"


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
        columns = ("none", *listed, _SEVERAL, "ambiguous", "unexplained", "failed")
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
