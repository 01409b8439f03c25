"""Read the rows of a measurement file as typed columns, in bounded memory.

pandas' C reader reads a block of whole lines at a time. Numbers stay as float64. The text columns
(pad, test, role and the declared rate and start) change rarely, so only the rows at which any of
them changes are kept.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.reading.badline import first_fault, parse_number
from qlvbayes.io.reading.csvtext import blocks
from qlvbayes.io.reading.dialect import Dialect, split_row

Integers = NDArray[np.int64]
_NEWLINE, _QUOTE = b'\n"'


class GrowingColumn:
    """Column of float64 values that grows in blocks, with no more memory than the values take.

    A list of blocks joined at the end would need the memory twice, as the allocator keeps the freed
    blocks. A large array is enlarged in place, by an eighth only, as numpy fills the spare room
    with zeros.
    """

    def __init__(self) -> None:
        self._values = np.empty(1024)
        self._size = 0

    def append(self, block: NDArray[np.float64]) -> None:
        """Append a copy of the block."""
        size = self._size + len(block)
        if size > len(self._values):
            self._values.resize(size + size // 8, refcheck=False)
        self._values[self._size : size] = block
        self._size = size

    def finish(self) -> NDArray[np.float64]:
        """Return the values and empty the column."""
        values, self._values = self._values, np.empty(1024)
        values.resize(self._size, refcheck=False)
        self._size = 0
        return values


@dataclass(frozen=True)
class Runs:
    """Stretches of rows that share all labels.

    `starts` (r + 1,) is the first row of each stretch and, last, the number of rows; `codes[label]`
    (r,) are indices into the texts `texts[label]`.
    """

    starts: Integers
    codes: dict[str, Integers]
    texts: dict[str, list[str]]


@dataclass(frozen=True)
class Table:
    """All rows of a file: `numeric[quantity]` (n,), the runs of labels, and the other lines.

    `skipped` are the numbers of the lines that are no rows.
    """

    numeric: dict[str, Floats]
    runs: Runs
    skipped: Integers

    def line(self, row: int) -> int:
        """Return the line of the file, from 1, that holds a row."""
        # skipped - arange counts the rows above each skipped line
        above = self.skipped - np.arange(len(self.skipped)) - 1
        return int(row + 1 + np.searchsorted(above, row, side="right"))


def read_table(path: Path, dialect: Dialect) -> Table:
    """Read all rows, in the file's order, converted to the units of `Columns`."""
    reader = _Reader(path, dialect)
    line = 1
    for block in blocks(path):
        reader.add(block, line)
        line += block.count(b"\n")
    return reader.table()


