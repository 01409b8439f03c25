"""Finished studies of the validation: the code that they depend on is the package and this one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from qlvbayes.evaluation import store
from qlvbayes.evaluation.store import Case, Store
from qlvbayes.parallel.engines import Engine

__all__ = ["Store", "code_digest", "run_missing", "store_path"]

_READING = ("constants.py", "counting.py", "report.py", "store.py")  # only read finished studies


def code_digest() -> str:
    """Return the digest of all code that the result of a study may depend on."""
    return store.code_digest(store.PACKAGE, Path(__file__).parent, without=_READING)


def store_path(folder: Path, name: str) -> Path:
    """Return the file for the studies of this name that the present code runs."""
    return store.store_path(folder, name, code_digest())


def run_missing(
    study: Callable[[Any], Case],
    stored: Store,
    indices: Iterable[Any],
    report: Callable[[int, int], None] = lambda done, total: None,
    engine: Engine | None = None,
) -> None:
    """Run the studies that are not stored, and store each as soon as it is finished."""
    store.run_missing(study, stored, indices, report, engine, code=code_digest())
