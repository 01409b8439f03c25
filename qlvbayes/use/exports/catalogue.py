"""List every target, in the order in which they are shown."""

from __future__ import annotations

from qlvbayes.io import catalogue
from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.target import AbstractTarget

TARGETS: tuple[type[AbstractTarget], ...] = tuple(catalogue.loaded(catalogue.TARGETS).values())
"""Every target."""


def find(name: str) -> type[AbstractTarget]:
    """Return the target of that name, or raise InputError, which lists the known ones."""
    for target in TARGETS:
        if target.name == name:
            return target
    known = ", ".join(catalogue.TARGETS)
    raise InputError(f"no export to {name!r}", remedy=f"use one of {known}")
