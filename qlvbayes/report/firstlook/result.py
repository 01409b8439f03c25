"""The records of a first look, as ``look.json`` stores them."""

from __future__ import annotations

from typing import Literal

from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.motion.evidence import DirectEvidence

BY_PHASE = "by phase"
"""Control of a test in which the prescribed quantity differs from phase to phase."""
Answer = Literal["yes", "hardly", "no"]
_KEYS = {
    **{name: f"{name}_s" for name in ("start", "stop", "at", "duration", "interval", "clock_sd")},
    **{name: f"{name}_mm" for name in ("step", "rms", "largest", "sd", "depth")},
    **{name: f"{name}_N" for name in ("force", "force_sd", "peak", "at_rest", "total", "white")},
    **{"begin": "from_mm", "end": "to_mm", "position": "place_mm", "correlated": "correlated_N"},
    **{"rate": "rate_mm_s", "reached": "reached_mm_s", "tau": "tau_s"},
}
"""Keys of the file that say a quantity's unit, by the attribute's name."""


class PhaseSeen(Part, frozen=True, rename=_KEYS):
    """A phase from ``start`` to ``stop`` (s), with the displacement at both and its readings."""

    phase: str
    start: float
    stop: float
    begin: float
    end: float
    readings: int
    control: str  # what was prescribed in it, ``displacement`` or ``force``


class MotionSeen(Part, frozen=True, rename=_KEYS):
    """Deviation of the fitted motion from the readings of displacement."""

    step: float  # of the encoder, 0 where none shows
    # rms, largest: of readings less motion
    rms: float
    largest: float
    at: float  # the time (s) at which it is largest
    step_shows: bool  # whether readings are off by as much as it makes them
    departure: str | None  # in words, where that is more than scatter and resolution explain


class ContactSeen(Part, frozen=True, rename=_KEYS):
    """Displacement where the force begins to rise, from the file's zero; force: before it."""

    position: float
    sd: float
    force: float
    force_sd: float


class TestSeen(Part, frozen=True, rename=_KEYS):
    """A test: its sampling, its phases and its readings."""

    __test__ = False  # not one of pytest's

    test: str
    role: str
    # what was prescribed (``displacement``, ``force``, or ``by phase`` where it changes);
    # control_declared: whether the file says it
    control: str
    control_declared: bool
    readings: int
    duration: float
    interval: float  # median time between readings; sampling: in words
    sampling: str
    clock_sd: float  # error of one time stamp
    start: float  # the pad's clock at its first reading; start_known: the file says it
    start_known: bool
    after: tuple[str, ...]  # names of the tests from which it has not yet recovered
    rate: float | None  # of loading, as declared or found
    reached: float | None  # the speed of the first ramp
    depth: float
    peak: float
    phases: tuple[PhaseSeen, ...]
    motion: MotionSeen
    contact: ContactSeen | None
    at_rest: float | None  # force before contact, where it is clearly not zero
    left_out: int  # how many readings


class NoiseSeen(Part, frozen=True, rename=_KEYS):
    """Noise of the force at rest: sd of a reading, its white and its correlated part."""

    total: float
    white: float
    correlated: float
    tau: float
    testable: bool  # whether structure can be distinguished from correlated noise
    # whether each reading has a sd of its own, of whose root mean square these are
    by_reading: bool


class Shown(Part, frozen=True):
    """Answer to whether the tests can show one part of the model."""

    about: str
    answer: Answer
    reason: str  # the fact behind the answer
    remedy: str = ""  # the test that would show it, empty where they do
    constants: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()


class PadSeen(Part, frozen=True):
    """A pad: its tests, its noise, what its tests can show, and what to correct before a fit."""

    pad: str
    fluid: str | None
    noise: NoiseSeen
    tests: tuple[TestSeen, ...]
    shown: tuple[Shown, ...]
    cautions: tuple[str, ...]
    notices: tuple[str, ...]
    # effects that the readings show without any model
    direct_evidence: tuple[DirectEvidence, ...] = ()


class FirstLook(Result, frozen=True, kw_only=True):
    """First look at the tests of some pads, before anything is fitted: ``look.json``.

    source: The files that were read; units: Units of displacement and force, also of the file's
    keys that end in ``_mm`` and ``_N``; notices: Sentences on how the files were read; pads: Of
    each pad its tests, its noise, what its tests can show, and what to correct before a fit;
    between: Whether relaxation and stiffness of the pads can be compared; empty for fewer than two
    pads; next: Commands to go on with, as they are typed.
    """

    source: tuple[str, ...]
    units: UnitSystem = PAD
    notices: tuple[str, ...]
    pads: tuple[PadSeen, ...]
    between: tuple[Shown, ...]
    next: tuple[str, ...]
