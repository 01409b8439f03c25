"""What a diagnosis says of one pad, as ``diagnosis.json`` holds it: numbers and words alone."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec

from qlvbayes.diagnosis.settings import Settings
from qlvbayes.io.resultfile import Part, Result
from qlvbayes.io.units import PAD, UnitSystem


class Estimate(Part, frozen=True):
    """A constant of an effect: Laplace mean and sd, with its unit."""

    unit: str
    mean: float
    sd: float

    def __str__(self) -> str:
        """``0.001672 ± 0.000090 N s/mm``: both to the sd's second digit, at most six decimals."""
        places = 1 - math.floor(math.log10(self.sd)) if self.sd > 0.0 else 3
        unit = "" if self.unit == "1" else f" {self.unit}"
        if places > 6:
            return f"{self.mean:.3g} ± {self.sd:.1g}{unit}"
        places = max(places, 0)
        return f"{self.mean:.{places}f} ± {self.sd:.{places}f}{unit}"


class Laws(Part, frozen=True):
    """An elastic law and a relaxation by name."""

    elastic: str
    relaxation: str

    @property
    def pair(self) -> tuple[str, str]:
        """Both."""
        return self.elastic, self.relaxation

    def others(self, first: Laws) -> list[str]:
        """Those that an earlier pair has not."""
        return [law for law, own in zip(self.pair, first.pair, strict=True) if law != own]

    def __str__(self) -> str:
        """``hertz with prony:2``."""
        return f"{self.elastic} with {self.relaxation}"


class Base(Laws, frozen=True):
    """Base laws and their probability over all effects."""

    probability: float


class Alternative(Part, frozen=True):
    """A hypothesis and its probability: base laws and effects.

    log_evidence_error: by importance sampling, None where the evidence is Laplace's.
    """

    base: Laws
    effects: tuple[str, ...]
    probability: float
    log_evidence: float | None = None
    log_evidence_error: float | None = None


class NotRuledOut(Part, frozen=True):
    """A set of effects that would explain the tests, and its probability over all base laws."""

    effects: tuple[str, ...]
    probability: float


class Place(Part, frozen=True):
    """A phase of a test."""

    test: str
    phase: str


class CellError(
    Part, frozen=True, rename={"rate": "rate_mm_s", "rmse": "rmse_N", "bias": "bias_N"}
):
    """Error in one test's samples of one kind of phase: root mean square and mean (N).

    rate: None where the test has none.
    """

    test: str
    phase: str
    rate: float | None
    n: int
    rmse: float
    bias: float


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
    """A hypothesis on the way to the verdict and what it leaves.

    rmse, heldout_rmse: over all samples (N), fitted and with each test left out in turn (None where
    there is one test only); p_value: of the adequacy test; testable: whether the dwells show if
    noise is correlated; failing: phases that hold structure; cells: errors by test and phase.
    """

    base: Laws
    effects: tuple[str, ...]
    rmse: float
    heldout_rmse: float | None
    log_evidence: float | None
    p_value: float
    testable: bool
    failing: tuple[Place, ...]
    cells: tuple[CellError, ...]
    parameters: dict[str, Estimate]

    @property
    def worst(self) -> CellError:
        """The cell with the largest error."""
        return max(self.cells, key=lambda cell: cell.rmse)


class Decisive(Part, frozen=True, rename={"blocks": "block_means", "time": "time_s"}):
    """In how many readings the evidence for an effect lies.

    blocks: the fewest block means that carry half of the log likelihood that it gains, out of
    ``of``; test, phase, time (s): of the one that carries most.
    """

    blocks: int
    of: int
    test: str
    phase: str
    time: float


class Ranked(Part, frozen=True, rename={"rmse": "rmse_N", "half": "half_of_evidence"}):
    """``none`` or an effect, over the whole posterior.

    inclusion: probability that it is in the model, of ``none`` that nothing is; probability: the
    same with that of every hypothesis shared out among its effects, so that all sum to one;
    log_bayes_factor: log posterior odds of being in less the log prior odds, None where nothing
    else was seen; rmse: of all samples (N) by the likeliest hypothesis with it; parameters: its
    constants there; inclusion_error: what the errors of the evidences make of the inclusion; half:
    in how many readings half of its evidence lies, of effects that the verdict names or groups;
    certainty: how often an effect with such evidence was there in blind studies (`certainty`).
    """

    effect: str
    inclusion: float
    probability: float
    log_bayes_factor: float | None
    rmse: float
    parameters: dict[str, Estimate]
    inclusion_error: float = 0.0
    half: Decisive | None = None
    certainty: float | None = None


class Unseen(Part, frozen=True):
    """An effect that these tests cannot show, and why."""

    effect: str
    reason: str


class Refused(Part, frozen=True):
    """An effect that is likely and not named, and why."""

    effect: str
    reason: str


class ParameterBias(Part, frozen=True, rename={"left": "share_left"}):
    """An effect that hides in a bias of the constants.

    size: value of its amplitude; left: share of its force that the constants do not take; changes:
    relative change of each constant if it were there and left out; visible: whether these tests
    would show it at that size all the same.
    """

    effect: str
    amplitude: str
    size: float
    left: float
    changes: dict[str, float]
    visible: bool


