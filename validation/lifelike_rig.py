"""The rig of the lifelike studies: motion of limited jerk, programmes, and what no list holds.

Nothing here shares code with the forward model: it composes the simulator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi, sqrt
from typing import ClassVar

import numpy as np
from blind.catalogue import KINDS
from blind.forms import AdhesionAtAStretch
from blind.laws import log_uniform
from numpy.typing import ArrayLike, NDArray

from qlvbayes.simulate import PAPER_RATES, Effect, Hold, Move, Step
from qlvbayes.simulate.hidden.effect import Recipe, peak_of, stiffness_of
from qlvbayes.simulate.hidden.mesh import Path, recur
from qlvbayes.simulate.hidden.sensor_effects import FrameRinging
from qlvbayes.simulate.motion import Motion, Piece

Array = NDArray[np.float64]

RAMP_S = (0.02, 0.1)  # in which the fastest test comes to speed
_DEPTH_MM = (0.8, 5.0)
_TOP_MM_S = (5.0, 60.0)
_SLOWEST_S = 20.0  # that the slowest way in takes at most
_PAPER_MM = 1.6


@dataclass(frozen=True)
class CubicPiece(Piece):
    """A stretch of constant jerk (mm/s3): d + v t + a t^2 / 2 + jerk t^3 / 6."""

    jerk: float = 0.0

    @property
    def end(self) -> float:
        """Displacement at the end, mm."""
        return super().end + self.jerk * self.duration**3 / 6.0


@dataclass(frozen=True)
class JerkLimited(Motion):
    """Motion of moves and holds whose acceleration changes by at most `jerk` (mm/s3) in a second.

    A move reaches its speed v in 2 sqrt(v / jerk), by a triangle of acceleration, or the speed
    that its stroke leaves time for. start: displacement at the beginning, mm.
    """

    program: tuple[Step, ...]
    jerk: float
    start: float = 0.0
    start_s: float = 0.0
    number: int = 0

    @cached_property
    def pieces(self) -> tuple[CubicPiece, ...]:
        """The program as stretches of constant jerk, in order."""
        return tuple(piece for stretch in self._stretches for piece in stretch)

    @property
    def phases(self) -> list[tuple[float, float]]:
        """Begin and end (s) of every move and hold."""
        parts = [part for part in self._stretches if part]
        return [(part[0].start, part[-1].start + part[-1].duration) for part in parts]

    @cached_property
    def _stretches(self) -> list[list[CubicPiece]]:
        stretches: list[list[CubicPiece]] = []
        clock, position = 0.0, self.start
        for step in self.program:
            if isinstance(step, Hold):
                speed = step.creep / step.seconds
                stretch = [CubicPiece(clock, step.seconds, position, speed, 0.0)]
            else:
                stretch = _stroke(clock, position, step, self.jerk)
            if stretch:
                clock, position = stretch[-1].start + stretch[-1].duration, stretch[-1].end
            stretches.append(stretch)
        return stretches

    def shifted(self, by: float) -> JerkLimited:
        """Return the same motion with all displacements larger by some mm."""
        moved = [
            replace(step, target=step.target + by) if isinstance(step, Move) else step
            for step in self.program
        ]
        return replace(self, program=tuple(moved), start=self.start + by)

    def displacement(self, t: ArrayLike) -> Array:
        """Return the displacement (mm) at times `t` (s)."""
        _, tau, jerk, (d, v, a) = self._state(t)
        return d + tau * (v + tau * (a / 2.0 + tau * jerk / 6.0))

    def velocity(self, t: ArrayLike) -> Array:
        """Return the velocity (mm/s) at times `t` (s)."""
        inside, tau, jerk, (_, v, a) = self._state(t)
        return np.where(inside, v + tau * (a + tau * jerk / 2.0), 0.0)

    def acceleration(self, t: ArrayLike) -> Array:
        """Return the acceleration (mm/s2) at times `t` (s)."""
        inside, tau, jerk, (_, _, a) = self._state(t)
        return np.where(inside, a + tau * jerk, 0.0)

    def _state(self, t: ArrayLike) -> tuple[NDArray[np.bool_], Array, Array, Array]:
        inside, tau, state = self._locate(t)
        times = np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)
        index = np.searchsorted(self._table[:, 0], times, side="right") - 1
        return inside, tau, np.array([piece.jerk for piece in self.pieces])[index], state


def _stroke(clock: float, position: float, move: Move, jerk: float) -> list[CubicPiece]:
    """Come to speed, cruise and brake."""
    way = abs(move.target - position)
    if way == 0.0:
        return []
    speed = min(move.speed, (way * way * jerk / 4.0) ** (1.0 / 3.0))
    half = sqrt(speed / jerk)
    cruise = way / speed - 2.0 * half
    sign = 1.0 if move.target > position else -1.0
    steps = [(half, 1.0), (half, -1.0), (cruise, 0.0), (half, -1.0), (half, 1.0)]
    pieces, v, a = [], 0.0, 0.0
    for seconds, direction in steps:
        if seconds < 1e-9 * half:  # a move that never comes to speed does not cruise
            continue
        push = sign * direction * jerk
        pieces.append(CubicPiece(clock, seconds, position, v, a, push))
        clock, position = clock + seconds, pieces[-1].end
        v, a = v + seconds * (a + seconds * push / 2.0), a + seconds * push
        a = 0.0 if abs(a) < 1e-9 * jerk * half else a
    return pieces


PROGRAMMES = ("paper", "triangles", "staircase", "pull_off", "depths")
"""Kinds of programmes: the paper's six, cycles without rests, stairs, presses that end above the
surface, and presses to several depths at two speeds."""


@dataclass(frozen=True)
class Plan:
    """Programmes of one specimen's tests by name, all on one rig.

    depth: the largest, mm; jerk: of the rig, mm/s3; ramp: in which its fastest test comes to speed,
    s; lead: distance above the given zero at which every test starts, mm.
    """

    kind: str
    programs: dict[str, tuple[Step, ...]]
    depth: float
    jerk: float
    ramp: float
    lead: float

    def depth_of(self, name: str) -> float:
        """Return the largest depth of one test, mm."""
        return max(step.target for step in self.programs[name] if isinstance(step, Move))


def draw_plan(kind: str, longest: float, rng: np.random.Generator) -> Plan:
    """Draw the programmes of 4 to 9 tests, with holds of up to `longest` (s)."""
    depth = _PAPER_MM if kind == "paper" else log_uniform(rng, *_DEPTH_MM)
    hold = longest * float(rng.uniform(0.4, 1.0))
    shallow = depth / 3.0 if kind == "depths" else depth
    shallow = depth / 4.0 if kind == "staircase" else shallow
    ramp = log_uniform(rng, *RAMP_S)
    nominal = max(PAPER_RATES) if kind == "paper" else log_uniform(rng, *_TOP_MM_S)
    top = min(nominal, shallow / ramp)  # a shorter stroke leaves no time to come to speed
    count = int(rng.integers(4, 7))
    speeds = np.geomspace(min(depth / _SLOWEST_S, top / 10.0), top, count).tolist()
    if kind == "paper":
        speeds = list(PAPER_RATES)
    programs = {
        name: tuple(program) for name, program in _programs(kind, depth, hold, speeds, rng).items()
    }
    lead = float(rng.uniform(0.05, 0.3)) if rng.random() < 0.5 else 0.0
    return Plan(kind, programs, depth, 4.0 * top / ramp**2, ramp, lead)


def draw_air_plan(rng: np.random.Generator) -> Plan:
    """Draw the programmes of a machine that goes back and forth in air."""
    depth, ramp = float(rng.uniform(4.0, 12.0)), log_uniform(rng, *RAMP_S)
    top = min(log_uniform(rng, 20.0, 100.0), depth / ramp)
    speeds = np.geomspace(depth / 8.0, top, int(rng.integers(4, 7)))
    rest = Hold(float(rng.uniform(1.0, 4.0)))
    once: dict[str, tuple[Step, ...]] = {
        f"{v:.3g}": (rest, Move(depth, v), rest, Move(0.0, v), rest) for v in speeds.tolist()
    }
    return Plan("air", once, depth, 4.0 * top / ramp**2, ramp, 0.0)


def _programs(
    kind: str, depth: float, hold: float, speeds: Sequence[float], rng: np.random.Generator
) -> dict[str, list[Step]]:
    rest = Hold(hold)
    if kind == "triangles":
        cycles = int(rng.integers(2, 5))
        floor = depth * float(rng.choice([0.0, 0.2]))
        return {
            f"{v:.3g}": [*[Move(depth, v), Move(floor, v)] * cycles, Hold(0.3 * hold)]
            for v in speeds
        }
    if kind == "staircase":
        levels = [depth * k / 4.0 for k in (1, 2, 3, 4, 2)]
        stair = Hold(hold / 2.0)
        return {
            f"{v:.3g}": [s for level in levels for s in (Move(level, v), stair)] for v in speeds
        }
    if kind == "pull_off":
        off, back = -depth * float(rng.uniform(0.1, 0.3)), log_uniform(rng, 0.5, 5.0)
        return {
            f"{v:.3g}": [Move(depth, v), rest, Move(off, back), Hold(2.0)]
            * (1 + int(rng.integers(2)))
            for v in speeds
        }
    if kind == "depths":
        off = -depth * float(rng.choice([0.0, 0.2]))
        levels = [depth * k / 3.0 for k in (1, 2, 3)]
        programs: dict[str, list[Step]] = {
            f"{level:.2f}mm-{v:.3g}": [Move(level, v), rest, Move(off, v), Hold(2.0)]
            for level in levels
            for v in (speeds[len(speeds) // 2], speeds[-1])
        }
        if rng.random() < 0.5:  # the deepest again
            programs["again"] = list(programs.values())[-1]
        return programs
    return {f"{v:g}": [Move(depth, v), rest, Move(0.5 * depth, 1.0), rest] for v in speeds}


@dataclass(frozen=True)
class SlowSwelling(Effect):
    """F -> F (1 + share (1 - e^{-t/time})), t from the beginning of each test on; s."""

    name: ClassVar[str] = "slow_swelling"
    recipe: ClassVar[Recipe] = Recipe("share", 0.02, shape=lambda x: {"time": x.spread(5.0, 40.0)})
    order: ClassVar[int] = 29
    positive: ClassVar[tuple[str, ...]] = ("time",)

    share: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Stiffen while the test lasts."""
        return force * (1.0 - self.share * np.expm1(-path.time / self.time))


