"""Records that differ: lost readings, late starts, unequal holds, changing noise, held forces.

Where a force is held, the platen goes on as far as the pad gives way. Its path is that of a
controller that has learnt it, and is found for any pad by iteration: the force F is simulated along
a path, the displacements at some moments of the hold are corrected by a share of (F_0 - F)/K with
the stiffness K at the end of the way in, and so on until F stays at F_0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blind.laws import log_uniform
from blind.programmes import PadProgramme
from qlvbayes.simulate.motion import Motion, Piece, Track, joined

Array = NDArray[np.float64]

RECORDS = (
    "plain", "lost_readings", "late_start", "unequal_holds", "changing_noise", "held_force",
)  # fmt: skip
"""Kinds of records; in all but the first something is not as the programme says."""

Forces = Callable[[PadProgramme, Sequence[Array]], list[Array]]
"""Simulates the forces (N) of all tests of a session at some times (s) of each."""

_LOST = 0.01  # of a test's readings, at most; of more no program makes anything
_OF_FORCE = 0.7  # of the tests with lost readings: the force's, else the displacement's
_LATE = (0.1, 0.5)  # of the first way in, after which a record begins
_SHORTEST = 0.05  # of a hold that is cut short,
_LEAST_S = 1.0  # and in s, as far as it was as long
_RESTING_MM = 1e-3  # most that the platen creeps in a hold
_UNDER_FORCE = 2.0 / 3.0  # of the tests that can have a hold under a force have one
_MOMENTS = 25  # of such a hold, at which its path is corrected,
_FIRST = 0.01  # of the hold: the first of them, whose force is held from there on
_ITERATIONS = 20
_GAIN = 0.6  # of the correction, as the stiffness grows along the path
_STEADY = 2e-3  # of the force: a controller holds it no better
_DEEPEST = 0.8  # of the way in: a pad that gives way further cannot hold the force
_LAST_WAY = 0.02  # of the way in, over which the stiffness is taken


@dataclass(frozen=True)
class NoiseGain:
    """Factor by which noise is larger than at its smallest, along a test."""

    factor: float  # the largest
    # share of the test that is its time constant of dying away or, where it rises, its moment
    share: float
    rises: bool  # whether it rises at once, instead of dying away

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> NoiseGain:
        """Draw noise that dies away from 4 to 30 times, or rises to 3 to 10 times at once."""
        if rng.random() < 0.5:
            return cls(log_uniform(rng, 4.0, 30.0), log_uniform(rng, 0.02, 0.3), False)
        return cls(log_uniform(rng, 3.0, 10.0), float(rng.uniform(0.2, 0.8)), True)

    def at(self, time: Array, duration: float) -> Array:
        """Return the factor (n,) at times (s) of a test of some duration (s)."""
        passed = time / duration
        if self.rises:
            return np.where(passed > self.share, self.factor, 1.0)
        return 1.0 + (self.factor - 1.0) * np.exp(-passed / self.share)


def unequal_holds(plan: PadProgramme, rng: np.random.Generator) -> PadProgramme:
    """Return the session with the holds of all tests but one cut to 5 to 100 % of their length."""
    whole = int(rng.integers(len(plan.motions)))
    motions: dict[str, Motion] = {}
    clock = 0.0
    for number, (name, motion) in enumerate(plan.motions.items()):
        share = log_uniform(rng, _SHORTEST, 1.0)
        cut = motion if number == whole else _shortened(motion, share)
        motions[name] = replace(cut, start_s=clock)  # type: ignore[type-var]
        clock += cut.duration + plan.pause
    return replace(plan, motions=motions)


def _shortened(motion: Motion, share: float) -> Track:
    """Return a motion whose rests last a share of their time, but at least 1 s."""
    pieces = []
    for piece in motion.pieces:
        least = min(piece.duration, _LEAST_S)
        length = max(share * piece.duration, least) if _rests(piece) else piece.duration
        pieces.append((replace(piece, duration=length),))
    return Track(joined(pieces), motion.start_s, motion.number)


def _rests(piece: Piece) -> bool:
    return piece.acceleration == 0.0 and abs(piece.velocity) * piece.duration < _RESTING_MM


def held_forces(plan: PadProgramme, forces: Forces, rng: np.random.Generator) -> PadProgramme:
    """Return the session with the first hold of two of three tests under its first force.

    A test that goes back to zero has none, as it would end in contact, nor has one whose pad gives
    way too far.
    """
    chosen = [
        _HeldForce.from_motion(motion) if rng.random() < _UNDER_FORCE else None
        for motion in plan.motions.values()
    ]
    for _ in range(_ITERATIONS):
        current = _with_paths(plan, chosen)
        times = [np.zeros(1) if one is None else one.times for one in chosen]
        simulated = forces(current, times)
        chosen = [
            None if one is None else one.corrected(force)
            for one, force in zip(chosen, simulated, strict=True)
        ]
        if all(one is None or one.steady for one in chosen):
            break
    return _with_paths(plan, [one if one is not None and one.steady else None for one in chosen])


@dataclass(frozen=True, eq=False)
class _HeldForce:
    """A hold under a force: the motion, the index of its piece, and the path."""

    motion: Motion
    index: int
    # moments (s), path (mm): from the beginning of the hold on
    moments: Array
    path: Array
    way: float  # of the platen before, mm
    steady: bool = False

    @classmethod
    def from_motion(cls, motion: Motion) -> _HeldForce | None:
        """Return the first hold of a motion, with a path at rest; None where it has none."""
        pieces = motion.pieces
        index = next((k for k, piece in enumerate(pieces) if k and _rests(piece)), None)
        if index is None:
            return None
        way = pieces[index].displacement
        if way <= 0.0 or pieces[-1].end < 0.1 * way:
            return None
        moments = pieces[index].duration * np.geomspace(_FIRST, 1.0, _MOMENTS)
        return cls(motion, index, np.append(0.0, moments), np.zeros(_MOMENTS + 1), way)

    @property
    def times(self) -> Array:
        """Times (s) of the moments, after one on the way in."""
        begin = self.motion.pieces[self.index].start
        early = np.linspace(0.0, begin, 2000)
        near = early[np.searchsorted(self.motion.displacement(early), (1 - _LAST_WAY) * self.way)]
        return np.append(near, begin + self.moments)

    def corrected(self, forces: Array) -> _HeldForce | None:
        """Return the hold with a better path, given the forces (N) at its times."""
        wanted = forces[2]
        if not forces[1] > forces[0]:
            return None
        error = wanted - forces[1:]
        error[0] = 0.0
        stiffness = (forces[1] - forces[0]) / (_LAST_WAY * self.way)
        deepest = _DEEPEST * self.way
        path = np.clip(self.path + _GAIN * error / stiffness, -deepest, deepest)
        return replace(self, path=path, steady=bool(np.abs(error).max() < _STEADY * wanted))

    @property
    def moved(self) -> Track:
        """The motion along the path: straight between its moments."""
        pieces = self.motion.pieces
        steps, ways = np.diff(self.moments), np.diff(self.path)
        hold = [
            (Piece(0.0, step, 0.0, way / step, 0.0),)
            for step, way in zip(steps.tolist(), ways.tolist(), strict=True)
        ]
        parts = [pieces[: self.index], *hold, pieces[self.index + 1 :]]
        whole = joined(part for part in parts if part)
        return Track(whole, self.motion.start_s, self.motion.number)


def _with_paths(plan: PadProgramme, chosen: Sequence[_HeldForce | None]) -> PadProgramme:
    motions = {
        name: motion if one is None else one.moved
        for (name, motion), one in zip(plan.motions.items(), chosen, strict=True)
    }
    return replace(plan, motions=motions)


def with_lost_readings(
    displacement: Array, force: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return both channels, single readings of one of which are 0: up to 1 % of them."""
    count = 1 + int(rng.integers(max(1, int(_LOST * force.size))))
    lost = rng.choice(force.size, count, replace=False)
    of_force = rng.random() < _OF_FORCE
    channel = (force if of_force else displacement).copy()
    channel[lost] = 0.0
    return (displacement, channel) if of_force else (channel, force)


def late_start(displacement: Array, rng: np.random.Generator) -> int:
    """Return the first reading of a record that begins late: on the first way in, or at once.

    Half of the tests begin late, after 10 to 50 % of their readings of the first way in.
    """
    inside = int(np.argmax(displacement >= 0.9 * displacement.max()))
    late = rng.random() < 0.5
    share = float(rng.uniform(*_LATE))
    return int(share * inside) if late else 0
