"""Hidden effects from the words of a command line."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from qlvbayes.io.checks import InputError

from ..constants import Constants
from ..platen import Platen
from .catalogue import effect_class
from .draw import Protocol, draw_effect
from .effect import Effect
from .pad import HiddenPad

_SIZE = 0.06  # share of the peak force that an effect has unless the user says more: well seen


def parse_effect(
    text: str, constants: Constants, protocol: Protocol, top_speed: float, rng: np.random.Generator
) -> Effect:
    """Effect from 'name:parameter=value,...', or drawn at 6 % of the peak force from 'name'."""
    name, colon, words = (part.strip() for part in text.partition(":"))
    cls = effect_class(name)
    if colon:
        return _given(cls, words)
    platen = Platen(protocol(top_speed))
    peak = float(HiddenPad(constants).force(platen, platen.kinks).max())
    depth = float(platen.displacement(platen.kinks).max())
    return draw_effect(name, rng, peak, depth, top_speed, _SIZE, constants, protocol)


def _given(cls: type[Effect], words: str) -> Effect:
    kinds = {field.name: int if field.type == "int" else float for field in fields(cls)}
    wanted = f"write {cls.name}:{','.join(f'{key}=...' for key in kinds)}"
    values: dict[str, float] = {}
    for word in words.split(","):
        key, _, number = (part.strip() for part in word.partition("="))
        if key not in kinds or key in values:
            raise InputError(f"'{word.strip()}' is no parameter of {cls.name}", remedy=wanted)
        try:
            values[key] = kinds[key](number)
        except ValueError:
            raise InputError(f"'{number}' is not a number for {key}", remedy=wanted) from None
    if len(values) < len(kinds):
        missing = ", ".join(key for key in kinds if key not in values)
        raise InputError(f"{cls.name} lacks {missing}", remedy=wanted)
    return cls(**values)
