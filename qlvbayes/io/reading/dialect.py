"""Find separator, decimal mark and header line of a measurement file."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.reading.csvtext import head
from qlvbayes.io.reading.header import Columns, read_columns

_SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}
_SEPARATOR_LINE = re.compile(r'"?sep=([,;\t])"?', re.IGNORECASE)
_FRACTION = re.compile(r"[+-]?\d*([.,])\d+([eE][+-]?\d+)?")
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


@dataclass(frozen=True)
class Dialect:
    """Form of the rows of a file: columns, separator, decimal mark, and the header's line."""

    columns: Columns
    separator: str
    decimal: str
    header_line: int

    @property
    def notice(self) -> str | None:
        """Return a notice where the file does not have comma and decimal point; None otherwise."""
        if self.separator == "," and self.decimal == ".":
            return None
        mark = "decimal point" if self.decimal == "." else "decimal comma"
        return f"read as {_SEPARATORS[self.separator]}-separated values with {mark}"


def sniff(path: Path) -> Dialect:
    """Read the header and find out how the rows are written."""
    lines = head(path).decode("utf-8").split("\n")
    written = [(n, text) for n, text in enumerate(lines, 1) if text.strip() and text[0] != "#"]
    if not written:
        raise InputError(
            "there are only comments", file=path, remedy="export the measurements again"
        )
    stated = _SEPARATOR_LINE.fullmatch(written[0][1].strip())  # Excel's own line
    if stated and len(written) > 1:
        written = written[1:]
    line, text = written[0]
    separator = stated[1] if stated else max(_SEPARATORS, key=text.count)
    columns = read_columns(split_row(text, separator), path, line)
    if len(written) == 1:
        remedy = "export the measurements again"
        raise InputError("there are no rows below the header", file=path, line=line, remedy=remedy)
    rows = (split_row(row, separator) for _, row in written[1:])
    return Dialect(columns, separator, _decimal(rows, columns, separator), line)


def split_row(text: str, separator: str) -> list[str]:
    """Return the cells of one line, without quotation marks and surrounding blanks."""
    try:
        cells = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # an overlong field
        return [text]
    return [cell.strip() for cell in cells]


def _decimal(rows: Iterable[list[str]], columns: Columns, separator: str) -> str:
    """Return the decimal mark of the first number that has one."""
    indices = [column.index for column in columns.numeric.values()]
    for row in rows:
        for cell in (row[index] for index in indices if index < len(row)):
            # "1,234" in a comma-separated file may well be a thousand
            if separator == "," and _GROUPED.fullmatch(cell):
                continue
            if match := _FRACTION.fullmatch(cell):
                return match[1]
    return "."
