"""List the names that the package offers, with the page of the API on which each stands."""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass
from importlib import import_module
from typing import Any

# The pages of the API: title, what it is, and which parts of the package stand there; what is in
# none stands on the last one.
SECTIONS = {
    "measurements": (
        "Measurements",
        "From a CSV file to tests whose motion, phases, rates and noise floor are known.",
        ("io", "motion"),
    ),
    "model": (
        "Model",
        "The elastic law, the relaxation, the motion, the noise, and priors in place of numbers.",
        ("model", "laws", "priors"),
    ),
    "fitting": (
        "Fitting and checking",
        "From tests to draws of the constants, and what these predict.",
        ("fitting", "inference"),
    ),
    "diagnosis": ("Diagnosis", "Which physical effect is missing.", ("diagnosis", "app")),
    "effects": (
        "Effects as classes",
        "What an effect is made of, and how your own is checked. :doc:`The list </effects>` shows "
        "those that come with the package.",
        ("effects",),
    ),
    "comparison": ("Comparison", "Pad against pad, fluid against fluid.", ("comparison",)),
    "prediction": (
        "Prediction and control",
        "The constants put to use: step by step, the displacement of a prescribed force, whole "
        "programs.",
        ("use",),
    ),
    "study": (
        "Study and report",
        "All steps in one go, and the page that tells the story.",
        ("pipeline", "report"),
    ),
    "other": ("Other names", "What stands on no other page.", ()),
}
FIGURES = (
    "Figures",
    "One function a figure, in ``qlvbayes.plots``, returning its axes. They belong to nobody's "
    "window: ``save_figure`` writes them, ``figure_of`` gives the figure that a notebook shows.",
)
OVERVIEW = """\
Overview
========

``import qlvbayes as q`` gives every name below. Importing it switches JAX to float64.

.. list-table::
   :widths: 25 75
"""
LAST = "other"
# parts of the package that offer names of their own, in addition to the figures
PARTS = (
    "effects",
    "evaluation.recovery",
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
    page = next((key for key, (*_, parts) in SECTIONS.items() if part in parts), LAST)
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


def api_pages() -> dict[str, str]:
    """Return the pages of the API by name, which Sphinx fills with docstrings."""
    names = public_names()
    rows = [f"   * - :py:obj:`{one.name} <{one.path}>`\n     - {one.summary}" for one in names]
    pages = {"index": "\n".join((OVERVIEW, *rows))}
    for key, (title, words, _) in SECTIONS.items():
        pages[key] = _page(title, words, [one for one in names if one.section == key])
    return {**pages, "plots": _page(*FIGURES, figures())}


def _page(title: str, words: str, names: list[Public]) -> str:
    parts = [f"{title}\n{'=' * len(title)}", words]
    for one in names:
        members = "\n   :members:" if one.directive == "autoclass" else ""
        parts.append(f".. {one.directive}:: {one.path}{members}")
    return "\n\n".join(parts) + "\n"


def figures() -> list[Public]:
    """Return everything that ``qlvbayes.plots`` offers by name."""
    from qlvbayes import plots

    return [_public(name, getattr(plots, name)) for name in sorted(plots.__all__)]
