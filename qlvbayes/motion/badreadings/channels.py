"""Comparison of the two channels of a test: whether one channel confirms what the other reads.

Where the platen goes the force follows, and the force changes where the platen went: a reading of
one channel that the other bears out is the specimen's, however sudden.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.motion.badreadings.outliers import ChangeScale, Run, distance
from qlvbayes.motion.badreadings.result import neighbours

_STIFFER = 5.0  # than the record's secant a specimen may be at its stiffest
_LEAVES = 2.0  # the same, of what it loses with contact: all that it bore
_EITHER_SIDE = 2  # readings on either side that count as meanwhile
_NOTICED = 8.0  # times the noise: a change of force that would surely be seen
_FOLLOWED = 0.25  # of that change: so much of it would be seen at the least
_BENDS = 8  # readings on either side in which a change of speed makes an inertial force
_BENT = 2.5  # steps of the encoder by which the motion leaves a line where its speed changes,
_SHARPLY = 4.0  # and times the record's median, where it bends all the time
_IMPOSSIBLE = 5.0  # times the largest speed otherwise seen: no platen is so fast
_RETURNS = 0.1  # of an excursion: so exactly a channel comes back that never left
_SMALL = 0.02  # of the range: a larger step is one of the motion, sampled seldom


@dataclass(frozen=True)
class Channels:
    """The displacement and force channels of one test of n readings."""

    time: Array
    displacement: Array
    force: Array
    of_displacement: ChangeScale
    of_force: ChangeScale
    doubtful: NDArray[np.bool_]  # (n,) readings that either channel doubts by itself
    fastest: float  # largest speed that other readings of the pad's tests show
    lost: NDArray[np.bool_]  # (n,) readings of displacement found to be bad

    def at(self, some: NDArray[np.intp]) -> Channels:
        """Return some of the readings (k,), in order."""
        return Channels(
            self.time[some], self.displacement[some], self.force[some],
            self.of_displacement.at(some), self.of_force.at(some),
            self.doubtful[some], self.fastest, self.lost[some],
        )  # fmt: skip

    @property
    def stiffness(self) -> float:
        """Range of the force divided by the range of the displacement."""
        span = self.of_displacement.span
        return self.of_force.span / span if span > 0.0 else 0.0

    def moved(self, run: Run) -> float:
        """Return how far the platen moved around a run; 0 if step and noise explain as much."""
        d = self.displacement[self._about(run, _EITHER_SIDE)]
        travel = float(np.ptp(d)) if d.size else 0.0
        return travel if travel > self._flicker(run) else 0.0

    def bends(self, run: Run) -> bool:
        """Return whether the platen's speed changes nearby by more than it does elsewhere."""
        departure = self._departure(run)
        return departure > max(_BENT * self._flicker(run), _SHARPLY * self.typical_departure)

    def force_contradicted(self, run: Run) -> bool:
        """Return whether no motion of the platen explains the force readings of a run."""
        lost = not self.force[slice(*run)].any()
        if not lost and self.bends(run):
            return False
        before, after = self._sides(run)
        off = distance(self.force[run[0] : run[1]], self.force[before], self.force[after])
        stiffer = _LEAVES if lost else _STIFFER
        return float(off.min()) > stiffer * self.stiffness * self.moved(run)

    def displacement_contradicted(self, run: Run) -> bool:
        """Return whether the force shows no sign of the displacement readings of a run."""
        before, after = self._sides(run)
        one, other = self.displacement[before], self.displacement[after]
        inside = slice(*run)
        off = float(distance(self.displacement[inside], one, other).min())
        expected = self.stiffness * off
        if abs(float(self.displacement[inside][0])) < min(abs(one), abs(other)):  # back towards 0
            expected = min(expected, abs(float(self.force[before])), abs(float(self.force[after])))
        seen = self.force_change(run, before, after)
        noise = _NOTICED * float(self.of_force.deviation[run[0]]) + self.of_force.step
        if expected > noise:
            return seen < _FOLLOWED * expected
        returns = abs(other - one) < _RETURNS * off
        return bool(returns and self.speed(run) > _IMPOSSIBLE * self.fastest)

    def row_contradicted(self, run: Run, own_fastest: float) -> bool:
        """Return whether both channels read 0 although the platen cannot have moved that far."""
        inside = slice(*run)
        nothing = not self.displacement[inside].any() and not self.force[inside].any()
        return nothing and self.speed(run) > _IMPOSSIBLE * own_fastest

    def speed(self, run: Run) -> float:
        """Return the lowest speed with which the platen could have made the excursion."""
        before, after = self._sides(run)
        first, last = run[0], run[1] - 1
        away = abs(self.displacement[first] - self.displacement[before])
        back = abs(self.displacement[after] - self.displacement[last])
        return float(
            min(
                away / (self.time[first] - self.time[before]),
                back / (self.time[after] - self.time[last]),
            )
        )

    def force_change(self, run: Run, before: int, after: int) -> float:
        """Return how far the force in a run deviates from the line between its two sides."""
        inside = slice(*run)
        line = np.interp(self.time[inside], self.time[[before, after]], self.force[[before, after]])
        off = np.abs(self.force[inside] - line)
        return float(max(off[0], off[-1], np.median(off)))

    def _sides(self, run: Run) -> tuple[int, int]:
        """Return the sound readings before and after a run; at the record's end one twice."""
        before, after = neighbours(self.doubtful, *run)
        if before is None:
            before = after
        if after is None:
            after = before
        assert before is not None
        assert after is not None
        return before, after

    def _flicker(self, run: Run) -> float:
        """Return how far readings at rest may differ: a step of the encoder, and noise."""
        noise = self.of_displacement
        step = noise.step if noise.step < _SMALL * noise.span else 0.0
        return 1.01 * step + 4.0 * float(noise.deviation[run[0]])

    def _about(self, run: Run, reach: int) -> NDArray[np.intp]:
        """Return the indices of the readings in and around a run whose displacement counts."""
        low, high = max(run[0] - reach, 0), min(run[1] + reach, self.time.size)
        indices = np.arange(low, high)
        return indices[~self.lost[indices]]

    def _departure(self, run: Run) -> float:
        indices = self._about(run, _BENDS)
        return _deflection(self.time[indices], self.displacement[indices])

    @cached_property
    def typical_departure(self) -> float:
        """Median deviation from a straight line, over all stretches of this length."""
        sound = np.flatnonzero(~self.doubtful)
        width = 2 * _BENDS + 1
        if sound.size < 2 * width:
            return 0.0
        starts = np.linspace(0, sound.size - width, 60).astype(int)
        parts = [sound[k : k + width] for k in np.unique(starts)]
        return float(np.median([_deflection(self.time[p], self.displacement[p]) for p in parts]))


def fastest(time: Array, displacement: Array, sound: NDArray[np.bool_]) -> float:
    """Return the largest speed from one sound reading to the next."""
    t, d = time[sound], displacement[sound]
    return float(np.max(np.abs(np.diff(d)) / np.diff(t), initial=0.0))


def _deflection(time: Array, values: Array) -> float:
    """Return the largest deviation of values from the line between their ends."""
    if time.size < 3:
        return 0.0
    line = np.interp(time, time[[0, -1]], values[[0, -1]])
    return float(np.max(np.abs(values - line)))
