"""Motion of the platen as stretches of constant acceleration."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from qlvbayes.io.checks import InputError


@dataclass(frozen=True)
class Piece:
    """A stretch of constant acceleration: d = displacement + velocity t + acceleration t^2 / 2.

    t runs from 0 to `duration` (s); the piece begins `start` seconds into the program.
    """

    start: float
    duration: float
    displacement: float
    velocity: float
    acceleration: float

    @property
    def end(self) -> float:
        """Displacement at the end, mm."""
        return self.displacement + self.duration * (
            self.velocity + 0.5 * self.acceleration * self.duration
        )


class Motion:
    """Exact motion along `pieces` that follow one another without a gap; at rest outside of them.

    start_s : clock at the start of the motion (s), for materials that change between tests
    number : of the pad's tests before this one
    """

    start_s: float
    number: int

    @property
    def pieces(self) -> Sequence[Piece]:
        """The motion as stretches of constant acceleration, in order."""
        raise NotImplementedError

    @property
    def duration(self) -> float:
        """Length of the program, s."""
        return self.pieces[-1].start + self.pieces[-1].duration

    @cached_property
    def kinks(self) -> NDArray[np.float64]:
        """Times (s) at which the acceleration jumps, from the start of the motion on."""
        before = np.concatenate([[0.0], self._table[:, 3]])
        after = np.concatenate([self._table[:, 3], [0.0]])
        times = np.concatenate([self._table[:, 0], [self.duration]])
        return times[before != after]

    def displacement(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the displacement (mm) at times `t` (s); the platen rests before and afterwards."""
        _, tau, (d, v, a) = self._locate(t)
        return d + tau * (v + 0.5 * a * tau)

    def velocity(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the velocity (mm/s) at times `t` (s)."""
        inside, tau, (_, v, a) = self._locate(t)
        return np.where(inside, v + a * tau, 0.0)

    def acceleration(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the acceleration (mm/s2) at times `t` (s), continuous from the right."""
        inside, _, (_, _, a) = self._locate(t)
        return np.where(inside, a, 0.0)

    @cached_property
    def _table(self) -> NDArray[np.float64]:
        return np.array(
            [[p.start, p.displacement, p.velocity, p.acceleration] for p in self.pieces]
        )

    def _locate(
        self, t: ArrayLike
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64]]:
        times = np.asarray(t, dtype=np.float64)
        inside = (times >= 0.0) & (times < self.duration)
        times = np.clip(times, 0.0, self.duration)
        start = self._table[:, 0]
        index = np.searchsorted(start, times, side="right") - 1
        return inside, times - start[index], np.moveaxis(self._table[index, 1:], -1, 0)


@dataclass(frozen=True)
class Track(Motion):
    """Motion given by its pieces; InputError unless each begins where and when one ends."""

    stretches: tuple[Piece, ...]
    start_s: float = 0.0
    number: int = 0

    def __post_init__(self) -> None:
        if not self.stretches:
            raise InputError("the motion has no pieces")
        for one, two in zip(self.stretches, self.stretches[1:], strict=False):
            late = abs(one.start + one.duration - two.start) > 1e-9 * (1.0 + two.start)
            if late or abs(one.end - two.displacement) > 1e-9:
                raise InputError(f"the motion has a gap at {two.start:g} s")

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The stretches."""
        return self.stretches


def joined(parts: Iterable[Sequence[Piece]]) -> tuple[Piece, ...]:
    """Join pieces of motions: each begins when and where the one before ends."""
    pieces: list[Piece] = []
    for part in parts:
        clock = pieces[-1].start + pieces[-1].duration if pieces else 0.0
        position = pieces[-1].end if pieces else 0.0
        first = part[0]
        pieces += [
            replace(
                p,
                start=p.start - first.start + clock,
                displacement=p.displacement - first.displacement + position,
            )
            for p in part
        ]
    return tuple(pieces)