@dataclass(frozen=True)
class SecondMaterial(Effect):
    """F -> F + stiffness depth^-power (P - share Q), P = d^(1 + power), Q' = (P - Q)/time.

    Another material beside the first, with a curve and a relaxation of its own; N/mm, mm, s.
    """

    name: ClassVar[str] = "second_material"
    recipe: ClassVar[Recipe] = Recipe(
        "stiffness",
        0.05,
        per=stiffness_of,
        shape=lambda x: {
            "depth": x.depth,
            "power": x.even(0.5, 2.5),
            "share": x.even(0.2, 0.9),
            "time": x.spread(0.3, 60.0),
        },
    )
    order: ClassVar[int] = 36
    positive: ClassVar[tuple[str, ...]] = ("depth", "time")
    shares: ClassVar[tuple[str, ...]] = ("share",)

    stiffness: float
    depth: float
    power: float
    share: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the other material's force."""
        pressed = np.maximum(path.depth, 0.0) ** (1.0 + self.power) / self.depth**self.power
        followed = path.follow(1.0 / self.time, pressed)
        return force + self.stiffness * (pressed - self.share * followed)


@dataclass(frozen=True)
class ScrewWobble(Effect):
    """d -> d + amplitude [sin(2 pi d/pitch + phase) - sin(phase)]: the screw's pitch error; mm."""

    name: ClassVar[str] = "screw_wobble"
    recipe: ClassVar[Recipe] = Recipe(
        "amplitude",
        0.005,
        0.05,
        lambda x: x.depth,
        lambda x: {"pitch": x.depth * x.even(0.2, 0.8), "phase": x.even(-pi, pi)},
    )
    order: ClassVar[int] = 48
    positive: ClassVar[tuple[str, ...]] = ("pitch",)
    signed: ClassVar[tuple[str, ...]] = ("phase",)

    amplitude: float
    pitch: float
    phase: float

    def on_depth(self, depth: Array, velocity: Array) -> tuple[Array, Array]:
        """Add the error of the position."""
        turn = 2.0 * pi / self.pitch
        error = np.sin(turn * depth + self.phase) - np.sin(self.phase)
        slope = turn * np.cos(turn * depth + self.phase)
        return depth + self.amplitude * error, velocity * (1.0 + self.amplitude * slope)


