"""The result of a diagnosis of one pad, as ``diagnosis.json`` holds it."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import msgspec

from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.io.wording import significant
from qlvbayes.motion.evidence import DirectEvidence


class Verdict(StrEnum):
    """The verdict on one pad; the values are those of ``verdict`` in ``diagnosis.json``."""

    ADEQUATE = "adequate"
    """No effect is needed, and no phase of any test shows structure that matters."""
    MISSING_EFFECT = "missing_effect"
    """The named effects are in the model and leave no structure that matters."""
    AMBIGUOUS = "ambiguous"
    """Something is missing, and a group of effects explains it equally well."""
    PARTLY_EXPLAINED = "partly_explained"
    """The named effects are in the model, and something unmodelled is there too."""
    UNEXPLAINED = "unexplained"
    """Structure remains, and no effect can be named."""

    @property
    def has_unmodelled(self) -> bool:
        """True if the verdict says that something is there which no candidate effect is."""
        return self in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED)


class Estimate(Part, frozen=True):
    """Posterior mean and sd of a constant, by Laplace's approximation, with its unit."""

    unit: str
    mean: float
    sd: float

    def __str__(self) -> str:
        """Return both to the sd's second digit, as ``0.001672 ± 0.000090 N s/mm``."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{significant(self.mean, self.sd)} ± {significant(self.sd, self.sd)}{unit}"


class LawPair(Part, frozen=True):
    """The names of an elastic law and of a relaxation."""

    elastic: str
    relaxation: str

    @property
    def pair(self) -> tuple[str, str]:
        """Both names."""
        return self.elastic, self.relaxation

    def others(self, first: LawPair) -> list[str]:
        """Return the laws that an earlier pair does not have."""
        return [law for law, own in zip(self.pair, first.pair, strict=True) if law != own]

    def __str__(self) -> str:
        """Return the pair in words, as ``hertz with prony:2``."""
        return f"{self.elastic} with {self.relaxation}"


class Base(LawPair, frozen=True):
    """A pair of base laws with its probability over all effects."""

    probability: float


class Alternative(Part, frozen=True):
    """A hypothesis with its probability."""

    base: LawPair
    effects: tuple[str, ...]
    probability: float
    log_evidence: float | None = None  # log of the marginal likelihood
    # its sd by importance sampling; None where the evidence is Laplace's approximation
    log_evidence_error: float | None = None


class NotRuledOut(Part, frozen=True):
    """A set of effects that may explain the tests, with its probability over all base laws."""

    effects: tuple[str, ...]
    probability: float


class StructuredPhase(Part, frozen=True):
    """A phase of a test that holds structure."""

    test: str
    phase: str


class CellError(
    Part, frozen=True,
    rename={"rate": "rate_mm_s", "rmse": "rmse_N", "bias": "bias_N", "noise": "noise_N"},
):  # fmt: skip
    """The error in the samples of one kind of phase in one test."""

    test: str
    phase: str
    rate: float | None  # speed of loading (mm/s); None where the test has none
    n: int
    # rmse, bias: root mean square and mean of measured minus predicted force (N)
    rmse: float
    bias: float
    # sd (N) of the noise of these readings, where the file states an sd of each
    noise: float | None = None


class Stage(
    Part,
    frozen=True,
    rename={
        "rmse": "rmse_N",
        "heldout_rmse": "heldout_rmse_N",
        "p_value": "adequacy_p_value",
        "testable": "noise_testable",
    },
):
    """A hypothesis on the way from the baseline to the verdict, and what it leaves."""

    base: LawPair
    effects: tuple[str, ...]
    rmse: float  # root mean square error over all samples, fitted (N)
    # the same with each test left out in turn; None where there is only one test
    heldout_rmse: float | None
    log_evidence: float | None  # log of the marginal likelihood; None where it is not finite
    p_value: float  # p-value of the adequacy test
    testable: bool  # whether the dwells show if noise is correlated
    failing: tuple[StructuredPhase, ...]  # kinds of phase that hold structure, each once a test
    cells: tuple[CellError, ...]
    parameters: dict[str, Estimate]  # estimates of its constants

    @property
    def worst(self) -> CellError:
        """The cell with the largest error."""
        return max(self.cells, key=lambda cell: cell.rmse)


class Decisive(Part, frozen=True, rename={"blocks": "block_means", "time": "time_s"}):
    """Number of block means in which the evidence for an effect lies."""

    # blocks, of: the smallest number of block means that hold half of the gain in log likelihood,
    # and the number of all block means
    blocks: int
    of: int
    # test, phase, time: test, kind of phase and time (s) of the block mean that holds most of it
    test: str
    phase: str
    time: float


class Strength(Part, frozen=True):
    """The strength of an effect in one test, over its strength in all tests together."""

    test: str  # name of the test, or of the phase where there is only one test
    ratio: float
    sd: float
    share: float  # of the effect's squared force that lies in this test


class Strengths(Part, frozen=True):
    """The strength of an effect in each test, and what they share (`checks.strengths`)."""

    spread: float  # relative sd between tests; 0 where one strength fits all
    agreement: float  # share of its force that one strength makes, 0 to 1
    parts: tuple[Strength, ...]
    grows_with: str | None = None  # as ``grows with depth``, where that is clear

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest ratio, of the tests in which the effect acts notably."""
        some = [one.ratio for one in self.parts if one.share > 0.1 / len(self.parts)]
        return min(some), max(some)


