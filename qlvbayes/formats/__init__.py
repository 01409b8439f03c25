"""Files as testing machines write them: one format a file, and what they say made tidy."""

from qlvbayes.formats.catalogue import FORMATS
from qlvbayes.formats.conformance import check_format
from qlvbayes.formats.format import AbstractFormat

__all__ = [
    "FORMATS",
    "AbstractFormat",
    "check_format",
]
