"""The thresholds of the diagnosis, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How sure the diagnosis must be.

    decisive: log Bayes factor by which an effect must beat the model without it (4, that is 55 to
    1, as the best of 18 candidates has chances that a single one has not);
    apart: by which the best must beat another effect to be told from it (1.1, that is 3 to 1, where
    positive evidence begins: Kass & Raftery 1995, doi:10.1080/01621459.1995.10476572);
    spring: by which a spring of free form must beat the effects found, to stand for what no list
    holds; likeness: share of what an effect explains in a form of its own (sum of squares) that the
    list's form must explain; prior_none: prior probability that nothing is missing (the candidates
    share the rest alike); false_alarms: of the adequacy test over all cells of a pad; most: effects
    at most.
    """

    decisive: float = 4.0
    apart: float = 1.1
    spring: float = 2.3
    likeness: float = 0.5
    prior_none: float = 0.5
    false_alarms: float = 0.003
    most: int = 3
