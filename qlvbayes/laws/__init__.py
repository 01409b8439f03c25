"""Define laws of the material, elastic laws and relaxation laws, those of one kind in one file."""

from qlvbayes.laws.catalogue import LAWS, Laws
from qlvbayes.laws.conformance import check_law, law_checks
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation

_KINDS = {kind.__name__: kind for kinds in (LAWS.elastic, LAWS.relaxation) for kind in kinds}

__all__ = [
    "LAWS",
    "AbstractElastic",
    "AbstractRelaxation",
    "Laws",
    "check_law",
    "law_checks",
    *_KINDS,
]


def __getattr__(name: str) -> type[AbstractElastic] | type[AbstractRelaxation]:
    """Return a law's class by its name, which stands in the catalogue alone."""
    if name in _KINDS:
        return _KINDS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
