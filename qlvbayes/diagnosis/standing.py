"""What a search knows so far: for those who watch it, and for what is told at its end."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.diagnosis.decision import Decision, Weight, decide
from qlvbayes.diagnosis.search import Search
from qlvbayes.inference.forward.hypothesis import Hypothesis


class Enough(Exception):  # noqa: N818 - no error: who watches has seen enough
    """Raise it in ``watch`` to end a search: what is known by then is summed up."""


@dataclass(frozen=True, eq=False)
class Standing:
    """A search on its way.

    doing: what comes next, in words; seen: hypotheses weighed so far; best: the likeliest of them;
    decision: what would be said now, before what is told is tested.
    """

    doing: str
    seen: int
    best: Hypothesis
    decision: Decision

    @classmethod
    def of(cls, search: Search, doing: str) -> Standing | None:
        """None before anything was seen."""
        if not search.modes:
            return None
        decision = decide(weights_of(search), search.settings)
        return cls(doing, len(search.modes), search.best, decision)


def weights_of(search: Search) -> list[Weight]:
    """Every hypothesis seen, in numbers."""
    discrepancy = search.density.discrepancy
    limit = search.settings.tolerance * discrepancy.peak
    return [
        Weight(
            one.hypothesis.base,
            frozenset(search.added(one.hypothesis)),
            search.log_posterior(one.hypothesis),
            one.evidence.probability_above(discrepancy.sizes, limit),
            one.hypothesis.elastic in search.listed,
            error=one.error,
        )
        .of_numbers()
        .within(search.families)
        for one in search.seen.values()
    ]
