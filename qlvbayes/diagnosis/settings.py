"""The settings of a diagnosis: every number that can move a verdict, with what it is.

The features of the certainty (`certainty`) have two numbers of their own, which were learnt with.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

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

    starts: Annotated[int, "draws of the priors from which the plain model is optimised"] = 4
    draws: Annotated[int, "draws of the relaxation at once, until they lead no higher"] = 6
    shapes: Annotated[int, "values of a new effect's shape at which its force is tried"] = 2
    small: Annotated[
        float, "small size at which a new effect's force is tried, in sds of its prior"
    ] = 0.1
    large: Annotated[
        float, "large size at which a new effect's force is tried, in sds of its prior"
    ] = 1.5
    # with one of them modes are missed (adhesion beside a load cell's creep)
    optimised: Annotated[
        int, "starts from which a new effect is optimised, the most promising ones"
    ] = 2
    beam: Annotated[int, "hypotheses whose neighbours are looked at together"] = 2
    near: Annotated[
        float, "log probability behind the best within which neighbours are looked at"
    ] = 25.0
    redrawn: Annotated[int, "neighbours that are also optimised from other relaxations"] = 1
    effects: Annotated[int, "largest number of effects that a hypothesis adds"] = 3
    # those that explained most elsewhere, where the best hypothesis leaves structure
    substitutes: Annotated[
        int, "effects by which each effect of the best hypothesis is replaced"
    ] = 3
    # where something unmodelled is there, very many fit alike
    hypotheses: Annotated[int, "largest number of hypotheses"] = 250
    modes: Annotated[int, "largest number of optima kept for a hypothesis"] = 4
    # e^-15 adds nothing to the evidence, e^-7 a thousandth
    far: Annotated[float, "log probability behind the best beyond which an optimum is dropped"] = (
        15.0
    )
    rival: Annotated[float, "log probability behind the best within which evidence is sampled"] = (
        7.0
    )
    sampled: Annotated[int, "largest number of hypotheses whose evidence is sampled"] = 12


@dataclass(frozen=True)
class CellTests:
    """Settings of the test for structure that is left in a cell, which is a phase of a test."""

    curves: Annotated[int, "smooth curves with which a phase is searched for systematic error"] = 4
    blocks: Annotated[int, "averages of readings that each of these curves needs"] = 3
    # more of them, as in cycles, form one cell
    apart: Annotated[int, "phases of one kind in a test that are judged one by one"] = 5
    drifts: Annotated[int, "curves by which their mean may drift from cycle to cycle"] = 2
    draws: Annotated[int, "draws of the noise over which p-values are averaged"] = 12
    # with 12 draws a p-value of 0.02 may come out as 1e-9
    doubtful: Annotated[int, "the same where the kind of noise is in doubt"] = 48
    # what stands out is bounded with one minus this probability
    level: Annotated[float, "p-value below which a phase stands out"] = 0.05


@dataclass(frozen=True)
class Imitation:
    """Settings of the strengths of an effect in single tests."""

    # twice the mean, from where on there is no common strength
    largest: Annotated[float, "largest relative sd of one effect's strength between tests"] = 2.0
    sizes: Annotated[
        int, "number of relative sds of one effect's strength between tests that are tried"
    ] = 12
    ranked: Annotated[int, "tests from which a trend of the strengths is looked for"] = 4
    rank: Annotated[
        float, "rank correlation from which strengths grow or fall with depth or speed"
    ] = 0.8

    @property
    def prior(self) -> ScatterPrior:
        """Return the prior of their scatter."""
        return ScatterPrior(largest=self.largest, sizes=self.sizes)


@dataclass(frozen=True)
class DescriptionSettings:
    """Settings of the law that describes what no listed effect explains."""

    shapes: Annotated[int, "shapes at which each term of a described law is tried"] = 4
    # 0: no law is looked for
    fitted: Annotated[int, "terms of a described law that are fitted with all constants"] = 12
    judged: Annotated[int, "best of these whose predictions of tests left out are judged"] = 6
    # the best of a few is taken, and one standard error comes about by chance in a sixth
    sds: Annotated[float, "standard errors by which tests left out must be predicted better"] = 2.0
    price: Annotated[float, "share by which their error must fall for each constant of the law"] = (
        0.05
    )


@dataclass(frozen=True)
class DiagnosisSettings:
    """Prior probabilities, and probabilities and sizes from which the verdict says something.

    A probability of one half is undecided.
    """

    # applies anew after each effect
    complete: Annotated[float, "prior probability that no (further) effect is missing"] = 0.5
    # all other laws share the rest alike
    chosen_law: Annotated[
        float, "prior probability of the elastic law that was chosen, and of the relaxation"
    ] = 0.5
    # its other forms share the rest alike
    candidate: Annotated[
        float, "share of an effect's prior probability that its first form has"
    ] = 0.5
    named: Annotated[float, "probability over all hypotheses from which an effect is named"] = 0.9
    # a wrong name costs one and a half times as much as a missed one
    confirmed: Annotated[float, "certainty by blind studies below which no effect is named"] = 0.6
    # what is left to doubt is whether the list holds its cause
    measured: Annotated[float, "certainty of an effect that the readings show beyond doubt"] = 0.95
    likelier: Annotated[
        float, "probability, free curves included, from which something is taken to be there"
    ] = 0.5
    covered: Annotated[float, "probability with which a group holds the missing effect"] = 0.95
    false_alarms: Annotated[float, "probability that a right model is found to fail"] = 0.001
    tolerance: Annotated[
        float, "share of the peak force below which effects and errors do not matter"
    ] = TOLERANCE
    breadth: Breadth = Breadth()
    # of everything that is not modelled
    discrepancy: DiscrepancyPrior = UNDECIDED
    # of stiffness and strengths between tests
    scatter: ScatterPrior = SCATTER_UNDECIDED
    # without bounds, an effect that hardly acts in the motion would have to be enormous
    narrowest: Annotated[
        float, "smallest factor by which the prior of an effect's size is fitted to the motion"
    ] = 0.2
    widest: Annotated[float, "largest factor by which it is"] = 5.0
    group: Annotated[int, "largest number of effects in a group"] = 3  # more is no answer
    returned: Annotated[
        float, "share of depth or peak force below which a test has come back to zero"
    ] = NEARLY
    cells: CellTests = CellTests()
    imitation: Imitation = Imitation()
    description: DescriptionSettings = DescriptionSettings()

    def __post_init__(self) -> None:
        if not 0.0 <= self.tolerance < _MOST_TOLERANCE:
            raise InputError(
                f"a tolerance of {self.tolerance:g} is no small share of the peak force",
                remedy="give one from 0 to below 0.5, as 0.01 or 1%",
            )