class Support(Part, frozen=True):
    """Measures besides the evidence that speak for or against an effect (`checks.support`)."""

    # logarithm of the error on tests left out, where the effect acts, without it over that with it
    heldout_gain: float
    # mean fall of the squared error over the parts left out, over its standard error; 0 of fewer
    # than three parts
    heldout_sds: float
    # that error with the effect (N); None where the effect adds no force
    heldout: float | None
    error_left: float  # logarithm of the error of the fit with the effect over the noise floor
    p_left: float  # p-value of the adequacy test with the effect
    effects: int  # number of effects that the hypothesis adds
    strengths: Strengths | None = None  # its strength in each test; None where it has one part


class Ranked(Part, frozen=True, rename={"rmse": "rmse_N", "half": "half_of_evidence"}):
    """The probability of one effect, or of ``none``, over all hypotheses."""

    effect: str  # name of the effect, or ``none``
    inclusion: float  # probability that the effect is in the model; for ``none``, that no effect is
    # the same with the probability of every hypothesis shared out among its effects, so that all
    # entries sum to one
    probability: float
    # log posterior odds of inclusion minus the log prior odds; None where no hypothesis without the
    # effect was evaluated
    log_bayes_factor: float | None
    rmse: float  # error of all samples (N) by the most probable hypothesis with the effect
    parameters: dict[str, Estimate]  # estimates of the effect's constants in that hypothesis
    # sd of the inclusion probability that follows from the errors of the evidences
    inclusion_error: float = 0.0
    # in how many readings half of the effect's evidence lies; None where the effect is improbable
    # or the hypothesis without it was not evaluated
    half: Decisive | None = None
    # how often an effect with such evidence was there in blind studies (`certainty`)
    certainty: float | None = None
    # what else speaks for or against it; None where it is improbable, or the hypothesis without it
    # was not evaluated
    support: Support | None = None


class Excluded(Part, frozen=True):
    """An effect that the tests cannot show, or one that is probable but not named: why."""

    effect: str
    reason: str


class ParameterBias(Part, frozen=True, rename={"left": "share_left"}):
    """An effect that would bias the constants instead of leaving a residual."""

    effect: str
    amplitude: str
    size: float  # value of the amplitude: one prior sd
    left: float  # share of the effect's force that is left once the constants are refitted
    # relative change of each constant if the effect is there and not modelled
    changes: dict[str, float]
    visible: bool  # whether these tests would show the effect at that size all the same


