"""Falls of the force where a specimen tears or slips, and its stiffness, without a model."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from qlvbayes.io.data import Control, Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.phases import Phase
from qlvbayes.motion.trajectory import Trajectory

_SUDDEN = 0.05  # of the test's largest force, that is lost from one reading to the next
_SCATTERS = 10.0  # sds of the changes between neighbouring readings around it
_AROUND = 10  # readings on each side in which that sd is measured: noise may fade along a test
_MOVING = 0.3  # of the ramp's mean speed: at a hold's beginning the force may fall by itself
_LASTING = 3  # readings on each side whose medians are compared: a single bad reading comes back
_MATERIAL = 0.1  # of the top speed, that an acceleration of one sign changes the speed by
_SHARP = 0.5  # of that acceleration's largest, by which it changes within a few readings
_DOUBT = 3.0  # sds of the time of a kink
_TINY = np.finfo(float).tiny
_LAST = 0.25  # of the way to the largest force, where the slope is taken
_SURELY = 5.0  # of the sds of readings around it, above which a force is no noise
_NEARBY = 21  # readings around, for which one sd is taken


@dataclass(frozen=True)
class ForceDrop:
    """A loss of force, from ``before`` to ``after``, in the units of the pad; time in s."""

    # time, displacement: of the last reading before it
    time: float
    displacement: float
    before: float
    after: float


def falls_of(test: Test, trajectory: Trajectory, phases: Sequence[Phase]) -> tuple[ForceDrop, ...]:
    """Return the sudden losses of force in the loading ramps of a test, in the order of time."""
    prescribed = (phase for phase in phases if phase.control == Control.DISPLACEMENT)
    ramps = [phase for phase in prescribed if phase.kind == "ramp"]
    steady = ~speed_changes(test, trajectory, _LASTING)
    change = np.diff(test.force)
    least = _SUDDEN * float(np.max(np.abs(test.force)))
    # in a noisy record of many readings these are many
    at = np.flatnonzero((change < -least) & steady[:-1] & steady[1:])
    before = np.nanmedian(_around(test.force, at, range(1 - _LASTING, 1)), axis=1)
    after = np.nanmedian(_around(test.force, at, range(1, 1 + _LASTING)), axis=1)
    stays = np.maximum(before, 0.0) - np.maximum(after, 0.0) > 0.5 * np.maximum(least, -change[at])
    at, after = at[stays], after[stays]
    nearby = _around(change, at, [k for k in range(-_AROUND, _AROUND + 1) if k != 0])
    middle = np.nanmedian(nearby, axis=1, keepdims=True)
    scatter = 1.4826 * np.nanmedian(np.abs(nearby - middle), axis=1)
    clear = -change[at] > _SCATTERS * scatter
    at, after = at[clear], after[clear]
    goes_on = np.zeros(at.size, dtype=bool)
    begin, end = test.time[at], test.time[np.minimum(at + _LASTING, test.time.size - 1)]
    for ramp in ramps:  # the platen advances after it, well within a loading ramp
        whole = np.array([ramp.start, ramp.stop])
        mean_speed = float(np.diff(trajectory.displacement(whole))[0] / np.diff(whole)[0])
        way = trajectory.displacement(end) - trajectory.displacement(begin)
        inside = (begin >= ramp.start) & (end <= ramp.stop)
        goes_on |= inside & (way > _MOVING * mean_speed * (end - begin))
    at, after = at[goes_on], after[goes_on]
    apart = np.flatnonzero(np.diff(at) > _LASTING) + 1
    runs = np.split(np.arange(at.size), apart) if at.size else []
    ends = [(int(at[k[0]]), float(after[k[-1]])) for k in runs]
    return tuple(
        ForceDrop(float(test.time[k]), float(test.displacement[k]), float(test.force[k]), left)
        for k, left in ends
    )


def _around(values: np.ndarray, at: np.ndarray, steps: Sequence[int]) -> np.ndarray:
    """Return values (K, S) at S steps from each of K indices, nan beyond the ends."""
    indices = at[:, None] + np.asarray(steps)
    inside = (indices >= 0) & (indices < values.size)
    return np.where(inside, values[np.clip(indices, 0, values.size - 1)], np.nan)


def fall_notice(pad: str, test: str, falls: Sequence[ForceDrop], units: UnitSystem) -> str:
    """Return a sentence on the falls of a test, with the option that uses the part before them."""
    first, more = falls[0], len(falls) - 1
    again = "" if not more else f", and {more} more time{'s' if more > 1 else ''} after it"
    unit = "" if units.dimensionless else f" {units.displacement}"
    part = shlex.quote(f"{pad}/{test}:..{first.time:.9g}s")
    return (
        f"pad {pad}, test {test}: the {units.force_name} falls "
        f"at once from {plain(first.before)} to {plain(first.after)} "
        f"{units.force} from {plain(first.displacement, 4)}{unit} on{again}, while the platen "
        "moves in, as where a specimen tears or slips, which no part of the model "
        f"describes; --use {part} uses the part before"
    )


def speed_changes(test: Test, trajectory: Trajectory, width: int) -> NDArray[np.bool_]:
    """Return which readings (n,) lie within ``width`` readings of a sharp change of acceleration.

    A start, the end of a speeding up, braking and a stop are such changes, and a jump of the speed;
    an acceleration counts from a tenth of the top speed on, as a fitted motion also ripples.
    """
    knots, time = trajectory.knots, test.time
    inside = 1e-6 * np.diff(knots)
    begin, end = knots[:-1] + inside, knots[1:] - inside
    rate, speed, least = trajectory.acceleration, trajectory.velocity, _MATERIAL
    least *= max(trajectory.top_speed, _TINY)
    # the largest acceleration of one sign that each piece belongs to, 0 where that changes little
    size = np.max(np.abs([rate(begin), rate(0.5 * (begin + end)), rate(end)]), axis=0)
    gained, largest = speed(end) - speed(begin), np.zeros(begin.size)
    for part in np.split(np.arange(begin.size), np.flatnonzero(np.diff(np.sign(gained))) + 1):
        if abs(np.sum(gained[part])) >= least:
            largest[part] = np.max(size[part])
    at = np.sort(np.concatenate([begin, end, time]))
    of = largest[np.clip(np.searchsorted(knots, at, side="right") - 1, 0, largest.size - 1)]
    share = np.divide(rate(at), of, out=np.zeros(at.size), where=of > 0.0)
    firsts = np.minimum(np.searchsorted(at, time), at.size - 1)  # until the next reading
    high = maximum_filter1d(np.maximum.reduceat(share, firsts), 2 * width, mode="nearest")
    low = minimum_filter1d(np.minimum.reduceat(share, firsts), 2 * width, mode="nearest")
    near = high - low >= _SHARP
    jumps, kinks = np.abs(speed(begin[1:]) - speed(end[:-1])), trajectory.kinks
    for k in np.flatnonzero(jumps >= least):
        sd = _DOUBT * float(np.interp(knots[k + 1], kinks, trajectory.kink_sd))
        first, stop = np.searchsorted(time, [knots[k + 1] - sd, knots[k + 1] + sd])
        near[max(first - width, 0) : stop + width] = True
    return near


def largest_force(test: Test) -> float:
    """Return the largest magnitude of the force (N), noise aside."""
    return float(np.max(np.where(_above_noise(test), np.abs(test.force), 0.0)))


def _above_noise(test: Test) -> NDArray[np.bool_]:
    """Return which readings are larger than their own noise, all if none is or none is known."""
    every = np.ones(test.force.size, dtype=bool)
    if test.force_sd is None:
        return every
    around = maximum_filter1d(test.force_sd, _NEARBY)  # where noise ends its sd is not sharp
    clear = np.abs(test.force) > _SURELY * around
    return clear if clear.any() else every


def largest_stiffness(tests: Sequence[Test]) -> float:
    """Return the slope (N/mm) of the force over the last quarter of the way to its maximum."""
    depth = max(float(np.max(np.abs(test.displacement))) for test in tests)
    hardest = max(tests, key=largest_force)
    clear = _above_noise(hardest)
    peak = int(np.argmax(np.where(clear, np.abs(hardest.force), 0.0)))
    travel, force = (np.abs(x[: peak + 1]) for x in (hardest.displacement, hardest.force))
    secant = float(force[-1]) / depth
    last = clear[: peak + 1] & (travel >= (1.0 - _LAST) * travel[-1])
    spread = travel[last] - np.mean(travel[last])
    if travel[-1] < _LAST * depth or not np.any(spread):
        return secant
    return max(float(spread @ force[last] / (spread @ spread)), secant)
