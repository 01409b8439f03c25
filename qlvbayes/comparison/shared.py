"""Which constants two pads share, so that they can be compared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.comparison.readings import Reading
from qlvbayes.comparison.side import Side
from qlvbayes.laws.catalogue import find_elastic


def shared_constants(sides: Sequence[Side]) -> list[Reading]:
    """Constants that mean the same in all models and vary in one of them at least.

    Those of an elastic law need the same law, those of a relaxation the same one (of as many
    modes), an effect's that all models have it. Noise and the rig's effects are not the pad's.
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
    if "." in name:
        return (name,)
    first = sides[0].choices
    of_elastic = stem in find_elastic(first.law, first.laws).units
    described = {s.choices.law if of_elastic else s.choices.relaxing for s in sides}
    return (name,) if len(described) == 1 else ()


def fixed_constants(sides: Sequence[Side]) -> list[str]:
    """Constants that were fixed in all models."""
    first = sides[0]
    return [
        name
        for name in first.kinds
        if all(name in s.kinds and np.ptp(s.constants[name]) == 0.0 for s in sides)
    ]
