"""The progress of a search: what is known before it has ended."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.diagnosis.decision import Decision, Weight, decide
from qlvbayes.diagnosis.search import Search
from qlvbayes.inference.forward.hypothesis import Hypothesis


class StopSearch(Exception):  # noqa: N818 - it reports no error
    """Exception that the callback ``watch`` of `diagnose` raises to end the search early.

    The diagnosis is then made from the hypotheses that have been evaluated by that time. `diagnose`
    catches the exception, which has no fields.
    """


@dataclass(frozen=True, eq=False)
class SearchProgress:
    """The state of a search that is still running.

    doing: What the search does next, in words; seen: Number of hypotheses evaluated so far; best:
    The most probable hypothesis so far; decision: What the verdict would be now, before the
    selected hypothesis is tested.
    """

    doing: str
    seen: int
    best: Hypothesis
    decision: Decision

    @classmethod
    def from_search(cls, search: Search, doing: str) -> SearchProgress | None:
        """Return the state of a search; None before any hypothesis has been evaluated."""
        if not search.modes:
            return None
        decision = decide(weights_of(search), search.settings)
        return cls(doing, len(search.modes), search.best, decision)


def weights_of(search: Search) -> list[Weight]:
    """Return the weight of every hypothesis evaluated, in the order of ``search.candidates``."""
    discrepancy = search.density.discrepancy
    limit = search.settings.tolerance * discrepancy.peak
    return [
        Weight(
            one.hypothesis.base,
            frozenset(search.added(one.hypothesis)),
            search.log_posterior(one.hypothesis),
            one.evidence.probability_above(discrepancy.sizes, limit),
            one.hypothesis.elastic in search.nameable_laws,
            error=one.error,
        )
        .made_finite()
        .within(search.families)
        for one in search.candidates.values()
    ]
