"""A test that is not done yet: presses, holds and retractions, in a few continuous numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.phases import Kind
from qlvbayes.motion.programme import Stroke, planned
from qlvbayes.motion.trajectory import Trajectory

Array = NDArray[np.float64]

NUMBERS = 8
"""What is drawn of a design: as many numbers between 0 and 1."""
_LEAST_DEPTH = 0.2  # of the rig's: below, forces of soft pads drown in noise
_LEAST_HOLD = 100.0  # readings: a controller has settled
_GENTLEST = 0.1  # of the rig's acceleration
_WHOLE, _NONE = 0.4, 0.2  # shares of the draws that retract fully, and not at all
_CYCLES = (1, 1, 1, 2, 4, 7)  # equally likely; of more, `records` could not hold the motion
_PATIENT = 0.25  # of the draws wait longer than recovery asks for,
_LONGEST_WAIT = 10.0  # up to so many times
_HOME = 0.0  # displacement at which a test begins, and to which it goes back at its end


@dataclass(frozen=True)
class Design:
    """One test: press, hold, retract by a share of the depth, rest; so many cycles; then home.

    depth (mm), speed (mm/s) of every stroke, acceleration (mm/s2), hold and rest (s) in each cycle,
    wait (s): before the test, for the pad to recover.
    """

    depth: float
    speed: float
    acceleration: float
    hold: float
    share: float = 0.0
    rest: float = 0.0
    cycles: int = 1
    wait: float = 0.0

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        """Without the way home."""
        press = (Stroke(self.depth, self.speed, self.hold),)
        if self.share <= 0.0:
            return press
        back = self.depth * (1.0 - self.share)
        return (*press, Stroke(back, self.speed, self.rest)) * self.cycles

    @cached_property
    def trajectory(self) -> Trajectory:
        """The motion, without the way home."""
        return planned(self.strokes, self.acceleration)

    @cached_property
    def whole(self) -> Trajectory:
        """The motion with the way home."""
        home = Stroke(_HOME, self.speed, 0.0)
        return planned((*self.strokes, home), self.acceleration)

    @property
    def stretches(self) -> list[tuple[Kind, float, float]]:
        """Kind, beginning and end (s) of every movement and dwell, without the way home."""
        found: list[tuple[Kind, float, float]] = []
        place, time = _HOME, 0.0
        for stroke in self.strokes:
            way = abs(stroke.target - place)
            down = stroke.target > place
            if way > 0.0:
                top = min(stroke.speed, float(np.sqrt(self.acceleration * way)))
                until = time + way / top + top / self.acceleration
                found.append(("ramp" if down else "unload", time, until))
                time = until
            if stroke.hold > 0.0:
                found.append(("hold" if down else "recovery", time, time + stroke.hold))
                time += stroke.hold
            place = stroke.target
        return found

    @property
    def duration(self) -> float:
        """Of the test (s), with the way home."""
        return float(self.whole.knots[-1])

    @property
    def minutes(self) -> float:
        """Of rig time: the wait before it, and the test."""
        return (self.wait + self.duration) / 60.0

    def words(self, units: UnitSystem) -> str:
        """As a sentence's part."""
        speed, depth = f"{plain(self.speed)} {units.speed}", _length(self.depth, units)
        said = f"press to {depth} at {speed}, hold {plain(self.hold)} s"
        if self.share > 0.0:
            back = self.depth * (1.0 - self.share)
            way = "retract fully" if back <= 0.0 else f"retract to {_length(back, units)}"
            said += f", {way}, rest {plain(self.rest)} s"
        if self.share > 0.0 and self.cycles > 1:
            said += f"; {self.cycles} times"
        return f"{said}; after a pause of {plain(self.wait)} s" if self.wait > 0.0 else said


def _length(value: float, units: UnitSystem) -> str:
    return (
        f"strain {plain(value)}" if units.dimensionless else f"{plain(value)} {units.displacement}"
    )


def drawn(rig: Rig, recovery: Recovery, longest: float, count: int, seed: int) -> list[Design]:
    """At most ``count`` designs of no more than ``longest`` seconds with the wait before them.

    Evenly over what the rig can do (a scrambled Sobol sequence), speeds, times and accelerations in
    their logarithm. The same seed gives the same.
    """
    rows = qmc.Sobol(NUMBERS, seed=seed).random_base2(max(count - 1, 1).bit_length())[:count]
    found = [_design(row, rig, recovery, longest) for row in rows]
    return [one for one in found if one.wait + one.duration <= longest]


def _design(row: Array, rig: Rig, recovery: Recovery, longest: float) -> Design:
    depth, speed, acceleration, hold, share, rest, cycles, wait = row.tolist()
    least = _LEAST_HOLD * rig.interval
    count = _CYCLES[min(int(cycles * len(_CYCLES)), len(_CYCLES) - 1)]
    back = float(np.clip((share - _NONE) / (1.0 - _WHOLE - _NONE), 0.0, 1.0))
    count = count if back > 0.0 else 1
    found = Design(
        depth=rig.depth * (_LEAST_DEPTH + (1.0 - _LEAST_DEPTH) * np.sqrt(depth)),
        speed=_between(rig.slowest(longest), rig.speed, speed),
        acceleration=_between(_GENTLEST * rig.acceleration, rig.acceleration, acceleration),
        hold=max(_between(least, longest, hold) / count, least),
        share=back,
        rest=max(_between(least, longest, rest) / count, least) if back > 0.0 else 0.0,
        cycles=count,
    )
    patience = _LONGEST_WAIT ** (max(wait - (1.0 - _PATIENT), 0.0) / _PATIENT)
    return recovery.before(found, patience)


def _between(low: float, high: float, share: float) -> float:
    """A share of the way in the logarithm; never beyond the end by rounding."""
    return float(min(low * (high / low) ** share, high))


@dataclass(frozen=True, eq=False)
class Recovery:
    r"""How long a pad that was pressed must rest until it has forgotten it.

    After a press of length D, the part of a mode's force that is still there after a rest t is
    c (1 - e^{-v D}) e^{-v t}; fractions c (L,) and rates v (L,) in 1/s, of every explanation.
    """

    spectra: tuple[tuple[Array, Array], ...]

    def time(self, duration: float) -> float:
        """Dwell (s) after a test of ``duration`` s until ``FORGOTTEN`` is left."""
        times = _RESTS
        left = np.zeros_like(times)
        for fractions, rates in self.spectra:
            excited = fractions * -np.expm1(-rates * duration)
            left = np.maximum(left, excited @ np.exp(-np.outer(rates, times)))
        enough = np.flatnonzero(left <= FORGOTTEN)
        return float(times[enough[0]]) if enough.size else float(times[-1])

    def before(self, design: Design, patience: float = 1.0) -> Design:
        """The design with the wait that one like it before it asks for, times ``patience``."""
        wait = max(patience * self.time(design.duration), LEAST_WAIT)
        return replace(design, wait=wait)


FORGOTTEN = 0.01
"""Of the force of a press, that may be left when the next begins."""
LEAST_WAIT = 30.0
"""Seconds between two tests, whatever the pad: the file is kept and the rig started again."""
_RESTS = np.geomspace(0.1, 3600.0, 300)  # s, tried