@dataclass(frozen=True)
class Cable(Effect):
    """F -> F + amplitude [sin(2 pi D/pitch + phase) - sin(phase)], D the platen's position; N."""

    name: ClassVar[str] = "cable"
    recipe: ClassVar[Recipe] = Recipe(
        "amplitude",
        0.01,
        per=peak_of,
        shape=lambda x: {"pitch": x.depth * x.even(0.5, 2.0), "phase": x.even(-pi, pi)},
    )
    order: ClassVar[int] = 63
    positive: ClassVar[tuple[str, ...]] = ("pitch",)
    signed: ClassVar[tuple[str, ...]] = ("phase",)

    amplitude: float
    pitch: float
    phase: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the cable's pull."""
        turned = 2.0 * pi * path.platen.displacement(path.time) / self.pitch + self.phase
        return force + self.amplitude * (np.sin(turned) - np.sin(self.phase))


class RingingFrame(FrameRinging):
    """The listed ringing, for an acceleration that does not jump: straight from node to node.

    w = (g^2 + o^2)/o Im z, z' = (-g + i o) z + a, o = 2 pi f, g = o damping.
    """

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the force of the swinging mass."""
        turn = 2.0 * pi * self.frequency
        rate = complex(-turn * self.damping, turn)
        time, push = path.time.ravel(), path.platen.acceleration(path.time).ravel()
        steps, rise = np.diff(time), np.diff(push)
        full = np.exp(rate * steps)
        even = (full - 1.0) / rate
        sloped = np.where(steps > 0.0, (even - steps) / rate / np.where(steps > 0, steps, 1.0), 0.0)
        swung = recur(full, even * push[:-1] + sloped * rise, 0.0)
        w = abs(rate) ** 2 / turn * swung.imag.reshape(force.shape)
        return force + self.strength / turn * w


class StickyPad(AdhesionAtAStretch):
    """Adhesion by ligaments that a touch draws: on the way to the first one nothing pulls."""

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the ligaments' pull after the first touch."""
        touched = path.platen.displacement(path.time) >= 0.0
        touched = np.maximum.accumulate(touched.ravel()).reshape(force.shape)
        return np.where(touched, super().on_force(force, path), np.maximum(force, 0.0))


UNLISTED = (
    "slow_swelling", "second_material", "screw_wobble", "cable", "temperature_swing",
    "sensor_nonlinearity", "slow_creep_jump", "drive_ripple", "stick_slip", "viscous_heating",
    "curing", "bubble", "drive_warmth", "rezeroed", "swelling",
)  # fmt: skip
"""Kinds of the part that no listed effect is."""
UNLISTED_IN_AIR = ("cable", "drive_ripple", "drive_warmth")
_OWN: dict[str, type[Effect]] = {
    kind.name: kind
    for kind in (SlowSwelling, SecondMaterial, ScrewWobble, Cable, RingingFrame, StickyPad)
}


def kind_of(name: str) -> type[Effect]:
    """Return the class of an effect of this rig, by its name."""
    return _OWN.get(name) or KINDS[name]
