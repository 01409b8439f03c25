"""Laws from a Python file of the user's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qlvbayes.io.checks import InputError
from qlvbayes.io.usermodule import check_own, own_classes
from qlvbayes.laws.catalogue import LAWS, Laws, names
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation


def load(path: str | Path) -> Laws:
    """The laws that a Python file defines, in its order; those it imports do not count.

    Raises
    ------
    InputError
        The file is missing, stops with an error, defines no law, one that lacks a part, or a name
        that another law has.
    """
    path = Path(path)
    elastic = own_classes(path, AbstractElastic, "laws")  # type: ignore[type-abstract]
    relaxation = own_classes(path, AbstractRelaxation, "laws")  # type: ignore[type-abstract]
    if not elastic and not relaxation:
        raise InputError(
            "defines no law",
            file=path,
            remedy="write a class that extends AbstractElastic or AbstractRelaxation",
        )
    _check(elastic, AbstractElastic, names(LAWS.elastic), path)
    _check(relaxation, AbstractRelaxation, names(LAWS.relaxation), path)
    return Laws(elastic, relaxation)


def _check(kinds: Sequence[type[Any]], base: type[Any], known: Sequence[str], path: Path) -> None:
    taken = {name: f"a law called {name} comes with the package" for name in known}
    for kind in kinds:
        check_own(path, kind, base, "law", taken)
        taken[kind.name] = f"a law called {kind.name} stands in this file already"
