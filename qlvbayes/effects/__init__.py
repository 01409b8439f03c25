"""Define physical effects that a model may lack, those of one kind in one file.

The folder offers a class for each effect, lists of them, and what a user's own effect is made of
and checked by.
"""

# first, so that a file of one's own, moved into this folder, finds it before the catalogue is read
from qlvbayes.effects.effect import AbstractEffect, Level

# isort: split
from qlvbayes.effects.catalogue import EFFECTS, EVERY, FORMS, OUTSIDE
from qlvbayes.effects.conformance import check_effect, effect_checks

_KINDS = {kind.__name__: kind for kind in EVERY}

__all__ = [
    "EFFECTS",
    "EVERY",
    "FORMS",
    "OUTSIDE",
    "AbstractEffect",
    "Level",
    "check_effect",
    "effect_checks",
    *_KINDS,
]


def __getattr__(name: str) -> type[AbstractEffect]:
    """Return an effect's class by its name, which stands in the catalogue alone."""
    if name in _KINDS:
        return _KINDS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
