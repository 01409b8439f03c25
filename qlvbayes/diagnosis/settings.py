"""What the diagnosis takes for likely before the tests, and how sure it must be."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.inference.errors.features import UNDECIDED, DiscrepancyPrior
from qlvbayes.io.checks import InputError
from qlvbayes.laws.scales import TOLERANCE
from qlvbayes.motion.firstlook.facts import NEARLY

_MOST_TOLERANCE = 0.5  # of the peak force, from which it is not a tolerance but a mistake


@dataclass(frozen=True)
class Breadth:
    """How broadly hypotheses and their modes are looked for: the more, the longer it takes.

    starts: draws of all priors, from which the plain model is optimised; draws: of a relaxation,
    from which a hypothesis is optimised until so many in a row lead no higher; shapes: quantiles of
    the prior of a new effect's shape, from which it is optimised; small, large: a new effect,
    in sds of its amplitude's prior; followed: modes under coarse
    noise that are followed under the noise itself.

    beam: hypotheses that are expanded, the likeliest that come within ``near`` (log posterior) of
    the best; redrawn: neighbours of one, the likeliest, that are optimised from other relaxations
    too; effects: most that a hypothesis has beside the user's own; hypotheses: most that are seen,
    as beside something that no list holds very many are alike.

    modes: of a hypothesis, that are kept; far: loss behind its best mode, beyond which another adds
    nothing to its evidence (e^-15).

    rival: log posterior behind the best, within which a hypothesis is checked and its evidence
    sampled (e^-7: a thousandth), of at most ``sampled``; apart: log Bayes factor by which two ways
    to it may differ (e^3: 20, more than a normal about a mode is off by).
    """

    starts: int = 4
    draws: int = 6
    shapes: int = 2
    small: float = 0.1
    large: float = 1.5
    followed: int = 1
    beam: int = 2
    near: float = 25.0
    redrawn: int = 1
    effects: int = 3
    hypotheses: int = 250
    modes: int = 4
    far: float = 15.0
    rival: float = 7.0
    sampled: int = 12
    apart: float = 3.0


@dataclass(frozen=True)
class CellTests:
    """How each cell, a phase of a test, is asked whether structure is left in it.

    curves: smooth ones a cell, of which each needs ``blocks`` block means; apart: phases of a kind
    in a test that are cells by themselves, where more, as in cycles, are one cell whose mean may
    drift by ``drifts`` curves from cycle to cycle (a line and a parabola).

    draws: of the noise floor, over which p-values are averaged; doubtful: the same where the kind
    of the noise is in doubt (with 12 a p-value of 0.02 may come out as 1e-9).
    """

    curves: int = 4
    blocks: int = 3
    apart: int = 5
    drifts: int = 2
    draws: int = 12
    doubtful: int = 48


@dataclass(frozen=True)
class Imitation:
    """What tells an effect from an imitation, whose strength differs from test to test.

    varies: relative sd of an imitation's strength, off by a third or so; holds: the same of an
    effect whose name serves, as what it predicts is right to 5 %; odds: of the former over the
    latter, from which an effect is an imitation (of an effect that is none their mean is 1, so that
    20 is exceeded in 5 % at most).
    """

    varies: float = 0.3
    holds: float = 0.05
    odds: float = 20.0


@dataclass(frozen=True)
class Settings:
    """Prior probabilities, and from which probability on something is said.

    complete: prior probability that no (further) effect is missing, asked anew after each; usual:
    that the elastic law, and likewise the relaxation, is the one that was chosen, the others
    sharing the rest alike. Both as undecided as can be. discrepancy: what else may be missing.
    narrowest, widest: factors within which the prior of an effect's size is fitted to the user's
    motion (beyond, an effect that hardly acts in it would have to be enormous to be seen).

    named: inclusion probability from which an effect is named; covered: with which a group holds
    the effect; group: its members at most, as more is no answer; unlisted: probability of something
    that no list holds, from which it is taken to be there; false_alarms: of the adequacy test over
    all cells of a pad; rise: share by which the error on tests left out may grow with an effect
    that is named (rounding; an effect that helps where nothing was left out); tolerance: share of
    the peak force below which neither an effect nor structure matters. Raises InputError if it is
    below 0, or 0.5 or more.

    returned: share of the largest depth, or of the peak force, below which a test counts as having
    come back to nothing; breadth: of the search; cells: how structure is looked for; imitation: how
    an effect is told from one.
    """

    complete: float = 0.5
    usual: float = 0.5
    named: float = 0.9
    covered: float = 0.95
    false_alarms: float = 0.001
    rise: float = 0.001
    tolerance: float = TOLERANCE
    breadth: Breadth = Breadth()
    discrepancy: DiscrepancyPrior = UNDECIDED
    narrowest: float = 0.2
    widest: float = 5.0
    group: int = 3
    unlisted: float = 0.5
    returned: float = NEARLY
    cells: CellTests = CellTests()
    imitation: Imitation = Imitation()

    def __post_init__(self) -> None:
        if not 0.0 <= self.tolerance < _MOST_TOLERANCE:
            raise InputError(
                f"a tolerance of {self.tolerance:g} is no small share of the peak force",
                remedy="give one from 0 to below 0.5, as 0.01 or 1%",
            )
