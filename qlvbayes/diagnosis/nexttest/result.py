"""What is proposed, as ``design.json`` holds it."""

from __future__ import annotations

import msgspec

from qlvbayes.io.resultfile import Part, Result
from qlvbayes.io.units import PAD, UnitSystem


class Hypothesis(Part, frozen=True):
    """An explanation of the tests that were done, its probability, and what it is told by."""

    words: str
    probability: float
    cause: str = ""


class Bits(Part, frozen=True):
    """By nested Monte Carlo, each with the sd of its error."""

    constants: float | None
    constants_error: float | None
    cause: float | None
    cause_error: float | None


class Limits(Part, frozen=True, rename={
    "depth": "depth_mm", "speed": "speed_mm_s", "acceleration": "acceleration_mm_s2",
    "interval": "interval_s",
}):  # fmt: skip
    """What the rig can do, in the units of ``units``."""

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
    """A test.

    pause: before it; minutes: of rig time, with the pause; constants, cause: bits in closed form
    beyond the tests before it (cause: the bound from below, cause_most from above); total: of all
    that was asked for, judged where that was done; per_minute: the same per minute; evidence:
    between the two nearest explanations of two causes, with the tests before it; judged: of this
    test alone.
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
    judged: Bits | None
    total: float = 0.0


class Width(Part, frozen=True):
    """Sd of a constant now, and as expected after all tests, under the likeliest explanation."""

    unit: str
    mean: float
    now: float
    after: float


class NextTests(Result, frozen=True, kw_only=True):
    """Which tests to do next: ``design.json``.

    constants: those asked for; cause: whether which cause is right was asked for; causes: sets of
    effects that are in doubt, each with its probability over all laws; entropy: bits that are
    missing to know which is right; outside: probability that none of the hypotheses is all of it;
    missed: size of what they leave, which is reckoned with; tests: proposed, in order; considered:
    the best for the first place; together: all tests.
    """

    pad: str
    units: UnitSystem = PAD
    constants: tuple[str, ...]
    cause: bool
    limits: Limits
    minutes: float
    seed: int
    screened: int
    hypotheses: tuple[Hypothesis, ...]
    entropy: float
    outside: float
    missed: float
    tests: tuple[Proposed, ...]
    considered: tuple[Proposed, ...]
    together: Bits | None
    widths: dict[str, Width]
    notices: tuple[str, ...] = ()
    causes: dict[str, float] = msgspec.field(default_factory=dict)
