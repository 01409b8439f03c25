"""Which constants two pads share, so that they can be compared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.compare.readings import Reading
from qlvbayes.compare.side import Side


def shared_constants(sides: Sequence[Side]) -> list[Reading]:
    """Constants that mean the same in all models and vary in one of them at least.

    Those of an elastic law need the same law, c and v the same number of modes, an effect's that
    all models have it. Noise and the rig's effects are not the pad's.
    """
    first = sides[0]
    found = []
    for name, kind in first.kinds.items():
        everywhere = all(name in side.kinds for side in sides)
        if not everywhere or name not in _comparable(sides, name):
            continue
        if all(np.ptp(side.constants[name]) == 0.0 for side in sides):
            continue
        unit = first.units.of(kind)
        group = "effects" if "." in name else "constants"
        found.append(Reading(name, unit, group, False))
    return found


def _comparable(sides: Sequence[Side], name: str) -> tuple[str, ...]:
    """The name where it means the same in all models."""
    stem = name.split("[")[0]
    laws = {side.choices.law for side in sides}
    modes = {side.choices.modes for side in sides}
    if "." in name:
        return (name,)
    same = len(modes) == 1 if stem in ("c", "v") else len(laws) == 1
    return (name,) if same else ()


def fixed_constants(sides: Sequence[Side]) -> list[str]:
    """Constants that were fixed in all models."""
    first = sides[0]
    return [
        name
        for name in first.kinds
        if all(name in s.kinds and np.ptp(s.constants[name]) == 0.0 for s in sides)
    ]