class Suggestion(Part, frozen=True, rename={"evidence": "expected_2_ln_bayes_factor"}):
    """A further test, with the expected 2 ln(Bayes factor) by which it separates a group."""

    test: str
    evidence: float


class RemainingStructure(
    Part,
    frozen=True,
    rename={"rms": "rms_N", "upper95": "upper95_N", "bias": "bias_N", "excess": "excess_N"},
):
    """The structure that the selected hypothesis leaves, in the phase where it leaves most."""

    # rms, upper95: root mean square of the structured part (N), and its upper bound at 95 %
    rms: float
    upper95: float
    share_of_peak: float  # ``rms`` divided by the largest force
    # structured part over all phases, divided by that of the baseline model; None where that leaves
    # none
    share_of_error: float | None
    # test, phase: where it is largest
    test: str
    phase: str
    bias: float  # mean of the structured part there (N)
    excess: float  # by how much the error of all samples exceeds the noise (N)
    sure: bool  # whether the adequacy test sees structure at all
    small: bool  # whether all of it is below the tolerance


class Closest(Part, frozen=True, rename={"heldout": "heldout_rmse_N"}):
    """A listed effect that is like a described law, or fits better than others alone."""

    effect: str
    cosine: float  # of the two forces, after the constants have followed what they can
    differs_most_in: str  # name of the test
    heldout: float  # error on tests left out (N) with it in place of the law


class TermFamily(Part, frozen=True):
    """A kind of terms of described laws, and what its best term could remove of the fit's error."""

    family: str
    share: float  # of the error, at most


class Description(
    Part,
    frozen=True,
    rename={
        "rmse_before": "rmse_before_N",
        "rmse_after": "rmse_after_N",
        "heldout_before": "heldout_rmse_before_N",
        "heldout_after": "heldout_rmse_after_N",
        "sds": "standard_errors",
    },
):
    """A law that describes what no listed effect explains; it names no cause (`description`).

    effect: Name of the effect in ``described_effect.py``; formula: The law; base, effects: Laws and
    named effects beside which it was fitted; parameters: Its constants, with sds by the jackknife
    over tests left out; rmse_before, rmse_after: Error of all samples (N) without it and with it;
    heldout_before, heldout_after: The same of tests left out in turn; sds: Mean relative fall of
    that error over its standard error; cells: What is left, by test and phase; strengths: Its
    strength in each test; closest: Listed effects that fit best, or whose forces are like its.
    """

    effect: str
    formula: str
    base: LawPair
    effects: tuple[str, ...]
    parameters: dict[str, Estimate]
    rmse_before: float
    rmse_after: float
    heldout_before: float
    heldout_after: float
    sds: float
    cells: tuple[CellError, ...]
    strengths: Strengths | None = None
    closest: tuple[Closest, ...] = ()


class Worst(Part, frozen=True, rename={"rmse": "rmse_N", "bias": "bias_N"}):
    """Phase of a test in which the baseline model fails worst, with the error (N) there."""

    test: str
    phase: str
    rmse: float
    bias: float


class Used(Part, frozen=True):
    """The settings with which a diagnosis was made."""

    thresholds: DiagnosisSettings  # prior probabilities and thresholds
    seed: int  # of the draws of priors from which hypotheses are optimised
    # elastic, relaxation, effects: names of all laws and effects that were searched
    elastic: tuple[str, ...]
    relaxation: tuple[str, ...]
    effects: tuple[str, ...]


