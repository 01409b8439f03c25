"""Protocols other than the paper's: sines, cycles, staircases, other speeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, pi, sin

import numpy as np

from qlvbayes.simulate.motion import Motion, Piece, Track, joined
from qlvbayes.simulate.platen import PAPER_RATES, Hold, Move, Platen, Step, full_retraction_protocol

_PIECES_A_CYCLE = 60  # a sine's acceleration then steps by at most 10 % of its peak
_PIECES_A_STROKE = 40  # of a smooth move between two depths
_STROKE_MM = 1.6  # the paper's
_CYCLES = 5  # a test
_THREE = (0.1, 10.0, 100.0)  # mm/s
_CYCLE_RATES = (0.5, 1.0, 3.0, 10.0, 20.0, 50.0)  # mm/s
_HERTZ = (0.1, 0.2, 0.4, 0.8, 1.5, 3.0)  # of sines: peak speeds of 0.5 to 15 mm/s
_RETURN_MM_S = 20.0  # back to the start, before the next test

PROTOCOL_NAMES = (
    "paper", "three_tests", "no_unloading", "one_retraction", "staircase", "cycles", "sine",
    "short_holds", "random_order", "other_speeds",
)  # fmt: skip
"""Protocols of the wide population."""


@dataclass(frozen=True)
class PadProgramme:
    """Tests of one pad, a motion each by name, in order."""

    motions: dict[str, Motion]
    # whether each test follows the one before by `pause` (s), in which the platen goes back to 0
    # and the pad has not forgotten; else every test begins at rest. The motions know their clocks.
    continuous: bool
    pause: float
    longest_hold: float  # s, or a quarter of the longest test where there is no hold
    smooth: bool  # without kinks

    @property
    def whole(self) -> Track:
        """Return all tests and the pauses between them as one motion."""
        parts: list[Sequence[Piece]] = []
        position = 0.0
        for motion in self.motions.values():
            parts.append(motion.pieces)
            position += motion.pieces[-1].end - motion.pieces[0].displacement
            parts.append(_back(position, self.pause))
            position = 0.0
        return Track(joined(parts[:-1]))


def session(
    protocol: str, continuous: bool, hold: float, creep: float, rng: np.random.Generator
) -> PadProgramme:
    """Return the tests of one protocol.

    hold: length of the holds (s) where the protocol leaves it open; creep: by how much the platen
    moves on in every hold, mm.
    """
    programs, smooth = _programs(protocol, hold, rng)
    holds = [
        s.seconds
        for p in programs.values()
        if not isinstance(p, Track)
        for s in p
        if isinstance(s, Hold)
    ]
    motions: dict[str, Motion] = {}
    clock, pause = 0.0, 5.0 if continuous else 120.0
    for number, (name, program) in enumerate(programs.items()):
        if isinstance(program, Track):
            motion: Motion = replace(program, start_s=clock, number=number)
        else:
            motion = Platen(_creeping(program, creep), start_s=clock, number=number)
        motions[name] = motion
        clock += motion.duration + pause
    longest = max(holds, default=0.25 * max(m.duration for m in motions.values()))
    return PadProgramme(motions, continuous, pause, longest, smooth)


def _programs(
    protocol: str, hold: float, rng: np.random.Generator
) -> tuple[dict[str, tuple[Step, ...] | Track], bool]:
    rates = list(PAPER_RATES)
    if protocol == "sine":
        return {f"{f:g} Hz": sine(_STROKE_MM, f, _CYCLES) for f in _HERTZ}, True
    if protocol == "other_speeds":
        return _jerk_limited(hold, rng), True
    if protocol == "cycles":
        return {
            f"{r:g}": (Move(_STROKE_MM, r), Move(0.0, r)) * _CYCLES for r in _CYCLE_RATES
        }, False
    if protocol == "random_order":
        rates = [rates[k] for k in rng.permutation(len(rates))]
    if protocol == "three_tests":
        rates = list(_THREE)
    programs: dict[str, tuple[Step, ...] | Track] = {
        f"{r:g}": _ramp_hold(protocol, r, hold) for r in rates
    }
    if protocol == "one_retraction":
        rate = rates[int(rng.integers(len(rates)))]
        programs[f"{rate:g}"] = full_retraction_protocol(rate)
    return programs, False


def _ramp_hold(protocol: str, rate: float, hold: float) -> tuple[Step, ...]:
    """Return one test of ramps and holds."""
    up: tuple[Step, ...] = (Move(_STROKE_MM, rate), Hold(hold))
    if protocol == "no_unloading":
        return up
    if protocol == "staircase":
        steps = [(Move(_STROKE_MM * k / 4.0, rate), Hold(hold / 3.0)) for k in (1, 2, 3, 4, 2)]
        return tuple(step for pair in steps for step in pair)
    if protocol == "short_holds":
        return (Move(_STROKE_MM, rate), Hold(5.0), Move(0.8, 1.0), Hold(5.0))
    return (*up, Move(0.8, 1.0), Hold(hold))


def _jerk_limited(hold: float, rng: np.random.Generator) -> dict[str, tuple[Step, ...] | Track]:
    """Return six tests to a random depth (0.6 to 2.5 mm) at random speeds (0.05 to 60 mm/s)."""
    depth = float(rng.uniform(0.6, 2.5))
    speeds = np.sort(np.exp(rng.uniform(np.log(0.05), np.log(60.0), 6)))
    programs: dict[str, tuple[Step, ...] | Track] = {}
    for speed in speeds.tolist():
        rest = (Piece(0.0, hold, 0.0, 0.0, 0.0),)
        back = swing(0.4 * depth - depth, float(rng.uniform(0.5, 5.0)))
        programs[f"{speed:.3g}"] = Track(joined([swing(depth, speed), rest, back, rest]))
    return programs


def sine(stroke: float, frequency: float, cycles: int) -> Track:
    """Return a sine stroke (1 - cos(2 pi f t))/2 in pieces of constant acceleration."""
    omega, count = 2.0 * pi * frequency, cycles * _PIECES_A_CYCLE
    step = 1.0 / (frequency * _PIECES_A_CYCLE)
    velocities = [0.5 * stroke * omega * sin(omega * step * k) for k in range(count + 1)]
    return Track(_of_velocities(velocities, step))


def swing(stroke: float, speed: float) -> tuple[Piece, ...]:
    """Return a move from rest by `stroke` (mm), v = speed (1 - cos(2 pi t/T))/2 sgn(stroke)."""
    total = 2.0 * abs(stroke) / speed
    step = total / _PIECES_A_STROKE
    sign = 1.0 if stroke > 0 else -1.0
    turns = [2.0 * pi * k / _PIECES_A_STROKE for k in range(_PIECES_A_STROKE + 1)]
    return _of_velocities([0.5 * sign * speed * (1.0 - cos(turn)) for turn in turns], step)


def _of_velocities(velocities: Sequence[float], step: float) -> tuple[Piece, ...]:
    """Return pieces between velocities (mm/s) at even steps (s), from displacement 0."""
    pieces, position = [], 0.0
    for k, (v, w) in enumerate(pairwise(velocities)):
        pieces.append(Piece(k * step, step, position, v, (w - v) / step))
        position = pieces[-1].end
    return tuple(pieces)


def _creeping(program: Sequence[Step], creep: float) -> tuple[Step, ...]:
    return tuple(replace(s, creep=creep) if isinstance(s, Hold) else s for s in program)


def _back(position: float, pause: float) -> tuple[Piece, ...]:
    """Return to 0 at 20 mm/s, and rest until the pause is over."""
    if abs(position) < 1e-9:
        return (Piece(0.0, pause, position, 0.0, 0.0),)
    duration = abs(position) / _RETURN_MM_S
    speed = -position / duration
    return Piece(0.0, duration, position, speed, 0.0), Piece(
        duration, pause - duration, 0.0, 0.0, 0.0
    )
