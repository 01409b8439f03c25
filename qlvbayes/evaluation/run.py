"""Run what is not kept yet."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from qlvbayes.evaluation.keeping import Kept, code_digest
from qlvbayes.evaluation.rate import Case

Tell = Callable[[int, int], None]


def kept_file(folder: Path, key: str) -> Path:
    """Where the studies of a plan or population, and of this code, are kept."""
    return folder / f"{key}-{code_digest()}.jsonl"


def run_missing(
    study: Callable[[int], Case],
    kept: Kept,
    indices: Iterable[int],
    tell: Tell = lambda done, total: None,
) -> None:
    """Run the studies at some places, one after the other; ``tell`` hears how many are done.

    Each keeps the digest of the code that it was run by.
    """
    digest = code_digest()
    missing = [index for index in indices if index not in kept.cases]
    tell(0, len(missing))
    for done, index in enumerate(missing, start=1):
        kept.add(study(index) | {"code": digest})
        tell(done, len(missing))
