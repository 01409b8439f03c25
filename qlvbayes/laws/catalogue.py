"""Load the laws that `io.catalogue` lists, and read a user's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from qlvbayes.io.catalogue import (
    ELASTIC,
    LAW_POINTS,
    RELAXATION,
    at,
    check_own,
    installed,
    loaded,
    own_classes,
)
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation


@dataclass(frozen=True)
class Laws:
    """Classes of elastic laws and of relaxation laws that can be chosen."""

    elastic: tuple[type[AbstractElastic], ...]
    relaxation: tuple[type[AbstractRelaxation], ...]


LAWS: Laws = Laws(tuple(loaded(ELASTIC).values()), tuple(loaded(RELAXATION).values()))
"""Every law that comes with the package."""

_CHECK = "laws.conformance.check_law"
Kind = TypeVar("Kind", bound=type[AbstractElastic] | type[AbstractRelaxation])


def names(kinds: Sequence[type[AbstractElastic] | type[AbstractRelaxation]]) -> tuple[str, ...]:
    """Return the laws' names, as on the command line."""
    return tuple(kind.name for kind in kinds)


def find_elastic(name: str, laws: Laws = LAWS) -> type[AbstractElastic]:
    """Return the elastic law of that name; an InputError lists the known ones otherwise."""
    return _find("elastic law", name, laws.elastic)


def find_relaxation(name: str, laws: Laws = LAWS) -> type[AbstractRelaxation]:
    """Return the relaxation law of that name; an InputError lists the known ones otherwise."""
    return _find("relaxation", name, laws.relaxation)


def _find(what: str, name: str, kinds: Sequence[Kind]) -> Kind:
    check_known(what, name, names(kinds))
    return next(kind for kind in kinds if kind.name == name)


def installed_laws() -> Laws:
    """Return the laws that installed packages add, by the entry points ``qlvbayes.laws``."""
    known = (*names(LAWS.elastic), *names(LAWS.relaxation))
    found = installed(LAW_POINTS, "law", known, lambda kind: at(_CHECK)(kind))
    elastic = tuple(kind for kind in found if issubclass(kind, AbstractElastic))
    return Laws(elastic, tuple(kind for kind in found if kind not in elastic))


def own_laws(path: str | Path) -> Laws:
    """Return the laws that a Python file defines, in its order; imported ones do not count."""
    path = Path(path)
    elastic = own_classes(path, AbstractElastic, "laws")  # type: ignore[type-abstract]
    relaxation = own_classes(path, AbstractRelaxation, "laws")  # type: ignore[type-abstract]
    if not elastic and not relaxation:
        remedy = "write a class that extends AbstractElastic or AbstractRelaxation"
        raise InputError("defines no law", file=path, remedy=remedy)
    check_own(path, elastic, AbstractElastic, "law", names(LAWS.elastic))
    check_own(path, relaxation, AbstractRelaxation, "law", names(LAWS.relaxation))
    return Laws(elastic, relaxation)
