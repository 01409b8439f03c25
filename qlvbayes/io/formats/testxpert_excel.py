"""Read ZwickRoell testXpert as an Excel workbook by openpyxl: a sheet for each specimen."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import (
    NamedColumn,
    chosen,
    columns_of,
    measured,
    on_clock,
    recording,
    sheared_instead,
    side_by_side,
    that_moved,
    titles_of,
)
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.namedarrays import damaged, needed
from qlvbayes.io.formats.naming import is_mean
from qlvbayes.io.formats.testxpert import names_row
from qlvbayes.io.formats.textcells import decimal_mark, is_like_number, plain_number, with_point
from qlvbayes.io.formats.textrows import NumericRows, read_rows
from qlvbayes.io.formats.texttable import in_cells, in_two_rows

_HEADER_ROWS = 60  # rows of a sheet among which the names are
_LEAST = 10  # rows that a curve has at least; a smaller sheet holds results


class TestXpertExcel(AbstractFormat):
    """Workbook of testXpert: localised names in one row, units in the next.

    The sheet of the mean specimen is no test.
    """

    __test__: ClassVar[bool] = False  # pytest must not collect it
    name: ClassVar[str] = "testxpert-excel"
    machine: ClassVar[str] = "ZwickRoell testXpert, or another Excel workbook (needs openpyxl)"
    marks: ClassVar[str] = "an Excel workbook (.xlsx); a sheet with time, displacement and force"
    reads: ClassVar[str] = "every specimen's sheet (a test each), without the mean specimen's"
    reference: ClassVar[str] = "testXpert, export to Excel; ECMA-376"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for a zip that holds a workbook."""
        return Sight.from_marks(
            {
                "a zip archive": head.startswith(b"PK\x03\x04"),
                "an Excel workbook in it": b"[Content_Types].xml" in head or b"xl/work" in head,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return one test for each sheet."""
        openpyxl = needed("openpyxl", "openpyxl", path)
        try:
            book = openpyxl.load_workbook(path, read_only=True, data_only=True)
            sheets = {sheet.title: list(sheet.iter_rows(values_only=True)) for sheet in book}
            book.close()
        except Exception as error:  # a cut zip ends in any error of its reader
            raise damaged(path, error) from error
        tests: list[Recording] = []
        means: dict[str, int] = {}
        for title, rows in sheets.items():
            above = [_texts(row) for row in rows[:_HEADER_ROWS]]
            header = _names(above)
            if header < 0 or len(rows) - header < _LEAST:
                continue
            if is_mean(title) or any(map(_is_mean_title, above[:header])):
                means[title] = len(rows) - header - 1
                continue
            tests += _tests(title, rows, header, path)
        if not tests:
            raise InputError(
                f"no sheet has time, displacement and force ({', '.join(sheets)[:80]})",
                file=path,
                remedy="export the curves of every sample, or save the sheet as CSV",
            )
        if means:
            lost = {f"rows of the mean specimen's sheet '{title}'": n for title, n in means.items()}
            dropped = {**tests[0].dropped, **lost}
            tests[0] = replace(tests[0], dropped=dropped)
        return tuple(tests)


def _names(rows: list[list[str]]) -> int:
    """Return the row that names columns, in testXpert's words or all three; -1 if none does."""
    own = names_row(rows)
    whole = (k for k, row in enumerate(rows) if all(measured(in_cells(row)).values()))
    return own if own >= 0 else next(whole, -1)


def _is_mean_title(row: list[str]) -> bool:
    """Return whether a row has nothing but one name, that of the mean specimen."""
    filled = {cell for cell in row if cell}
    return len(filled) == 1 and is_mean(filled.pop())


def _texts(row: Any) -> list[str]:
    return ["" if cell is None else str(cell) for cell in row]


def _tests(title: str, rows: list[Any], header: int, path: Path) -> list[Recording]:
    """Return the tests of a sheet, mostly one; several stand side by side."""
    names, below = _texts(rows[header]), _texts(rows[header + 1])
    one_row = in_cells(names)
    has_units = all(named and named.unit for named in measured(one_row).values())
    columns = one_row if has_units else in_two_rows(names, below)
    tests = side_by_side(columns, chosen(columns, path, header + 1))
    titles = titles_of(tests, _texts(rows[header - 1]) if header else [])
    first = header + 1 + int(columns is not one_row)
    return [
        _test(columns_of(columns, picked), picked, rows, first, path, f"{title} {own}".strip())
        for picked, own in zip(tests, titles, strict=True)
    ]


def _test(
    columns: list[NamedColumn],
    picked: dict[str, NamedColumn],
    rows: list[Any],
    first: int,
    path: Path,
    name: str,
) -> Recording:
    """Return the test of the picked columns; of a rheometer's two motions the larger."""
    used = [
        [row[n.index] if n.index < len(row) else None for n in picked.values()]
        for row in rows[first:]
    ]
    read = _numbers(used, path, first + 1)
    own = on_clock(picked, read.clocks, path)
    recorded = recording(columns, own, read.columns, read.dropped, name)
    if (other := sheared_instead(columns, picked)) is None:
        return recorded
    return that_moved(recorded, _test(columns, other, rows, first, path, name), path)


def _numbers(rows: list[list[Any]], path: Path, line: int) -> NumericRows:
    """Return the columns of rows of cells, and counts of dropped rows; text may be a number."""
    if all(isinstance(cell, (int, float)) for row in rows for cell in row):
        return NumericRows(tuple(np.array(rows, dtype=float).T), {})
    texts = [plain_number(cell) for row in rows for cell in row if isinstance(cell, str)]
    decimal = decimal_mark((text for text in texts if is_like_number(text)), path)
    lines = ["\t".join(_written(cell, decimal) for cell in row) for row in rows]
    return read_rows("\n".join([*lines, ""]).encode(), "\t", range(len(rows[0])), path, line)


def _written(cell: Any, decimal: str) -> str:
    """Return a cell as text, its number with a decimal point and a duration as hh:mm:ss."""
    if isinstance(cell, str):
        plain = plain_number(" ".join(cell.split()))
        return with_point(plain, decimal) if is_like_number(plain) else plain
    if isinstance(cell, timedelta):
        minutes, seconds = divmod(cell.total_seconds(), 60.0)
        return f"{int(minutes) // 60}:{int(minutes) % 60:02}:{seconds:09.6f}"
    return "" if cell is None else str(cell)
