"""Find effects, laws and formats that installed packages add, by entry points.

A package that states, in its ``pyproject.toml``,

.. code-block:: toml

    [project.entry-points."qlvbayes.effects"]
    quadratic_drag = "our_lab_effects:QuadraticDrag"

adds an effect; the groups ``qlvbayes.laws`` and ``qlvbayes.formats`` add laws and formats
(https://packaging.python.org/specifications/entry-points). What is found is checked by the rules
for such a class, once for each version of the package, and refused by its name where it breaks one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from qlvbayes.io.checks import InputError
from qlvbayes.io.files import write_whole
from qlvbayes.io.runtime import cache_folder

EFFECTS, LAWS, FORMATS = (f"qlvbayes.{name}" for name in ("effects", "laws", "formats"))
_CHECKED = "checked.json"  # which versions of which entry points passed the rules


@cache
def points(group: str) -> tuple[EntryPoint, ...]:
    """Return the entry points of a group, in the order of their names."""
    return tuple(sorted(entry_points(group=group), key=lambda point: point.name))


def installed(
    group: str, word: str, known: Collection[str], check: Callable[[Any], None]
) -> tuple[Any, ...]:
    """Return what installed packages add to a group.

    Parameters
    ----------
    group, word
        The group of entry points, and what its members are called.
    known, check
        Names that are taken; raises an error whose text says which rule is broken.

    Raises
    ------
    InputError
        Where an entry point cannot be loaded, has a name that is taken, or breaks a rule.
    """
    found, taken = [], set(known)
    for point in points(group):
        kind = _loaded(point, word)
        name = getattr(kind, "name", point.name)
        if name in taken:
            raise _refused(point, word, f"the name {name} is taken")
        taken.add(name)
        if _key(point) not in _passed():
            try:
                check(kind)
            except Exception as error:  # whatever another's code raises
                raise _refused(point, word, str(error) or type(error).__name__) from error
            _remember(point)
        found.append(kind)
    return tuple(found)


def _loaded(point: EntryPoint, word: str) -> Any:
    try:
        return point.load()
    except Exception as error:  # whatever another's code raises
        raise _refused(point, word, f"{type(error).__name__}: {error}") from error


def _refused(point: EntryPoint, word: str, why: str) -> InputError:
    """Return the error that names an entry point and its package."""
    package = point.dist.name if point.dist else point.module
    return InputError(
        f"the {word} {point.name} of the installed package {package} cannot be used: "
        f"{' '.join(why.split())}",
        remedy=f"install a version that keeps the rules, or pip uninstall {package}",
    )


def _key(point: EntryPoint) -> str:
    version = point.dist.version if point.dist else ""
    return f"{point.group} {point.value} {version}"


def _passed() -> list[str]:
    """Return the keys of what passed the rules before."""
    try:
        known = json.loads((cache_folder().parent / _CHECKED).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    return known if isinstance(known, list) else []


def _remember(point: EntryPoint) -> None:
    """Keep that an entry point passed; a folder that cannot be written to costs another check."""
    path = cache_folder().parent / _CHECKED
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps([*_passed(), _key(point)]).encode())
    except OSError:
        return
