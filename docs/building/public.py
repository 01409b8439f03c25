"""List the names that the package offers, with the page of the API on which each stands."""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass
from importlib import import_module
from typing import Any

# Which parts of the package stand on which page of the API; what is in none, on the last one.
SECTIONS = {
    "measurements": ("io", "motion"),
    "model": ("model", "laws", "priors"),
    "fitting": ("fitting", "inference"),
    "diagnosis": ("diagnosis", "app"),
    "prediction": ("use",),
    "effects": ("effects",),
    "comparison": ("comparison",),
    "study": ("pipeline", "report"),
    "other": (),
}
LAST = "other"
# parts of the package that offer names of their own, in addition to the figures
PARTS = (
    "effects",
    "io.formats",
    "laws",
    "model.noise",
    "priors",
    "use.exports",
)


@dataclass(frozen=True)
class Public:
    """A public name: where it is defined, its section, its docstring's first line."""

    name: str
    path: str
    section: str
    summary: str
    directive: str


def public_names() -> list[Public]:
    """Return everything that ``qlvbayes`` and its parts offer by name, in alphabetical order."""
    found: dict[str, Any] = {}
    for module in (import_module("qlvbayes"), *(import_module(f"qlvbayes.{p}") for p in PARTS)):
        found |= {name: getattr(module, name) for name in module.__all__}
    return [
        _public(name, value) for name, value in sorted(found.items()) if not inspect.ismodule(value)
    ]


def _public(name: str, value: Any) -> Public:
    path = _path(name, value)
    part = path.split(".")[1]
    page = next((key for key, parts in SECTIONS.items() if part in parts), LAST)
    kind = "class" if inspect.isclass(value) else "function" if callable(value) else "data"
    return Public(name, path, page, _summary(path, value), f"auto{kind}")


def _path(name: str, value: Any) -> str:
    """Return the full name of a value; constants carry no note of where they are defined."""
    if hasattr(value, "__qualname__"):
        return f"{value.__module__}.{value.__qualname__}"
    ours = [m for m in list(sys.modules) if m.startswith("qlvbayes.") and name in _own(m)]
    homes = [m for m in ours if getattr(sys.modules[m], name) is value]
    return f"{homes[0]}.{name}" if homes else f"qlvbayes.{name}"


def _own(module: str) -> dict[str, Any]:
    """Return the annotated names of a module: constants that it defines itself."""
    return getattr(sys.modules[module], "__annotations__", {})


def _summary(path: str, value: Any) -> str:
    """Return the first line of a docstring; for a constant, that of the string beneath it."""
    if hasattr(value, "__qualname__"):
        return (inspect.getdoc(value) or "").partition("\n")[0]
    from sphinx.pycode import ModuleAnalyzer

    module, _, name = path.rpartition(".")
    return " ".join(ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name), [""])[:1])


def section(name: str) -> list[Public]:
    """Return the public names of one page of the API."""
    return [public for public in public_names() if public.section == name]


def figures() -> list[Public]:
    """Return everything that ``qlvbayes.plots`` offers by name."""
    from qlvbayes import plots

    return [_public(name, getattr(plots, name)) for name in sorted(plots.__all__)]
