"""Readings of holds and recoveries, which show the noise alone.

Where there are none, those of strokes in which the force is a smooth curve of time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import qr

from qlvbayes.io.arrays import Array
from qlvbayes.motion.phases import Phase

_MOST = 12
_BURST, _SPREAD = 120, 120  # readings in a row; means over the others of a dwell
_GAPS = (1, 1, 2, 3, 5, 8, 13, 21)  # samples between the readings in a row
_FEWEST_SAMPLES = 24
_CONTACT = 0.02  # of the largest force: below, contact may be lost
_PRESSED = 0.1  # of the same: below, a stroke may have a kink, as contact is found or lost
_MARGIN = 0.1  # of a stroke, at either end: its turning point may have a kink
_A_TIME = 6  # readings for each relaxation time of the trend: most of them are left for the noise
_DEGREE = 8  # of a stroke's trend: it leaves far less than noise of a soft law's half cycle


class MeasuredTest(Protocol):
    """The fields of a test that the noise floor needs."""

    @property
    def time(self) -> Array:
        """Time in s."""
        ...

    @property
    def displacement(self) -> Array:
        """Displacement in mm (or strain)."""
        ...

    @property
    def force(self) -> Array:
        """Force in N (or stress in kPa)."""
        ...

    @property
    def force_sd(self) -> Array | None:
        """Sd of each reading, where known."""
        ...


@dataclass(frozen=True)
class Readings:
    """Some readings of a test, as a `MeasuredTest` has them."""

    time: Array
    displacement: Array
    force: Array
    force_sd: Array | None


@dataclass(frozen=True)
class Dwell:
    """A dwell: all readings (n,) and the first one (k,) of each run that is averaged."""

    time: Array
    force: Array
    scale: Array  # (n,) relative sd of each reading
    begin: NDArray[np.intp]
    degree: int = 1  # of the polynomial that is there with the relaxation
    curve: Array | None = None  # (k, p) means over the runs of what may be there instead

    @property
    def count(self) -> Array:
        """Readings in each run (k,)."""
        return np.diff(np.append(self.begin, self.time.size)).astype(np.float64)

    @property
    def length(self) -> Array:
        """Time (k,) from a run's first reading to its last."""
        last = np.append(self.begin[1:], self.time.size) - 1
        return np.asarray(self.time[last] - self.time[self.begin])

    def mean(self, values: Array) -> Array:
        """Return means over the runs (k, ...) of values (n, ...)."""
        total = np.add.reduceat(values, self.begin, axis=0)
        return np.asarray(total / self.count.reshape(-1, *[1] * (values.ndim - 1)))


def find_dwells(
    tests: Sequence[MeasuredTest], phases: Sequence[Sequence[Phase]], step: float
) -> list[Dwell]:
    """Return the best-sampled dwells, one of each test before a second of any."""
    return _best_sampled(tests, phases, lambda test, phase: _at_rest(test, phase, step))


def find_strokes(tests: Sequence[MeasuredTest], phases: Sequence[Sequence[Phase]]) -> list[Dwell]:
    """Return the best-sampled loading and unloading strokes while the pad is pressed."""
    return _best_sampled(tests, phases, _stroke)


def _best_sampled(
    tests: Sequence[MeasuredTest],
    phases: Sequence[Sequence[Phase]],
    read: Callable[[MeasuredTest, Phase], Dwell | None],
) -> list[Dwell]:
    ranked: list[tuple[int, int, Dwell]] = []
    for test, cut in zip(tests, phases, strict=True):
        dwells = [dwell for phase in cut if (dwell := read(test, phase)) is not None]
        dwells.sort(key=lambda one: -one.time.size)
        ranked += [(turn, -one.time.size, one) for turn, one in enumerate(dwells)]
    ranked.sort(key=lambda item: item[:2])
    return [dwell for _, _, dwell in ranked[:_MOST]]