class DiagnosisResult(
    Result,
    frozen=True,
    kw_only=True,
    rename={
        "noise": "noise_N",
        "stages": "steps",
        "biases": "hidden_in_constants",
        "discrepancy": "discrepancy_sd_N",
    },
):
    """Result of the diagnosis of one pad's model: ``diagnosis.json``.

    Forces are in the unit of ``units.force``, N by default.

    pad: Name of the pad; units: Units of the file; noise: Sd of the noise floor, measured without
    the model; verdict: The verdict; effects: Effects that the verdict names; the most probable
    member of a group comes last; group: Effects of which one is there, for an ambiguous verdict;
    forms: The form of each effect that is there by another law than the candidate effect's own;
    base: Laws of the selected hypothesis; bases: All probable pairs of laws, the most probable
    first; outside: Probability that something unmodelled is there; alternatives: The most probable
    hypotheses; not_ruled_out: The most probable sets of effects; constants: Constants of the base
    laws, averaged over all hypotheses with these laws; stages: Hypotheses from the baseline to the
    selected one; ranking: Inclusion probabilities of ``none`` and all candidate effects;
    not_identifiable: Effects that the tests cannot show; biases: Effects that would hide in the
    constants; refused: Effects that are probable, and why they are not named; notices: What one
    should know of the tests; suggestions: Tests that would separate the members of the group;
    discrepancy: Most probable size of what the selected hypothesis leaves; direct_evidence: What
    the readings show without any model; scatter: Relative sd from test to test of the
    ``stiffness``, and of the strength of each effect of the selected hypothesis, where these
    differ; tolerance: Share of the peak force below which that does not matter; remainder: Size of
    the structure that the selected hypothesis leaves; worst: Where the baseline model fails worst;
    description: The law that describes what no listed effect explains; could_remove: What terms of
    each kind could remove of the error at most; settings: The settings that were used.
    """

    pad: str
    units: UnitSystem = PAD
    noise: float
    verdict: Verdict
    effects: tuple[str, ...]
    group: tuple[str, ...]
    forms: dict[str, str] = msgspec.field(default_factory=dict)
    base: Base
    bases: tuple[Base, ...]
    outside: float
    alternatives: tuple[Alternative, ...]
    not_ruled_out: tuple[NotRuledOut, ...] = ()
    constants: dict[str, Estimate] = msgspec.field(default_factory=dict)
    stages: Annotated[tuple[Stage, ...], msgspec.Meta(min_length=1)]
    ranking: tuple[Ranked, ...]
    not_identifiable: tuple[Excluded, ...]
    biases: tuple[ParameterBias, ...] = ()
    refused: tuple[Excluded, ...] = ()
    notices: tuple[str, ...] = ()
    suggestions: tuple[Suggestion, ...] = ()
    discrepancy: float = 0.0
    scatter: dict[str, float] = msgspec.field(default_factory=dict)
    direct_evidence: tuple[DirectEvidence, ...] = ()
    tolerance: float | None = None
    remainder: RemainingStructure | None = None
    worst: Worst
    description: Description | None = None
    could_remove: tuple[TermFamily, ...] = ()
    settings: Used | None = None

    @property
    def tried(self) -> tuple[str, ...]:
        """Effects of the selected hypothesis."""
        return self.stages[-1].effects

    @property
    def in_verdict(self) -> tuple[str, ...]:
        """Effects that the verdict speaks of: those named, and a group of which one is there."""
        return tuple(dict.fromkeys((*self.effects, *self.group)))

    @property
    def changed(self) -> list[str]:
        """Laws of the selected hypothesis that are not those of the baseline."""
        return self.stages[-1].base.others(self.stages[0].base)

    @property
    def strengths(self) -> dict[str, Strengths]:
        """Strengths of each named effect that differ between tests, by its name."""
        named = map(self.ranked, self.in_verdict)
        own = {one.effect: one.support.strengths for one in named if one and one.support}
        return {name: one for name, one in own.items() if one is not None and one.spread > 0.0}

    def ranked(self, effect: str) -> Ranked | None:
        """Return the entry of an effect in the ranking; None if it has none."""
        return next((one for one in self.ranking if one.effect == effect), None)

    def probability_of(self, effect: str) -> float:
        """Return the probability that an effect is in the model; for ``none``, that none is."""
        ranked = self.ranked(effect)
        return ranked.inclusion if ranked is not None else 0.0
