"""The result of a design of tests, as ``design.json`` holds it."""

from __future__ import annotations

import msgspec

from qlvbayes.io.resultfile import Part, Result
from qlvbayes.io.units import PAD, UnitSystem


class ExplanationSummary(Part, frozen=True):
    """An explanation of the tests that were done, in words, with its probability and cause."""

    words: str
    probability: float
    cause: str = ""


class Bits(Part, frozen=True):
    """Expected information (bits) about the constants and about the cause.

    Each has the sd of the closed form's error. Those about the cause lie between their bounds.
    """

    constants: float
    constants_error: float
    cause: float
    cause_error: float


class Limits(Part, frozen=True, rename={
    "depth": "depth_mm", "speed": "speed_mm_s", "acceleration": "acceleration_mm_s2",
    "interval": "interval_s",
}):  # fmt: skip
    """The limits of the rig, in the file's units."""

    depth: float
    speed: float
    acceleration: float
    interval: float
    rows: int


class Proposed(Part, frozen=True, rename={
    "depth": "depth_mm", "speed": "speed_mm_s", "acceleration": "acceleration_mm_s2",
    "hold": "hold_s", "rest": "rest_s", "pause": "pause_s", "duration": "duration_s",
    "share": "retraction_share", "evidence": "expected_2_ln_bayes_factor",
}):  # fmt: skip
    """A proposed test and the information that is expected of it.

    Parameters
    ----------
    name, words
        Its name, and the test in words.
    depth, speed, acceleration
        Of every press (mm, mm/s, mm/s2).
    hold, share, rest, cycles
        Times (s) at depth and after the retraction, share of the depth by which the platen
        retracts, and number of cycles.
    pause, duration, minutes
        Time before the test (s), of the test (s), and of both (min).
    constants, cause, cause_most
        Bits in closed form beyond those of the tests before it; of the cause the bounds from below
        and above.
    per_minute, total
        Bits about everything that was asked for, per minute and in all.
    evidence
        Expected 2 ln(Bayes factor) between the two nearest explanations of two causes, together
        with the tests before it.
    judged
        Bits expected of this test, with the errors of the closed form.
    """

    name: str
    words: str
    depth: float
    speed: float
    acceleration: float
    hold: float
    share: float
    rest: float
    cycles: int
    pause: float
    duration: float
    minutes: float
    constants: float
    cause: float
    cause_most: float
    per_minute: float
    evidence: float
    judged: Bits
    total: float = 0.0


class Width(Part, frozen=True):
    """The sd of a constant now and after all tests, by the most probable explanation."""

    unit: str
    mean: float
    now: float
    after: float


class NextTests(Result, frozen=True, kw_only=True):
    """The tests to do next: ``design.json``.

    Parameters
    ----------
    pad, units
        Name of the pad, and units of its file.
    constants, cause
        Constants that were asked for, and whether the cause was.
    limits, minutes, seed
        Limits of the rig, time there is, and seed.
    screened
        Number of designs that fitted.
    hypotheses
        The explanations.
    entropy
        Bits that are missing to know which cause is right.
    outside
        Probability that something unmodelled is there.
    missed
        Size of what the explanations leave (N), which counts as an error of every test.
    tests
        The proposed tests in order.
    considered
        The best tests for the first of the series.
    together
        Bits of all proposed tests, with the errors of the closed form.
    widths
        Sds of the constants now and after all tests.
    notices
        What one should know.
    causes
        Probability of each set of effects over all laws.
    """

    pad: str
    units: UnitSystem = PAD
    constants: tuple[str, ...]
    cause: bool
    limits: Limits
    minutes: float
    seed: int
    screened: int
    hypotheses: tuple[ExplanationSummary, ...]
    entropy: float
    outside: float
    missed: float
    tests: tuple[Proposed, ...]
    considered: tuple[Proposed, ...]
    together: Bits
    widths: dict[str, Width]
    notices: tuple[str, ...] = ()
    causes: dict[str, float] = msgspec.field(default_factory=dict)
