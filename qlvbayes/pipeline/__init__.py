"""Run the steps of a study, one or all, and save the files of each.

Modules are imported when they are used: a first look needs no sampler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from qlvbayes.pipeline.run import run_study
    from qlvbayes.pipeline.watcher import Watcher

__all__ = ["Watcher", "run_study"]

_HOMES = {"Watcher": "watcher", "run_study": "run"}


def __getattr__(name: str) -> Any:
    """Import a public name when it is used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
