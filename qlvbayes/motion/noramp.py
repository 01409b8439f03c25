"""Refusal of a test in which no loading is seen, with what is seen in its place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.phases import Phase
from qlvbayes.motion.trajectory import Trajectory

_DIGITS = 4  # of a displacement: a machine's position has a large part that is no depth


def no_ramp(
    test: Test, trajectory: Trajectory, phases: Sequence[Phase], units: UnitSystem
) -> InputError:
    """Return the error that names a test without a ramp, what it does, and a remedy."""
    word = units.displacement_name
    unit = "" if units.dimensionless else f" {units.displacement}"
    falls = [phase for phase in phases if phase.kind == "unload"]
    if not falls:
        changes = f"changes by {plain(float(np.ptp(test.displacement)), 2)}{unit} only"
        remedy = "add the rows of the ramp before this hold, or delete the test"
        return _error(test, f"its {word} {changes}", remedy)
    ends = trajectory.displacement(np.array([falls[0].start, falls[-1].stop]))
    start, stop = (plain(float(end), _DIGITS) for end in ends)
    seen = f"its {word} only falls, from {start} to {stop}{unit}"
    if _force_rises(test, falls[0]):
        seen += f", while the {units.force_name} rises, so that it counts the wrong way"
        turned = f"write its value at first contact minus each value as {word}"
        return _error(test, seen, f"{turned}, so that pressing makes it rise from zero")
    seen += f", and the {units.force_name} falls with it"
    both = f"multiply {word} and {units.force_name} by -1 if this is the loading"
    return _error(test, seen, f"add the rows of the loading before it, {both}, or delete the test")


def _error(test: Test, seen: str, remedy: str) -> InputError:
    what = f"test {test.name} of pad {test.pad} holds no loading ramp: {seen}"
    return InputError(what, remedy=remedy)


def _force_rises(test: Test, fall: Phase) -> bool:
    """Return whether the force rises while the displacement falls."""
    inside = (test.time >= fall.start) & (test.time <= fall.stop)
    displacement, force = test.displacement[inside], test.force[inside]
    return bool((displacement - np.mean(displacement)) @ force < 0.0)
