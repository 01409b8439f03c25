"""The thresholds of the diagnosis, in one place."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.checks import InputError

TOLERANCE = 0.01  # of the peak force: what is smaller does not matter
_MOST_TOLERANCE = 0.5  # of the peak force, from which it is not a tolerance but a mistake


@dataclass(frozen=True)
class Settings:
    """How sure the diagnosis must be.

    decisive: log Bayes factor by which the first effect must beat the plain model (3, that is 20 to
    1, "strong" in Kass & Raftery 1995, doi:10.1080/01621459.1995.10476572); lacking: probability
    that something is missing, all candidates together, that it takes too (4 to 1: of 277 blind pads
    that lack nothing none had as much, of 462 with one effect that could be seen five had less);
    further: by which each further one must (5, that is 150 to 1, "very strong", as every round
    gives chance another chance);
    form: by which a form of its own must beat the list's (4, that is 55 to 1);
    apart: by which the best must beat another effect to be named without it (0.7, that is 2 to 1:
    less is about equally well; what is likely beyond is told beside the name, see window);
    window: log posterior odds within which other explanations are not ruled out and have a part in
    the constants (4, that is 55 to 1; "Occam's window" of Madigan & Raftery 1994,
    doi:10.1080/01621459.1994.10476894, who take 20 to 1); listed: how many of them are told, the
    likeliest first;
    unlisted: by which a rival that no list holds (a spring of free form, an offset of its own in
    every test) must beat the effects found (2.3, that is 10 to 1); likeness: share of what an
    effect explains in a form of its own (whitened sum of squares) that the list's form must
    explain; prior_none: prior probability that nothing is missing (the candidates share the rest
    alike); false_alarms: of the adequacy test over all cells of a pad; most: effects at most;
    tolerance: share of the peak force below which structure that is sure does not matter, and from
    which an effect does. Raises InputError if it is below 0, or 0.5 or more.
    """

    decisive: float = 3.0
    lacking: float = 0.8
    further: float = 5.0
    form: float = 4.0
    apart: float = 0.7
    window: float = 4.0
    listed: int = 3
    unlisted: float = 2.3
    likeness: float = 0.5
    prior_none: float = 0.5
    false_alarms: float = 0.001
    most: int = 3
    tolerance: float = TOLERANCE

    def __post_init__(self) -> None:
        if not 0.0 <= self.tolerance < _MOST_TOLERANCE:
            raise InputError(
                f"a tolerance of {self.tolerance:g} is no small share of the peak force",
                remedy="give one from 0 to below 0.5, as 0.01 or 1%",
            )
