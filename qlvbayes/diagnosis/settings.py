"""The thresholds of the diagnosis, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How sure the diagnosis must be.

    decisive: log Bayes factor by which the first effect must beat the plain model (3, that is 20 to
    1, "strong" in Kass & Raftery 1995, doi:10.1080/01621459.1995.10476572); lacking: probability
    that something is missing, all candidates together, that it takes too (3 to 1);
    further: by which each further one must (5, that is 150 to 1, "very strong", as every round
    gives chance another chance);
    form: by which a form of its own must beat the list's (4, that is 55 to 1);
    apart: by which the best must beat another effect to be told from it (1.6, that is 5 to 1; of
    273 blind studies of one effect the name, or the group, held the truth in 98 % at 3 to 1, in
    99 % at 5 to 1 and no more often beyond, where ever fewer were named);
    window: log posterior odds within which other explanations have a part in the constants (3, that
    is 20 to 1, "Occam's window" of Madigan & Raftery 1994, doi:10.1080/01621459.1994.10476894);
    spring: by which a spring of free form must beat the effects found, to stand for what no list
    holds; likeness: share of what an effect explains in a form of its own (whitened sum of squares)
    that the list's form must explain; prior_none: prior probability that nothing is missing (the
    candidates share the rest alike); false_alarms: of the adequacy test over all cells of a pad;
    most: effects at most.
    """

    decisive: float = 3.0
    lacking: float = 0.75
    further: float = 5.0
    form: float = 4.0
    apart: float = 1.6
    window: float = 3.0
    spring: float = 2.3
    likeness: float = 0.5
    prior_none: float = 0.5
    false_alarms: float = 0.001
    most: int = 3
