"""Laws from a Python file of the user's own."""

from __future__ import annotations

import inspect
from pathlib import Path

from qlvbayes.checks import InputError
from qlvbayes.laws.catalogue import LAWS, Laws, names
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.usermodule import own_classes


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
    for kinds, known in ((elastic, LAWS.elastic), (relaxation, LAWS.relaxation)):
        taken = dict.fromkeys(names(known), "comes with the package")
        for kind in kinds:
            _check(kind, taken, path)
            taken[kind.name] = "stands in this file already"
    return Laws(elastic, relaxation)


def _check(
    kind: type[AbstractElastic] | type[AbstractRelaxation], taken: dict[str, str], path: Path
) -> None:
    line = inspect.getsourcelines(kind)[1]
    base = AbstractElastic if issubclass(kind, AbstractElastic) else AbstractRelaxation
    lacking = sorted(kind.__abstractmethods__) if inspect.isabstract(kind) else []
    lacking += [word for word in base.__annotations__ if not hasattr(kind, word)]
    if lacking:
        raise InputError(
            f"the law {kind.__name__} lacks {', '.join(lacking)}",
            file=path,
            line=line,
            remedy="define them in the class",
        )
    if kind.name in taken:
        raise InputError(
            f"a law called {kind.name} {taken[kind.name]}",
            file=path,
            line=line,
            remedy="choose another name",
        )
