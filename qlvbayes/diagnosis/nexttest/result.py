"""The result of a design of tests, as ``design.json`` holds it."""

from __future__ import annotations

import msgspec

from qlvbayes.diagnosis.nexttest.design import Rig
from qlvbayes.io.files import Part, Result
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


class Proposed(Part, frozen=True, rename={
    "depth": "depth_mm", "speed": "speed_mm_s", "acceleration": "acceleration_mm_s2",
    "hold": "hold_s", "rest": "rest_s", "wait": "pause_s", "duration": "duration_s",
    "share": "retraction_share", "evidence": "expected_2_ln_bayes_factor",
}):  # fmt: skip
    """A proposed test and the information that is expected of it."""

    name: str
    words: str
    # depth, speed, acceleration: depth (mm), speed (mm/s) and acceleration (mm/s2) of every press
    depth: float
    speed: float
    acceleration: float
    # hold, share, rest, cycles: times (s) at depth and after the retraction, share of the depth by
    # which the platen retracts, and number of cycles
    hold: float
    share: float
    rest: float
    cycles: int
    # wait, duration, minutes: time before the test (s), of the test (s), and of both (min)
    wait: float
    duration: float
    minutes: float
    # constants, cause, cause_most: bits in closed form beyond those of the tests before it; of the
    # cause the bounds from below and above
    constants: float
    cause: float
    cause_most: float
    # per_minute, total: bits about everything that was asked for, per minute and in all
    per_minute: float
    # expected 2 ln(Bayes factor) between the two nearest explanations of two causes, together with
    # the tests before it
    evidence: float
    judged: Bits  # bits expected of this test, with the errors of the closed form
    total: float = 0.0


class Width(Part, frozen=True):
    """The sd of a constant now and after all tests, by the most probable explanation."""

    unit: str
    mean: float
    now: float
    after: float


class NextTests(Result, frozen=True, kw_only=True):
    """The tests to do next: ``design.json``."""

    # pad, units: name of the pad, and units of its file
    pad: str
    units: UnitSystem = PAD
    # constants, cause: constants that were asked for, and whether the cause was
    constants: tuple[str, ...]
    cause: bool
    limits: Rig  # limits of the rig, and how many tests were done before
    minutes: float
    seed: int
    screened: int  # number of designs that fitted
    hypotheses: tuple[ExplanationSummary, ...]
    entropy: float  # bits that are missing to know which cause is right
    outside: float  # probability that something unmodelled is there
    missed: float  # size of what the explanations leave (N), which counts as an error of every test
    tests: tuple[Proposed, ...]
    together: Bits  # bits of all proposed tests, with the errors of the closed form
    widths: dict[str, Width]  # sds of the constants now and after all tests
    notices: tuple[str, ...] = ()  # what one should know
    # probability of each set of effects over all laws
    causes: dict[str, float] = msgspec.field(default_factory=dict)
