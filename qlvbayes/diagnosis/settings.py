"""What the diagnosis takes for likely before the tests, and how sure it must be."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.io.checks import InputError
from qlvbayes.laws.scales import TOLERANCE

_MOST_TOLERANCE = 0.5  # of the peak force, from which it is not a tolerance but a mistake


@dataclass(frozen=True)
class Breadth:
    """How broadly hypotheses and their modes are looked for: the more, the longer it takes.

    starts: draws of all priors, from which the plain model is optimised; draws: of a relaxation,
    from which a hypothesis is optimised until so many in a row lead no higher; shapes: quantiles of
    the prior of a new effect's shape, from which it is optimised; followed: modes under coarse
    noise that are followed under the noise itself.

    beam: hypotheses that are expanded, the likeliest that come within ``near`` (log posterior) of
    the best; redrawn: neighbours of one, the likeliest, that are optimised from other relaxations
    too; effects: most that a hypothesis has beside the user's own; hypotheses: most that are seen,
    as beside something that no list holds very many are alike.

    rival: log posterior behind the best, within which a hypothesis is checked and its evidence
    sampled (e^-7: a thousandth), of at most ``sampled``; apart: log Bayes factor by which two ways
    to it may differ (e^3: 20, more than a normal about a mode is off by).
    """

    starts: int = 4
    draws: int = 6
    shapes: int = 2
    followed: int = 1
    beam: int = 2
    near: float = 25.0
    redrawn: int = 1
    effects: int = 3
    hypotheses: int = 250
    rival: float = 7.0
    sampled: int = 12
    apart: float = 3.0


@dataclass(frozen=True)
class Settings:
    """Prior probabilities, and from which probability on something is said.

    complete: prior probability that no (further) effect is missing, asked anew after each; usual:
    that the elastic law, and likewise the relaxation, is the one that was chosen, the others
    sharing the rest alike. Both as undecided as can be.

    named: inclusion probability from which an effect is named; covered: with which a group holds
    the effect; false_alarms: of the adequacy test over all cells of a pad; rise: share by which the
    error on tests left out may grow with an effect that is named (rounding; an effect that helps
    where nothing was left out); tolerance: share of the peak force below which neither an effect
    nor structure matters. Raises InputError if it is below 0, or 0.5 or more.

    breadth: of the search.
    """

    complete: float = 0.5
    usual: float = 0.5
    named: float = 0.9
    covered: float = 0.95
    false_alarms: float = 0.001
    rise: float = 0.001
    tolerance: float = TOLERANCE
    breadth: Breadth = Breadth()

    def __post_init__(self) -> None:
        if not 0.0 <= self.tolerance < _MOST_TOLERANCE:
            raise InputError(
                f"a tolerance of {self.tolerance:g} is no small share of the peak force",
                remedy="give one from 0 to below 0.5, as 0.01 or 1%",
            )
