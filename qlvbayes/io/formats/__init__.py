"""Read files as testing machines write them, one format a file, and convert them to tidy data."""

from qlvbayes.io.formats.catalogue import FORMATS
from qlvbayes.io.formats.conformance import check_format, format_checks
from qlvbayes.io.formats.format import AbstractFormat

__all__ = [
    "FORMATS",
    "AbstractFormat",
    "check_format",
    "format_checks",
]
