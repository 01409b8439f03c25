"""Pads with physical effects that no parameter of the quasi-linear law describes.

The effects change the depth on its way in and the force on its way out, from the material through
pad, contact and frame to the sensor; see `HiddenPad`.
"""

from typing import Any

from .catalogue import FOREIGN, FORMS, FURTHER, HIDDEN, OUTSIDE, effect_class
from .contact_effects import NearContact
from .draw import draw_effect, draw_effect_in
from .effect import Effect
from .pad import HiddenPad
from .parse import parse_effect

_KINDS = {kind.__name__: kind for kinds in (HIDDEN, FORMS, OUTSIDE) for kind in kinds.values()}
globals().update(_KINDS)

__all__ = [
    "FOREIGN",
    "FORMS",
    "FURTHER",
    "HIDDEN",
    "OUTSIDE",
    "Effect",
    "HiddenPad",
    "NearContact",
    "draw_effect",
    "draw_effect_in",
    "effect_class",
    "parse_effect",
    *_KINDS,
]


def __getattr__(name: str) -> Any:
    """Raise AttributeError; the effects' own names are there, from the catalogue."""
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
