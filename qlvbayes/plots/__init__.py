"""Draw figures for papers: one function a figure, which returns its axes and opens no window.

Every function takes ``width`` in mm (85 for one column of a journal, 180 for two). ``save_figure``
writes PNG and PDF, ``figure_of`` returns the figure to show in a notebook, and ``using`` sets a
user's own look. Nothing here is imported before it is used, nor is Matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from qlvbayes.plots.catalogue import FIGURES

_MODULES = {f"plot_{one.name}": one.file or one.name for one in FIGURES} | {
    "figure_of": "files",
    "save_figure": "files",
    "using": "style",
}

__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    """Import the name that is asked for; a figure's module is in the catalogue."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
