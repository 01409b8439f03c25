"""Read files as testing machines write them, one format a file, and convert them to tidy data."""

from qlvbayes.io.formats.catalogue import FORMATS
from qlvbayes.io.formats.conformance import check_format, format_checks
from qlvbayes.io.formats.format import AbstractFormat
from qlvbayes.io.formats.layouts import Layout

__all__ = [
    "FORMATS",
    "AbstractFormat",
    "Layout",
    "check_format",
    "format_checks",
]
