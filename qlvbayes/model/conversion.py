"""Draws of a model's constants in another system of units."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.units import UnitSystem
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import described_fields

_POWERS = {"power_stiffness": "displacement", "power_drag": "speed"}


def factors(
    choices: Choices, draws: Mapping[str, np.ndarray], given: UnitSystem, wanted: UnitSystem
) -> dict[str, np.ndarray | float]:
    """What the draws (n,) of each constant are multiplied by to be in the wanted units.

    A power law, F = m x^n, makes it draw by draw: [F]/[x]^n goes with the draw's exponent n. An
    effect's n is called ``effect.n``. Raises InputError where one system has strain and stress and
    the other has displacement and force.
    """
    if given.dimensionless != wanted.dimensionless:
        raise InputError(
            "strain and stress cannot be converted to displacement and force",
            remedy="compare force with force, or stress with stress",
        )
    kinds = {name: field.unit for field in described_fields(choices) for name in field.names}
    found: dict[str, np.ndarray | float] = {}
    for name in draws:
        if (base := _POWERS.get(kinds[name])) is None:
            found[name] = given.factor_to(wanted, kinds[name])
            continue
        stem, dot, _ = name.rpartition(".")
        exponent = draws[f"{stem}{dot}n"]
        found[name] = given.factor_to(wanted, "force") / given.factor_to(wanted, base) ** exponent
    return found
