"""Designs of tests within the limits of a rig."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import structs
from scipy.stats import qmc

from qlvbayes.io.arrays import Array
from qlvbayes.io.files import Part
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.phases import Kind
from qlvbayes.motion.trajectory import Stroke, Trajectory, planned

_SLOWEST = 1e-5  # least share of the top speed: slower tests take too long
_LEAST_DEPTH = 0.2  # of the rig's depth: below, forces of soft pads drown in noise
_LEAST_HOLD = 100.0  # readings, by which a controller has settled
_LEAST_BACK = 0.02  # share of the depth, below which a retraction is none
_GENTLEST = 0.1  # of the rig's acceleration
_FULL, _NONE = 0.4, 0.2  # shares of the draws that retract fully, and not at all
_CYCLES = (1, 1, 1, 2, 4, 7)  # equally likely; `records` could not hold the motion of more
LEAST_WAIT = 30.0
"""Seconds between two tests of any pad, to save the file and start the rig again."""
_PATIENT = 0.25  # share of the draws that wait longer than recovery asks for
_LONGEST_WAIT = 10.0  # largest factor by which these wait longer


class Rig(Part, frozen=True, rename={
    "depth": "depth_mm", "speed": "speed_mm_s", "acceleration": "acceleration_mm_s2",
    "interval": "interval_s", "done": "tests_before",
}):  # fmt: skip
    """The limits of a test on a rig, in the file's units."""

    # depth, speed, acceleration: greatest depth (mm), speed (mm/s) and acceleration (mm/s2)
    depth: float
    speed: float
    acceleration: float
    interval: float = 1e-3  # least time between two readings (s)
    # number of readings that are kept of a test; long dwells lose readings first
    rows: int = 10_000_000  # no logger keeps fewer
    done: int = 0  # number of tests that the pad has had


class Design(Part, frozen=True, rename={
    "depth": "depth_mm", "speed": "speed_mm_s", "acceleration": "acceleration_mm_s2",
    "hold": "hold_s", "share": "retraction_share", "rest": "rest_s", "wait": "pause_s",
}):  # fmt: skip
    """Design of one test: cycles of press, hold, retraction and rest, then the return to zero."""

    # depth, speed, acceleration: depth (mm), speed (mm/s) and acceleration (mm/s2) of every press
    depth: float
    speed: float
    acceleration: float
    # hold, share, rest, cycles: times (s) at depth and after the retraction, share of the depth by
    # which the platen retracts, and number of cycles
    hold: float
    share: float = 0.0
    rest: float = 0.0
    cycles: int = 1
    wait: float = 0.0  # time (s) before the test in which the pad recovers

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        """The strokes without the way home."""
        press = (Stroke(self.depth, self.speed, self.hold),)
        if self.share <= 0.0:
            return press
        back = self.depth * (1.0 - self.share)
        return (*press, Stroke(back, self.speed, self.rest)) * self.cycles

    @property
    def trajectory(self) -> Trajectory:
        """The motion with the way home."""
        return planned((*self.strokes, Stroke(0.0, self.speed, 0.0)), self.acceleration)

    @property
    def stretches(self) -> list[tuple[Kind, float, float]]:
        """Kind, begin and end (s) of every movement and dwell, without the way home."""
        stretches: list[tuple[Kind, float, float]] = []
        place, begin = 0.0, 0.0
        for k, stroke in enumerate(self.strokes):
            end = float(planned(self.strokes[: k + 1], self.acceleration).knots[-1])
            down, dwell = stroke.target > place, end - stroke.hold
            stretches.append(("ramp" if down else "unload", begin, dwell))
            stretches.append(("hold" if down else "recovery", dwell, end))
            place, begin = stroke.target, end
        return stretches

    @property
    def seconds(self) -> float:
        """Duration of the test with the way home (s)."""
        return float(self.trajectory.knots[-1])

    def in_words(self, units: UnitSystem) -> str:
        """Return the test in words, as a part of a sentence."""
        speed, depth = f"{plain(self.speed)} {units.speed}", _length(self.depth, units)
        text = f"press to {depth} at {speed}, hold {plain(self.hold)} s"
        if self.share > 0.0:
            back = self.depth * (1.0 - self.share)
            way = "retract fully" if back <= 0.0 else f"retract to {_length(back, units)}"
            text += f", {way}, rest {plain(self.rest)} s"
        if self.share > 0.0 and self.cycles > 1:
            text += f"; {self.cycles} times"
        return f"{text}; after a pause of {plain(self.wait)} s" if self.wait > 0.0 else text


def _length(value: float, units: UnitSystem) -> str:
    return (
        f"strain {plain(value)}" if units.dimensionless else f"{plain(value)} {units.displacement}"
    )


def draw_designs(
    rig: Rig, recovery: Callable[[float], float], longest: float, count: int, seed: int
) -> list[Design]:
    """Draw designs evenly over what the rig can do, by a scrambled Sobol sequence.

    recovery: duration of a test (s) to the rest after it; longest: a test with the rest before (s).
    """
    rows = qmc.Sobol(8, seed=seed).random_base2(max(count - 1, 1).bit_length())[:count]
    designs = [_design(row, rig, recovery, longest) for row in rows]
    return [one for one in designs if one.wait + one.seconds <= longest]


def _design(row: Array, rig: Rig, recovery: Callable[[float], float], longest: float) -> Design:
    """Return the design that numbers (8,) between 0 and 1 determine."""
    depth, speed, acceleration, hold, share, rest, cycles, wait = row.tolist()
    least = _LEAST_HOLD * rig.interval
    slowest = max(_SLOWEST * rig.speed, 4.0 * rig.depth / longest)  # a quarter of the longest test
    back = float(np.clip((share - _NONE) / (1.0 - _FULL - _NONE), 0.0, 1.0))
    back = back if back > _LEAST_BACK else 0.0
    count = _CYCLES[min(int(cycles * len(_CYCLES)), len(_CYCLES) - 1)] if back > 0.0 else 1
    depth = rig.depth * (_LEAST_DEPTH + (1.0 - _LEAST_DEPTH) * float(np.sqrt(depth)))
    acceleration = _between(_GENTLEST * rig.acceleration, rig.acceleration, acceleration)
    speed = _between(min(slowest, rig.speed), rig.speed, speed)
    design = Design(
        depth=depth,
        speed=min(speed, float(np.sqrt(acceleration * depth))),  # a press does not reach more
        acceleration=acceleration,
        hold=max(_between(least, longest, hold) / count, least),
        share=back,
        rest=max(_between(least, longest, rest) / count, least) if back > 0.0 else 0.0,
        cycles=count,
    )
    patience = _LONGEST_WAIT ** (max(wait - (1.0 - _PATIENT), 0.0) / _PATIENT)
    return structs.replace(design, wait=max(patience * recovery(design.seconds), LEAST_WAIT))


def _between(low: float, high: float, share: float) -> float:
    """Return the value at a share of the way from low to high in the logarithm."""
    # rounding must not go beyond the end
    return float(min(low * (high / low) ** share, high))