class Suggestion(Part, frozen=True, rename={"evidence": "expected_2_ln_bayes_factor"}):
    """A further test and the expected 2 ln(Bayes factor) by which it would tell a group apart."""

    test: str
    evidence: float


class Sampled(Part, frozen=True, rename={"laplace": "log_evidence_laplace"}):
    """One hypothesis, without a discrepancy: log evidence by Laplace, and by nested sampling.

    agrees: whether both are within three errors and half a unit.
    """

    effect: str
    laplace: float
    log_evidence: float
    error: float
    agrees: bool

    def __str__(self) -> str:
        """Both ways and how far they are apart."""
        return (
            f"{self.effect}: log evidence {self.laplace:.1f} by Laplace, {self.log_evidence:.1f} "
            f"+- {self.error:.1f} by nested sampling"
        )


class Checked(Part, frozen=True):
    """A check for modes that the search missed: how often it was made, failed, and led higher.

    check: ``nested`` (evidences with and without an effect against the effect's posterior at
    nothing), ``exchanged`` (an extra mode that took the place of one that the law has) or ``draws``
    (the likeliest hypotheses from other draws of the relaxation).
    """

    check: str
    made: int
    failed: int
    higher: int


class Remains(
    Part,
    frozen=True,
    rename={"rms": "rms_N", "upper95": "upper95_N", "bias": "bias_N", "excess": "excess_N"},
):
    """What the hypothesis told leaves, by the phase of a test in which it leaves most (N).

    rms: of the structured part; upper95: its bound; share_of_peak: over the largest force;
    share_of_error: of all phases' structured part in the plain model's, None where that leaves
    nothing; excess: by how much the error of all samples exceeds the noise; sure: whether structure
    is seen at all; small: whether all of it is below the tolerance.
    """

    rms: float
    upper95: float
    share_of_peak: float
    share_of_error: float | None
    test: str
    phase: str
    bias: float
    excess: float
    sure: bool
    small: bool


class Worst(Part, frozen=True, rename={"rmse": "rmse_N", "bias": "bias_N"}):
    """Where the plain model fails worst (N)."""

    test: str
    phase: str
    rmse: float
    bias: float


class Used(Part, frozen=True):
    """What a diagnosis was told to do.

    thresholds: prior probabilities, and how sure it must be; seed, evidence: of nested sampling, if
    that was asked for; elastic, relaxation, effects: what was tried.
    """

    thresholds: Settings
    seed: int
    evidence: str
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
        "heldout_of_all": "heldout_of_all_rmse_N",
    },
):
    """What one pad's tests say about the model: ``diagnosis.json``.

    noise: the floor's sd (N), measured without the model; effects: what the verdict names, the
    group's likeliest last; group: effects of which one is there (``ambiguous``);
    forms: of effects told by another law than the list's, which, by the listed name; base: the laws
    of the hypothesis told; bases: all, the likeliest first; outside: probability that something
    outside the list is there; alternatives: the likeliest hypotheses; not_ruled_out: the likeliest
    sets of effects; constants: the base law's, averaged over all hypotheses on it; heldout_of_all:
    error (N) on tests left out of what the likely hypotheses predict together, each by its
    probability without that test, None where one alone is likely; stages: from the
    plain model that was chosen to the hypothesis told; ranking: inclusion probabilities; biases:
    effects that would hide in the constants; coincident: effects that look alike; refused: effects
    that are likely, and why they are not named; warnings: where two ways to the evidence disagree;
    notices: what one should know of the tests; nested: evidence by nested sampling, where it was
    asked for; checks: for modes that the search missed; discrepancy: likeliest size (N) of what the
    hypothesis told leaves; tolerance: share of the peak force below which that does not matter;
    remainder: its size; worst: of the plain model; settings: what was used.
    """

    pad: str
    units: UnitSystem = PAD
    noise: float
    verdict: str
    effects: tuple[str, ...]
    group: tuple[str, ...]
    forms: dict[str, str] = msgspec.field(default_factory=dict)
    base: Base
    bases: tuple[Base, ...]
    outside: float
    alternatives: tuple[Alternative, ...]
    not_ruled_out: tuple[NotRuledOut, ...] = ()
    constants: dict[str, Estimate] = msgspec.field(default_factory=dict)
    heldout_of_all: float | None = None
    stages: Annotated[tuple[Stage, ...], msgspec.Meta(min_length=1)]
    ranking: tuple[Ranked, ...]
    not_identifiable: tuple[Unseen, ...]
    biases: tuple[ParameterBias, ...] = ()
    coincident: tuple[tuple[str, ...], ...] = ()
    refused: tuple[Refused, ...] = ()
    warnings: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    suggestions: tuple[Suggestion, ...] = ()
    nested: tuple[Sampled, ...] = ()
    checks: tuple[Checked, ...] = ()
    discrepancy: float = 0.0
    tolerance: float | None = None
    remainder: Remains | None = None
    worst: Worst
    settings: Used | None = None

    @property
    def tried(self) -> tuple[str, ...]:
        """Effects of the hypothesis told."""
        return self.stages[-1].effects

    @property
    def changed(self) -> list[str]:
        """Base laws of the hypothesis told that are not those chosen."""
        return self.stages[-1].base.others(self.stages[0].base)

    def probability_of(self, effect: str) -> float:
        """That an effect is in the model; of ``none`` that none is."""
        return next((r.inclusion for r in self.ranking if r.effect == effect), 0.0)
