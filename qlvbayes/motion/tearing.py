"""A force that breaks down while the platen goes on pressing or pulling: a tear, or a slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.io.data import Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.motion.phases import Phase
from qlvbayes.motion.trajectory import Trajectory

_SHARE = 0.05  # of the test's largest force, that is lost from one reading to the next
_SCATTERS = 10.0  # sds of the changes between neighbouring readings around it
_AROUND = 10  # readings on each side in which that sd is measured: noise may fade along a test
_MOVING = 0.3  # of the ramp's mean speed: at a hold's beginning the force may fall by itself
_LASTING = 3  # readings on each side whose medians are compared: a single bad reading comes back


@dataclass(frozen=True)
class Tear:
    """A sudden loss of force, from ``before`` to ``after``, in the units of the pad; time in s."""

    time: float
    displacement: float
    before: float
    after: float


def tears_of(test: Test, trajectory: Trajectory, phases: Sequence[Phase]) -> tuple[Tear, ...]:
    """Return the sudden losses of force in the loading ramps of a test, in the order of time.

    The force falls between two neighbouring readings by more than 5 % of the test's largest and
    more than ten sds of the changes around it, it stays down, and the platen goes on moving. What
    relaxes or softens loses its force over many readings.
    """
    change = np.diff(test.force)
    least = _SHARE * float(np.max(np.abs(test.force)))
    at = np.flatnonzero(change < -least)  # in a noisy record of many readings these are many
    before = np.nanmedian(_around(test.force, at, range(1 - _LASTING, 1)), axis=1)
    after = np.nanmedian(_around(test.force, at, range(1, 1 + _LASTING)), axis=1)
    stays = before - after > 0.5 * np.maximum(least, -change[at])
    at, after = at[stays], after[stays]
    nearby = _around(change, at, [k for k in range(-_AROUND, _AROUND + 1) if k != 0])
    middle = np.nanmedian(nearby, axis=1, keepdims=True)
    scatter = 1.4826 * np.nanmedian(np.abs(nearby - middle), axis=1)
    sudden = -change[at] > _SCATTERS * scatter
    return tuple(
        Tear(float(test.time[k]), float(test.displacement[k]), float(test.force[k]), float(later))
        for k, later in zip(at[sudden].tolist(), after[sudden], strict=True)
        if any(_goes_on(trajectory, phase, test, k) for phase in phases)
    )


def _around(values: np.ndarray, at: np.ndarray, steps: Sequence[int]) -> np.ndarray:
    """Return values (K, S) at S steps from each of K indices, nan beyond the ends."""
    indices = at[:, None] + np.asarray(steps)
    inside = (indices >= 0) & (indices < values.size)
    return np.where(inside, values[np.clip(indices, 0, values.size - 1)], np.nan)


def _goes_on(trajectory: Trajectory, phase: Phase, test: Test, k: int) -> bool:
    """Return whether the platen advances after reading k, well within a loading ramp."""
    begin, end = test.time[k], test.time[min(k + _LASTING, test.time.size - 1)]
    if phase.kind != "ramp" or begin < phase.start or end > phase.stop:
        return False
    start, before, after, stop = trajectory.displacement(
        np.array([phase.start, begin, end, phase.stop])
    )
    mean_speed = (stop - start) / (phase.stop - phase.start)
    return bool((after - before) / (end - begin) > _MOVING * mean_speed)


def tear_notice(pad: str, test: str, tears: Sequence[Tear], units: UnitSystem) -> str:
    """Return a sentence on the tears of a test, with the option that uses the part before them."""
    first = tears[0]
    more = f" (and {len(tears) - 1} times more after it)" if len(tears) > 1 else ""
    return (
        f"pad {pad}: in test {test} the force falls at once from {first.before:.3g} to "
        f"{first.after:.3g} {units.force} at {first.displacement:.4g} {units.displacement}{more} "
        "while the platen goes on: the specimen may tear or slip, which no model here has; "
        f"--use '{test}:..{first.time:.6g}s' uses the part before"
    )
