"""Effects that are in no list: what a real rig may do and no candidate explains."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from qlvbayes.simulate.hidden.effect import Effect, Recipe, peak_of
from qlvbayes.simulate.hidden.mesh import Array, Path
from qlvbayes.simulate.motion import Motion
from qlvbayes.simulate.platen import PAPER_ACCELERATION

_LEAST_HOLD_S = 1.0  # a hold shorter than this is a turning point
_STILL = 1e-3  # mm/s: a hold may creep


@dataclass(frozen=True)
class TemperatureSwing(Effect):
    """F -> F (1 + share sin(2 pi t / period + phase)), t the clock; period in s."""

    name: ClassVar[str] = "temperature_swing"
    recipe: ClassVar[Recipe] = Recipe(
        "share",
        0.05,
        0.9,
        shape=lambda draw: {"period": draw.spread(40.0, 400.0), "phase": draw.even(-np.pi, np.pi)},
    )
    order: ClassVar[int] = 55
    positive: ClassVar[tuple[str, ...]] = ("period",)
    signed: ClassVar[tuple[str, ...]] = ("phase",)

    share: float
    period: float
    phase: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Swing with the room."""
        swing = np.sin(2.0 * pi * path.clock / self.period + self.phase)
        return force * (1.0 + self.share * swing)


@dataclass(frozen=True)
class AmplifierClipping(Effect):
    """F -> min(F, level); N."""

    name: ClassVar[str] = "amplifier_clipping"
    recipe: ClassVar[Recipe] = Recipe("level", known=lambda x, size: x.peak * (1.0 - size))
    order: ClassVar[int] = 66

    level: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Cut off what is above the level."""
        return np.minimum(force, self.level)


@dataclass(frozen=True)
class SensorNonlinearity(Effect):
    """F -> F + amplitude sin(2 pi F / period); both in N."""

    name: ClassVar[str] = "sensor_nonlinearity"
    recipe: ClassVar[Recipe] = Recipe(
        "amplitude", per=peak_of, shape=lambda x: {"period": x.peak / x.even(1.2, 1.8)}
    )
    order: ClassVar[int] = 65
    positive: ClassVar[tuple[str, ...]] = ("period",)
    signed: ClassVar[tuple[str, ...]] = ("amplitude",)

    amplitude: float
    period: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Return the force with the error of the calibration."""
        return force + self.amplitude * np.sin(2.0 * pi * force / self.period)


@dataclass(frozen=True)
class Slip(Effect):
    """F -> (1 - share) F from a random moment of one hold of each test on.

    Hold and moment follow from `seed` and the clock at the start of the test; the moments are
    even in the logarithm of the time since the hold began.
    """

    name: ClassVar[str] = "slip"
    recipe: ClassVar[Recipe] = Recipe("share", 0.2, 0.9, shape=lambda x: {"seed": x.seed()})
    order: ClassVar[int] = 54
    shares: ClassVar[tuple[str, ...]] = ("share",)

    share: float
    seed: int

    def on_force(self, force: Array, path: Path) -> Array:
        """Lose a share and never get it back."""
        slipped = path.time >= self.moment(path.platen)
        return force * np.where(slipped, 1.0 - self.share, 1.0)

    def moment(self, platen: Motion) -> float:
        """Return the time (s) of the slip; infinity without a hold of at least 1 s."""
        holds = [p for p in platen.pieces if abs(p.velocity) < _STILL and p.acceleration == 0]
        holds = [p for p in holds if p.duration >= _LEAST_HOLD_S]
        if not holds:
            return np.inf
        rng = stream(self.seed, platen)
        hold = holds[rng.integers(len(holds))]
        return hold.start + hold.duration * float(np.exp(rng.uniform(np.log(0.01), np.log(0.7))))


@dataclass(frozen=True)
class Ringing(Effect):
    """F -> F + sum (jump / 1000 mm/s2) amplitude e^{-t/decay} sin(2 pi frequency t).

    The sum runs over all jumps of the platen's acceleration, t the time since; N, s, Hz.
    """

    name: ClassVar[str] = "ringing"
    recipe: ClassVar[Recipe] = Recipe(
        "amplitude",
        per=peak_of,
        shape=lambda x: {"frequency": x.spread(5.0, 20.0), "decay": x.spread(0.1, 0.5)},
    )
    order: ClassVar[int] = 60
    family: ClassVar[str] = "frame_ringing"
    positive: ClassVar[tuple[str, ...]] = ("decay",)

    amplitude: float
    frequency: float
    decay: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the ringing after every jump."""
        pieces = path.platen.pieces
        levels = [0.0, *(p.acceleration for p in pieces), 0.0]
        starts = [*(p.start for p in pieces), path.platen.duration]
        for start, jump in zip(starts, np.diff(levels).tolist(), strict=True):
            since = np.maximum(path.time - start, 0.0)
            wave = np.exp(-since / self.decay) * np.sin(2.0 * pi * self.frequency * since)
            force = force + self.amplitude * jump / PAPER_ACCELERATION * wave
        return force


@dataclass(frozen=True)
class Rezeroed(Effect):
    """F -> F + a random offset of each test, normal with standard deviation sd (N).

    The offset follows from `seed` and the clock at the start of the test.
    """

    name: ClassVar[str] = "rezeroed"
    recipe: ClassVar[Recipe] = Recipe("sd", per=peak_of, shape=lambda x: {"seed": x.seed()})
    order: ClassVar[int] = 61

    sd: float
    seed: int

    def on_force(self, force: Array, path: Path) -> Array:
        """Shift the whole test."""
        return force + self.sd * stream(self.seed, path.platen).standard_normal()


@dataclass(frozen=True)
class SlowCreepJump(Effect):
    """F -> F + offset (1 - e^{-(t - begin)/time}) once the clock t is past begin; N, s.

    Something in the rig gives way in the middle of the study.
    """

    name: ClassVar[str] = "slow_creep_jump"
    recipe: ClassVar[Recipe] = Recipe(
        "offset",
        per=peak_of,
        shape=lambda draw: {
            "begin": draw.even(0.2, 0.7) * draw.study_s,
            "time": draw.spread(5.0, 100.0),
        },
    )
    order: ClassVar[int] = 62
    positive: ClassVar[tuple[str, ...]] = ("time",)
    signed: ClassVar[tuple[str, ...]] = ("offset",)

    offset: float
    begin: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Shift the force after the jump."""
        return force - self.offset * np.expm1(-np.maximum(path.clock - self.begin, 0.0) / self.time)


def stream(seed: int, platen: Motion) -> np.random.Generator:
    """Return the generator of what is random in one test, from the clock at its start."""
    return np.random.default_rng([seed, round(1000.0 * platen.start_s)])
