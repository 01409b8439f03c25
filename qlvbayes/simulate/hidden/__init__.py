"""Pads with physical effects that no parameter of the quasi-linear law describes.

The effects change the depth on its way in and the force on its way out, from the material through
pad, contact and frame to the sensor; see `HiddenPad`.
"""

from .catalogue import HIDDEN, effect_class
from .draw import draw_effect, draw_effect_in, parse_effect
from .effect import Effect
from .pad import HiddenPad

_KINDS = {kind.__name__: kind for kind in HIDDEN.values()}

__all__ = [
    "HIDDEN",
    "Effect",
    "HiddenPad",
    "draw_effect",
    "draw_effect_in",
    "effect_class",
    "parse_effect",
    *_KINDS,
]


def __getattr__(name: str) -> type[Effect]:
    """Return a hidden effect's class by its name, which stands in the catalogue alone."""
    if name in _KINDS:
        return _KINDS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
