"""Disturbed records: readings lost, a start that comes late, unequal holds, noise that changes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log

import numpy as np
from numpy.typing import NDArray

from .motion import Motion, Piece, Track, joined
from .programmes import Session

Array = NDArray[np.float64]

RECORDS = ("plain", "lost_readings", "late_start", "unequal_holds", "changing_noise")
"""Kinds of records; in all but the first something goes wrong."""

_LOST = 0.01  # of a test's readings, at most; of more no program makes anything
_OF_FORCE = 0.7  # of the tests with lost readings: the force's, else the displacement's
_LATE = (0.1, 0.5)  # of the first way in, after which a record begins
_SHORTEST = 0.05  # of a hold that is cut short,
_LEAST_S = 1.0  # and in s, as far as it was as long
_RESTING_MM = 1e-3  # most that the platen creeps in a hold


@dataclass(frozen=True)
class NoiseGain:
    """Factor by which noise is larger than at its smallest, along a test.

    factor: the largest; share: of the test, the time constant with which it dies away, or, where it
    rises, the moment at which it does; rises: at once, instead of dying away.
    """

    factor: float
    share: float
    rises: bool

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> NoiseGain:
        """Draw noise that dies away from 4 to 30 times, or rises to 3 to 10 times at once."""
        if rng.random() < 0.5:
            return cls(_spread(rng, 4.0, 30.0), _spread(rng, 0.02, 0.3), False)
        return cls(_spread(rng, 3.0, 10.0), float(rng.uniform(0.2, 0.8)), True)

    def at(self, time: Array, duration: float) -> Array:
        """Return the factor (n,) at times (s) of a test of some duration (s)."""
        passed = time / duration
        if self.rises:
            return np.where(passed > self.share, self.factor, 1.0)
        return 1.0 + (self.factor - 1.0) * np.exp(-passed / self.share)


def unequal_holds(plan: Session, rng: np.random.Generator) -> Session:
    """Return the session with the holds of all tests but one cut to 5 to 100 % of their length."""
    whole = int(rng.integers(len(plan.motions)))
    motions: dict[str, Motion] = {}
    clock = 0.0
    for number, (name, motion) in enumerate(plan.motions.items()):
        share = _spread(rng, _SHORTEST, 1.0)
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


def _spread(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a log-uniform number between two bounds."""
    return float(np.exp(rng.uniform(log(low), log(high))))
