"""The steps of a study with the files that each leaves, and all of them in one go.

Nothing here is imported before it is used: a first look needs no sampler.
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
    """Import what is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
