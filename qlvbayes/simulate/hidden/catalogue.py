"""The hidden effects by name."""

from __future__ import annotations

from qlvbayes.io.checks import check_known

from . import contact_effects, pad_effects, sensor_effects
from .effect import Effect


def by_name(*classes: type[Effect]) -> dict[str, type[Effect]]:
    """Return some effects' classes by their names."""
    return {effect.name: effect for effect in classes}


_CLASSES = [
    kind
    for module in (pad_effects, contact_effects, sensor_effects)
    for kind in vars(module).values()
    if isinstance(kind, type) and issubclass(kind, Effect) and kind is not Effect
]
HIDDEN = by_name(*sorted(_CLASSES, key=lambda kind: kind.order))
"""The listed effects, from the material to the sensor."""


def effect_class(name: str) -> type[Effect]:
    """Return the class of the effect with this name."""
    check_known("effect", name, HIDDEN)
    return HIDDEN[name]
