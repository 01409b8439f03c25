"""The settings of a diagnosis: prior probabilities, thresholds, and the breadth of the search."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.inference.errors.features import UNDECIDED, DiscrepancyPrior
from qlvbayes.inference.errors.scatter import UNDECIDED as SCATTER_UNDECIDED
from qlvbayes.inference.errors.scatter import ScatterPrior
from qlvbayes.io.checks import InputError
from qlvbayes.laws.scales import TOLERANCE
from qlvbayes.motion.facts import NEARLY

_MOST_TOLERANCE = 0.5  # of the peak force, from which it is not a tolerance but a mistake


@dataclass(frozen=True)
class Breadth:
    """Breadth of the search for hypotheses and their modes; a broader search takes longer."""

    starts: int = 4  # number of draws of all priors from which the baseline model is optimised
    # a hypothesis is optimised from this many draws of the relaxation at once, until they lead no
    # higher
    draws: int = 6
    # least number of quantiles of the prior of a new effect's shape at which its force is tried
    shapes: int = 2
    # small, large: amplitudes at which a new effect's force is tried, in sds of the amplitude's
    # prior
    small: float = 0.1
    large: float = 1.5
    # number of starts, those whose force promises most, from which a new effect is optimised. With
    # one of them modes are missed (adhesion beside a load cell's creep).
    optimised: int = 2
    beam: int = 2  # largest number of hypotheses that are expanded at a time
    # distance behind the best log posterior within which a hypothesis is expanded
    near: float = 25.0
    # number of neighbours, the most probable ones, that are also optimised from other relaxations
    redrawn: int = 1
    effects: int = 3  # largest number of effects that a hypothesis adds to the user's own
    # number of effects, those that explained most elsewhere, by which each effect of the most
    # probable hypothesis is replaced in turn where it leaves structure
    substitutes: int = 3
    # largest number of hypotheses that are evaluated. Where something unmodelled is there, very
    # many fit alike.
    hypotheses: int = 250
    modes: int = 4  # largest number of modes of a hypothesis that are kept
    # loss behind the best mode beyond which another mode adds nothing to the evidence (e^-15)
    far: float = 15.0
    # distance behind the best log posterior within which the evidence of a hypothesis is sampled
    # (e^-7: a thousandth)
    rival: float = 7.0
    sampled: int = 12  # largest number of hypotheses whose evidence is sampled


@dataclass(frozen=True)
class CellTests:
    """Settings of the test for structure that is left in a cell, which is a phase of a test."""

    curves: int = 4  # number of smooth curves that are tried in a cell
    blocks: int = 3  # number of block means that each curve needs
    # largest number of phases of one kind in a test that are cells by themselves. More of them, as
    # in cycles, form one cell.
    apart: int = 5
    # number of curves by which the mean of such a cell may drift from cycle to cycle (2: a line and
    # a parabola)
    drifts: int = 2
    draws: int = 12  # number of draws of the noise floor over which p-values are averaged
    # the same where the kind of noise is in doubt: with 12 draws a p-value of 0.02 may come out as
    # 1e-9
    doubtful: int = 48
    # p-value below which a cell, or one combination of its curves, stands out; what stands out is
    # bounded with one minus this probability
    level: float = 0.05


@dataclass(frozen=True)
class Imitation:
    """Settings of the strengths of an effect in single tests."""

    # largest, sizes: of the grid of their scatter, which goes up to twice the mean, from where on
    # there is no common strength
    largest: float = 2.0
    sizes: int = 12
    ranked: int = 4  # tests from which a trend of the strengths is looked for
    rank: float = 0.8  # rank correlation from which strengths grow or fall with depth or speed

    @property
    def prior(self) -> ScatterPrior:
        """Return the prior of their scatter."""
        return ScatterPrior(largest=self.largest, sizes=self.sizes)


@dataclass(frozen=True)
class DescriptionSettings:
    """Settings of the law that describes what no listed effect explains."""

    shapes: int = 4  # quantiles of the prior of a term's shape at which its force is tried
    # terms, those that promise most, that are fitted with all constants; 0: no law is looked for
    fitted: int = 12
    judged: int = 6  # of these, the best fits, whose predictions of tests left out are judged
    # mean relative fall of the error on tests left out, in its standard errors, from which a term
    # is kept: the best of a few is taken, and one standard error comes about by chance in a sixth
    sds: float = 2.0
    # share by which the error on tests left out must fall for each constant of a term
    price: float = 0.05


@dataclass(frozen=True)
class DiagnosisSettings:
    """Prior probabilities, and probabilities and sizes from which the verdict says something."""

    # prior probability that no (further) effect is missing, which applies anew after each effect.
    # One half is undecided.
    complete: float = 0.5
    # prior probability that the elastic law is the one that was chosen, and likewise for the
    # relaxation; all other laws share the rest alike. One half is undecided.
    chosen_law: float = 0.5
    # part of a family's prior probability that the candidate effect has; its other forms share the
    # rest alike. One half is undecided.
    candidate: float = 0.5
    # inclusion probability from which an effect is named, and probability of one more effect from
    # which a group is sought for it
    named: float = 0.9
    # certainty below which an effect is not named: a wrong name costs one and a half times as much
    # as a missed one
    confirmed: float = 0.6
    # certainty of an effect that is measured in the records beyond doubt, at five sds and in two
    # places: what is left to doubt is whether the list holds its cause
    measured: float = 0.95
    # probability, over all hypotheses and free curves among them, from which something is more
    # likely there than not: an effect that is named, or something that no listed effect explains
    likelier: float = 0.5
    covered: float = 0.95  # probability with which a group must hold the missing effect
    false_alarms: float = 0.001  # significance level of the adequacy test over all cells of a pad
    # share of the peak force below which neither an effect nor structure matters
    tolerance: float = TOLERANCE
    breadth: Breadth = Breadth()
    # prior of the discrepancy, which stands for everything that is not modelled
    discrepancy: DiscrepancyPrior = UNDECIDED
    # prior of the scatter of stiffness and strengths between tests
    scatter: ScatterPrior = SCATTER_UNDECIDED
    # narrowest, widest: bounds of the factors by which the prior of an effect's amplitude is scaled
    # to the user's motion. Without them, an effect that hardly acts in it would have to be
    # enormous.
    narrowest: float = 0.2
    widest: float = 5.0
    group: int = 3  # largest number of effects in a group: more is no answer
    # share of the largest depth, or of the peak force, below which a test counts as having come
    # back to zero
    returned: float = NEARLY
    cells: CellTests = CellTests()  # how structure is tested for
    imitation: Imitation = Imitation()  # how strengths in single tests are told
    description: DescriptionSettings = DescriptionSettings()

    def __post_init__(self) -> None:
        if not 0.0 <= self.tolerance < _MOST_TOLERANCE:
            raise InputError(
                f"a tolerance of {self.tolerance:g} is no small share of the peak force",
                remedy="give one from 0 to below 0.5, as 0.01 or 1%",
            )
