"""Define laws of the material, one class a file: elastic laws and relaxation laws."""

from typing import Any

from qlvbayes.laws.catalogue import LAWS, Laws
from qlvbayes.laws.conformance import check_law, law_checks
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation

_KINDS = {kind.__name__: kind for kind in (*LAWS.elastic, *LAWS.relaxation)}
globals().update(_KINDS)

__all__ = [
    "LAWS",
    "AbstractElastic",
    "AbstractRelaxation",
    "Laws",
    "check_law",
    "law_checks",
    *_KINDS,
]


def __getattr__(name: str) -> Any:
    """Raise AttributeError; the laws' own names are there, from the catalogue."""
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
