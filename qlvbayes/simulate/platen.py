"""Motion of the rig's platen: strokes with finite acceleration, and holds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite, sqrt

from qlvbayes.io.checks import InputError

from .motion import Motion, Piece

PAPER_RATES = (0.1, 1.0, 10.0, 20.0, 30.0, 100.0)
"""Loading rates of the paper, mm/s."""

PAPER_ACCELERATION = 1000.0
"""Largest acceleration of the paper's platen, mm/s2."""


@dataclass(frozen=True)
class Move:
    """Movement to `target` (mm), from rest to rest, no faster than `speed` (mm/s)."""

    target: float
    speed: float

    def __post_init__(self) -> None:
        if not isfinite(self.target):
            raise InputError(f"a move needs a finite target, not {self.target} mm")
        if not 0 < self.speed < inf:
            raise InputError(f"a move needs a speed above 0, not {self.speed} mm/s")


@dataclass(frozen=True)
class Hold:
    """Standstill for `seconds`, or movement by `creep` (mm) at even speed meanwhile."""

    seconds: float
    creep: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.seconds < inf:
            raise InputError(f"a hold needs a duration above 0, not {self.seconds} s")


Step = Move | Hold


@dataclass(frozen=True)
class Platen(Motion):
    """Exact motion of one run of a program that starts from rest at displacement 0, time 0.

    Each move is a trapezoid of velocity, or a triangle if the stroke is too short to reach its
    speed: the top speed is min(speed, sqrt(acceleration_limit * stroke)).
    """

    program: tuple[Step, ...]  # Moves and Holds, in order
    acceleration_limit: float = PAPER_ACCELERATION  # mm/s2
    # clock at the start of the motion (s), for materials that change between tests
    start_s: float = 0.0
    number: int = 0  # number of the pad's tests before this one

    def __post_init__(self) -> None:
        if not 0 < self.acceleration_limit < inf:
            raise InputError(f"acceleration must be above 0, not {self.acceleration_limit} mm/s2")
        if not self.pieces:
            raise InputError("the program does nothing", remedy="give it a move or a hold")

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """The program as stretches of constant acceleration, in order."""
        pieces: list[Piece] = []
        clock, position = 0.0, 0.0
        for step in self.program:
            if isinstance(step, Hold):
                stretch = [Piece(clock, step.seconds, position, step.creep / step.seconds, 0.0)]
                position += step.creep
            else:
                stretch = _stroke(clock, position, step, self.acceleration_limit)
                position = step.target
            pieces += stretch
            if stretch:
                clock = stretch[-1].start + stretch[-1].duration
        return tuple(pieces)


def paper_protocol(rate: float) -> tuple[Step, ...]:
    """Give the paper's test: to 1.6 mm at `rate` (mm/s), 30 s, back to 0.8 mm at 1 mm/s, 30 s."""
    return Move(1.6, rate), Hold(30.0), Move(0.8, 1.0), Hold(30.0)


def full_retraction_protocol(rate: float, depth: float = 1.6) -> tuple[Step, ...]:
    """Press twice to `depth` (mm) at `rate` (mm/s), each time held 10 s and taken back to 0."""
    press = Move(depth, rate), Hold(10.0)
    return (*press, Move(0.0, min(rate, 20.0)), Hold(5.0), *press, Move(0.0, 1.0), Hold(5.0))


def pull_off_protocol(rate: float, depth: float = 1.6) -> tuple[Step, ...]:
    """Press to `depth` (mm) at `rate` (mm/s), hold 10 s, draw back to `depth` / 4 above the pad."""
    once = Move(depth, rate), Hold(10.0), Move(-0.25 * depth, 1.0), Hold(5.0)
    return (*once, *once)


PROTOCOLS = {
    "paper": paper_protocol,
    "retraction": full_retraction_protocol,
    "pull_off": pull_off_protocol,
}
"""Protocols by name; each gives the program of one test from its rate (mm/s)."""


def _stroke(clock: float, position: float, move: Move, limit: float) -> list[Piece]:
    """Accelerate, cruise and brake; no piece has zero length."""
    stroke = abs(move.target - position)
    if stroke == 0.0:
        return []
    sign = 1.0 if move.target > position else -1.0
    top = min(move.speed, sqrt(limit * stroke))
    rise = top / limit
    cruise = stroke / top - rise
    run_up = 0.5 * top * rise
    pieces = [Piece(clock, rise, position, 0.0, sign * limit)]
    if cruise > 1e-12 * rise:
        pieces.append(Piece(clock + rise, cruise, position + sign * run_up, sign * top, 0.0))
    else:
        cruise = 0.0
    brake_from = move.target - sign * run_up
    pieces.append(Piece(clock + rise + cruise, rise, brake_from, sign * top, -sign * limit))
    return pieces