def _at_rest(test: MeasuredTest, phase: Phase, step: float) -> Dwell | None:
    if phase.kind not in ("hold", "recovery"):
        return None
    inside = np.flatnonzero((test.time > phase.start) & (test.time <= phase.stop))
    inside = inside[_regained(test.force, inside) :]
    # The kinks may be misplaced by a few samples.
    margin = min(5, inside.size // 8)
    inside = inside[margin : inside.size - margin]
    if inside.size < _FEWEST_SAMPLES or _silent(test.force, inside, step):
        return None
    return dwell_of(test, inside)


def _stroke(test: MeasuredTest, phase: Phase) -> Dwell | None:
    if phase.kind in ("hold", "recovery"):
        return None
    margin = _MARGIN * (phase.stop - phase.start)
    away = (test.time > phase.start + margin) & (test.time <= phase.stop - margin)
    inside = pressed(test, away)
    if inside is None or np.ptp(inside) >= 2 * inside.size:
        return None
    return replace(dwell_of(test, inside), degree=_DEGREE)


def pressed(test: MeasuredTest, among: NDArray[np.bool_]) -> NDArray[np.intp] | None:
    """Return the readings among some (n,) at which the pad is pressed; None if there are few."""
    least = _PRESSED * float(np.abs(test.force).max(initial=0.0))
    inside = np.flatnonzero(among & (np.abs(test.force) > least))
    return inside if inside.size >= 3 * _FEWEST_SAMPLES else None


def _regained(force: Array, inside: NDArray[np.intp]) -> int:
    """Return the first reading of a dwell after contact is regained; 0 if it was not lost."""
    free = np.flatnonzero(force[inside] < _CONTACT * np.abs(force).max(initial=0.0))
    return 0 if free.size == 0 or free[-1] == inside.size - 1 else int(free[-1]) + 1


def _silent(force: Array, inside: NDArray[np.intp], step: float) -> bool:
    """Return whether readings repeat and show no noise: out of contact or clipped."""
    there = force[inside]
    if not np.mean(np.diff(there) == 0.0) > 0.5:
        return False
    median = float(np.median(there))
    return step == 0.0 or abs(median) < step or median >= float(force.max())


def dwell_of(test: MeasuredTest, inside: NDArray[np.intp]) -> Dwell:
    """Return the readings of a test at some indices, thinned where there are many."""
    scale = np.ones(inside.size)
    if test.force_sd is not None:
        scale = test.force_sd[inside] / np.sqrt(np.mean(np.square(test.force_sd)))
        scale = np.maximum(scale, 1e-3)
    kept, begin = _kept(test.time[inside])
    inside = inside[kept]
    return Dwell(test.time[inside], test.force[inside], scale[kept], begin)


def _kept(time: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the readings that are used, and which of them begin a run that is averaged."""
    n = time.size
    if n <= _BURST + _SPREAD:
        return np.arange(n), np.arange(n)
    steps = np.cumsum(np.resize(_GAPS, _BURST))
    steps = steps[steps < n // 2]
    late = np.linspace(n // 5, n - steps[-1] - 1, 200).astype(int)
    start = int(late[np.argmin(time[late + steps[-1]] - time[late])])
    first = max(time[1] - time[0], 1e-3 * np.ptp(time))
    after = time[0] + np.geomspace(first, np.ptp(time), 40)
    even = np.linspace(time[0], time[-1], _SPREAD - 40)
    others = np.clip(np.searchsorted(time, np.concatenate([after, even])), 0, n - 1)
    others = np.setdiff1d(others, np.arange(start, start + steps[-1] + 1))
    begin = np.unique(np.concatenate([others, start + steps]))
    length = np.maximum(np.diff(np.append(begin, n)) // 4, 1)
    length[np.isin(begin, start + steps)] = 1
    ends = np.cumsum(length)
    kept = np.arange(ends[-1]) - np.repeat(ends - length, length) + np.repeat(begin, length)
    return kept, ends - length


def trend(dwell: Dwell, ratio: float) -> Array:
    """Return an orthonormal basis (k, p) of everything but the noise, as means over the runs."""
    curve = dwell.mean(_relaxing(dwell, ratio)) if dwell.curve is None else dwell.curve
    q, r, _ = qr(curve / run_scale(dwell)[:, None], mode="economic", pivoting=True)
    size = np.abs(np.diag(r))
    return np.asarray(q[:, size > 1e-10 * size[0]], dtype=np.float64)


def _relaxing(dwell: Dwell, ratio: float) -> Array:
    """Return columns (n, p) of a polynomial in time and of exponentials."""
    t = dwell.time - dwell.time[0]
    length = float(t[-1])
    shortest = max(2.0 * float(t[1]), 2e-4 * length)
    times = length / ratio ** np.arange(1.0 + np.log(length / shortest) // np.log(ratio))
    if (most := max(2, dwell.begin.size // _A_TIME)) < times.size:
        times = np.geomspace(times[0], times[-1], most)
    powers = legendre.legvander(2.0 * t / length - 1.0, dwell.degree)
    return np.column_stack([powers, np.exp(-t[:, None] / times)])


def run_scale(dwell: Dwell) -> Array:
    """Return the relative sd (k,) of a reading in each run, as a root mean square."""
    return np.sqrt(dwell.mean(dwell.scale**2))