class _Reader:
    """Reader that collects the columns of a file block by block."""

    def __init__(self, path: Path, dialect: Dialect) -> None:
        self.path = path
        self.dialect = dialect
        columns = dialect.columns
        self.numeric = {key: GrowingColumn() for key in columns.numeric}
        self.texts: dict[str, dict[str, int]] = {key: {} for key in columns.labels}
        self.codes: dict[str, list[Integers]] = {key: [] for key in columns.labels}
        self.starts: list[Integers] = []
        self.skipped: list[Integers] = []
        self.rows = 0

    def add(self, block: bytes, line: int) -> None:
        """Append the rows of a block whose first line is `line`."""
        skip = _not_rows(block)
        skip[: max(0, self.dialect.header_line + 1 - line)] = True
        if skip.any():
            self.skipped.append(np.flatnonzero(skip) + line)
        if skip.all():
            return
        rows = _without(block, skip) if skip.any() else block
        frame = self._parse(rows) if self._well_formed(rows) else None
        if frame is None or len(frame) != np.count_nonzero(~skip) or not self._keep(frame):
            raise first_fault(block, line, self.dialect, self.path)

    def table(self) -> Table:
        """Return the table that the blocks make."""
        numeric = {key: column.finish() for key, column in self.numeric.items()}
        for key, column in self.dialect.columns.numeric.items():
            column.scale.convert(numeric[key])
        starts = np.concatenate(self.starts)
        codes = {key: np.concatenate(parts) for key, parts in self.codes.items()}
        # A run may have been cut by the end of a block.
        new = np.ones(len(starts), bool)
        new[1:] = _changes(codes.values(), len(starts))
        runs = Runs(
            np.append(starts[new], self.rows),
            {key: values[new] for key, values in codes.items()},
            {key: list(texts) for key, texts in self.texts.items()},
        )
        return Table(numeric, runs, np.concatenate(self.skipped))

    def _well_formed(self, rows: bytes) -> bool:
        """Return whether every line has as many fields as the header."""
        data = np.frombuffer(rows, np.uint8)
        starts, _ = _line_bounds(data)
        separators = data == ord(self.dialect.separator)
        if b'"' in rows:
            quotes = data == _QUOTE
            outside = np.cumsum(quotes, dtype=np.int32) % 2 == 0
            before = data[np.flatnonzero(quotes & ~outside) - 1]
            if not np.isin(before, (ord(self.dialect.separator), *b'\n "')).all():
                return False
            separators &= outside
        fields = np.add.reduceat(separators, starts, dtype=np.int32) + 1
        return bool((fields == self.dialect.columns.width).all())

    def _parse(self, rows: bytes) -> pd.DataFrame | None:
        """Read good rows fast; return None if any of them is not good."""
        columns = self.dialect.columns
        numeric = [column.index for column in columns.numeric.values()]
        labels = [column.index for column in columns.labels.values()]
        # pandas takes a column of nothing but True and False for ones and zeros.
        first = split_row(rows[: rows.index(b"\n")].decode("utf-8"), self.dialect.separator)
        if len(first) != columns.width:
            return None
        if any(parse_number(first[index], self.dialect.decimal) is None for index in numeric):
            return None
        dtypes: dict[int, type] = dict.fromkeys(numeric, float) | dict.fromkeys(labels, object)
        try:
            return pd.read_csv(
                io.BytesIO(rows),
                engine="c",
                header=None,
                names=list(range(columns.width)),
                index_col=False,
                usecols=numeric + labels,
                dtype=dtypes,
                sep=self.dialect.separator,
                decimal=self.dialect.decimal,
                skipinitialspace=True,
                na_filter=False,
                low_memory=False,
            )
        except ValueError:
            return None

    def _keep(self, frame: pd.DataFrame) -> bool:
        """Append the frame's columns; return False if a number is not finite."""
        columns = self.dialect.columns
        for key, column in columns.numeric.items():
            values = frame[column.index].to_numpy(dtype=np.float64)
            if not np.isfinite(values).all():
                return False
            self.numeric[key].append(values)
        codes = {key: self._codes(key, frame[col.index]) for key, col in columns.labels.items()}
        first = np.flatnonzero(np.append(True, _changes(codes.values(), len(frame))))
        self.starts.append(first + self.rows)
        for key, numbered in codes.items():
            self.codes[key].append(numbered[first])
        self.rows += len(frame)
        return True

    def _codes(self, key: str, texts: pd.Series) -> Integers:
        """Return the code of every text of a label, the same in all blocks."""
        codes, unique = pd.factorize(texts)
        known = self.texts[key]
        common = [known.setdefault(str(text).strip(), len(known)) for text in unique]
        return np.array(common, dtype=np.int64)[codes]


def _line_bounds(data: NDArray[np.uint8]) -> tuple[Integers, Integers]:
    """Return where each line starts, and where its line end is."""
    ends = np.flatnonzero(data == _NEWLINE)
    return np.append(0, ends[:-1] + 1), ends


def _not_rows(block: bytes) -> NDArray[np.bool_]:
    """Return which lines are blank or comments."""
    data = np.frombuffer(block, np.uint8)
    starts, ends = _line_bounds(data)
    skip = (data[starts] == ord("#")) | (starts == ends)
    for n in np.flatnonzero(np.isin(data[starts], tuple(b" \t"))):
        skip[n] = not block[starts[n] : ends[n]].strip()
    return skip


def _without(block: bytes, skip: NDArray[np.bool_]) -> bytes:
    lines = block.splitlines(keepends=True)
    return b"".join(line for line, skipped in zip(lines, skip, strict=True) if not skipped)


def _changes(codes: Iterable[Integers], size: int) -> NDArray[np.bool_]:
    """Return where any label differs from the row before, for the rows after the first."""
    changed = np.zeros(size - 1, bool)
    for values in codes:
        changed |= values[1:] != values[:-1]
    return changed
