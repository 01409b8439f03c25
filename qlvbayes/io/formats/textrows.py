"""Read lines of numbers as columns, and count the lines that are none."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import Floats
from qlvbayes.io.formats.textfile import (
    MOST_CELLS,
    SHOWN,
    cells_of,
    decimal_mark,
    is_like_number,
    is_missing,
    is_number,
    plain_number,
    with_point,
)
from qlvbayes.io.reading.clock import LARGEST_SHARE

_LONG = re.compile(rb"[^\n]{%d}" % MOST_CELLS)
_SAMPLE = 400  # rows from which the decimal mark is taken where all the others agree
_IN_ROWS = b'0123456789+-.,;eE" \t\n'  # all that lines of numbers alone have
_SPACED = re.compile(rb"\d \d{3}")
_DAY = 86400.0  # s
_FOOTER = 8  # lines at the end in which a summary of the table may stand,
_SUMMED = 3  # and most rows of numbers in it
_FEWEST = 20  # lines of a table that may have one
_FEW_EMPTY = 10  # rows in turn with an empty cell that a logger of two rates leaves
_EXPORT = "export the measurements again"
_NO_NUMBERS = "lines without numbers"
_EMPTY = "rows with an empty cell"
_BLANK = "rows without any used cell"  # they count as empty between other rows, and not at the end
_TOO_WIDE = "rows with too many cells"
_TOO_LONG = "lines of too many cells"


@dataclass(frozen=True, eq=False)
class NumericRows:
    """Columns of numbers, one for each index asked for, and counts of dropped lines.

    ``clocks`` are the positions, among the columns, of those written as hours, minutes and seconds;
    they are in s.
    """

    columns: tuple[Floats, ...]
    dropped: dict[str, int]
    clocks: tuple[int, ...] = ()


def read_rows(
    block: bytes,
    separator: str,
    indices: Sequence[int],
    file: Path,
    line: int | None = None,
    *,
    sparse: bool = False,
) -> NumericRows:
    """Return columns at the given indices of lines of numbers; other lines are counted."""
    dropped: dict[str, int] = {}
    block = _with_plain_numbers(_whole(block, separator, indices, dropped))
    block = _without_footer(block, separator, indices, dropped)
    if not block.strip():
        raise InputError("there are no rows of numbers", file=file, remedy=_EXPORT)
    if not block.translate(None, _IN_ROWS) and not _LONG.search(block):
        columns = _all_numbers(block, separator, indices, file)
        if columns is not None:
            return NumericRows(tuple(columns), dropped)
    lines = _Lines.from_text(block.decode("utf-8", "replace"), separator, indices)
    rows = lines.with_points(file)
    lines.join_blank()
    for why, lost in lines.dropped.items():
        _count(dropped, why, len(lost))
    if not rows:
        raise lines.without_numbers(file, line)
    if (error := lines.fault(file, line, sparse=sparse)) is not None:
        raise error
    columns = _parsed(("\n".join(rows) + "\n").encode(), "\t", range(len(indices)), ".")
    clocks = tuple(k for k, cell in enumerate(lines.rows[0]) if ":" in cell)
    for k in clocks:  # past midnight, where no date is written
        columns[k] = columns[k] + _DAY * np.cumsum(np.diff(columns[k], prepend=0.0) < -0.5 * _DAY)
    return NumericRows(tuple(columns), dropped, clocks)


def refuse_split_numbers(rows: bytes, separator: str, names: int, file: Path, line: int) -> None:
    """Raise InputError where decimal commas split the numbers below as many names, at this line."""
    first = next((row for row in rows.split(b"\n", 9) if row.strip()), b"")
    cells = cells_of(first.decode("utf-8", "replace"), separator)
    whole = all(cell.lstrip("+-").isdecimal() for cell in cells)
    if separator == "," and len(cells) > names and whole:
        raise InputError(
            f"{len(cells)} numbers are below {names} names: the comma separates columns and marks "
            "decimals",
            file=file,
            line=line,
            remedy="export with semicolons or tabs between the columns, or with decimal points",
        )


def _without_footer(
    block: bytes, separator: str, indices: Sequence[int], dropped: dict[str, int]
) -> bytes:
    """Return the block without a summary below it: some rows of numbers after a text or a gap."""
    if block.count(b"\n") < _FEWEST:
        return block
    *above, last = block.rstrip(b"\n").rsplit(b"\n", _FOOTER)
    tail = [*above[1:], last]
    rows = [cells_of(line.decode("utf-8", "replace"), separator) for line in tail]
    used = [_at(cells, indices) for cells in rows]
    breaks = [k for k, cells in enumerate(used) if _ends_table(cells)]
    below = used[breaks[0] :] if breaks else []
    numbers = sum(all(map(is_like_number, cells)) for cells in below)
    if not 0 < numbers <= _SUMMED:
        return block
    _count(dropped, "rows of numbers below the table", numbers)
    return b"\n".join([above[0], *tail[: breaks[0]], b""])


def _at(cells: Sequence[str], indices: Sequence[int]) -> list[str]:
    """Return the cells at the indices, empty ones beyond the last."""
    return [cells[index] if index < len(cells) else "" for index in indices]


def _ends_table(used: Sequence[str]) -> bool:
    """Return whether a line has no used cell at all, or a word where the time would be."""
    time = used[0]
    return not any(used) or not (is_missing(time) or is_like_number(time))


def _count(dropped: dict[str, int], why: str, rows: int) -> None:
    if rows:
        dropped[why] = dropped.get(why, 0) + rows


def _with_plain_numbers(block: bytes) -> bytes:
    """Return the block with ASCII's minus, and without spaces at thousands."""
    if block.isascii() and (b" " not in block or not _SPACED.search(block)):
        return block
    return plain_number(block.decode("utf-8", "replace")).encode()


def _all_numbers(
    block: bytes, separator: str, indices: Sequence[int], file: Path
) -> list[Floats] | None:
    """Return the columns of a block in which every line is a row; None where one may not be."""
    end = 0
    for _ in range(_SAMPLE):
        end = block.find(b"\n", end) + 1
        if not end:
            break
    sample = block[: end or None].decode("utf-8", "replace").split("\n")
    rows = [cells_of(row, separator) for row in sample if row.strip()]
    decimal = decimal_mark((row[k] for row in rows for k in indices if k < len(row)), file)
    try:
        columns = _parsed(block, separator, indices, decimal)
    except ValueError:
        return None
    whole = len(columns[0]) == _filled(block) and all(np.isfinite(one).all() for one in columns)
    return columns if whole else None


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines of a block, those with a number in each cell that is used, and why others are dropped.

    ``rows`` are the used cells and ``positions`` the indices of their lines in ``texts``;
    ``dropped`` are such indices by reason.
    """

    texts: list[str]
    rows: list[list[str]] = field(default_factory=list)
    positions: list[int] = field(default_factory=list)
    dropped: dict[str, list[int]] = field(default_factory=dict)

    @classmethod
    def from_text(cls, text: str, separator: str, indices: Sequence[int]) -> _Lines:
        """Return the lines of a text, each judged by its cells at the indices."""
        lines = cls(text.split("\n"))
        width = 0
        for position, line in enumerate(lines.texts):
            if not line.strip():
                continue
            if line.count(separator) >= MOST_CELLS:
                lines.drop(_TOO_LONG, position)
                continue
            cells = (
                cells_of(line, separator)
                if '"' in line
                else [cell.strip() for cell in line.split(separator)]
            )
            used = _at(cells, indices)
            short = len(cells) <= max(indices)
            if (why := _fault(cells, used, width, short=short)) is not None:
                lines.drop(why, position)
                continue
            width = width or len(cells)
            lines.rows.append(used)
            lines.positions.append(position)
        return lines

    def drop(self, why: str, position: int) -> None:
        """Count a line as dropped."""
        self.dropped.setdefault(why, []).append(position)

    def with_points(self, file: Path) -> list[str]:
        """Return each row with tabs and decimal points; one that is still none is dropped."""
        decimal = decimal_mark((cell for row in self.rows for cell in row if ":" not in cell), file)
        pointed = []
        for k in range(len(self.rows) - 1, -1, -1):
            cells = [with_point(cell, decimal) for cell in self.rows[k]]
            if all(map(is_number, cells)):
                pointed.append("\t".join(cells))
                continue
            self.drop(_NO_NUMBERS, self.positions[k])
            del self.rows[k], self.positions[k]
        return pointed[::-1]

    def join_blank(self) -> None:
        """Count lines without any used cell as empty where rows follow, and forget the others."""
        blank = self.dropped.pop(_BLANK, [])
        last = self.positions[-1] if self.positions else 0
        within = [position for position in blank if position < last]
        if within:
            self.dropped[_EMPTY] = sorted([*self.dropped.get(_EMPTY, []), *within])

    def without_numbers(self, file: Path, line: int | None) -> InputError:
        """Return the error of a block in which no line is a row, with the first one that is not."""
        positions = sorted(position for lost in self.dropped.values() for position in lost)
        shown = f" (the first line is '{self.shown(positions[0])}')" if positions else ""
        at = line + positions[0] if line is not None and positions else None
        what = f"there are no rows of numbers{shown}"
        return InputError(what, file=file, line=at, remedy=_EXPORT)

    def fault(self, file: Path, line: int | None, *, sparse: bool) -> InputError | None:
        """Return the error of a block that loses more than 2 % of its rows; None otherwise."""
        first, last = self.positions[0], self.positions[-1]
        within = {
            why: [position for position in lost if first < position < last]
            for why, lost in self.dropped.items()
        }
        empty = within.pop(_EMPTY, [])
        lost = sorted(position for positions in within.values() for position in positions)
        total = len(self.rows) + len(lost) + len(empty)
        if not sparse:
            stretch = _longest_stretch(empty)
            lost = sorted([*lost, *stretch]) if len(stretch) > _FEW_EMPTY else lost
        if len(lost) <= max(LARGEST_SHARE * total, 1.0):
            return None
        return InputError(
            f"{len(lost)} of {total} rows have no number in a column that is used, the first "
            f"is '{self.shown(lost[0])}'",
            file=file,
            line=None if line is None else line + lost[0],
            remedy="write numbers there or delete the rows, or export the measurements again",
        )

    def shown(self, position: int) -> str:
        """Return the text of a line as an error shows it."""
        text = self.texts[position].strip()
        return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def _fault(cells: Sequence[str], used: Sequence[str], width: int, *, short: bool) -> str | None:
    """Return why a line is no row; None where it is one."""
    if not all(map(is_like_number, used)):
        judged = cells if short else used  # a title in a cell of its own
        known = all(is_missing(c) or is_like_number(c) for c in judged)
        if not known:
            return _NO_NUMBERS
        return _EMPTY if any(used) else _BLANK
    wide = 0 < width < len(cells)
    if wide and all(not cell or is_like_number(cell) for cell in cells):
        return _TOO_WIDE  # a decimal comma may have split a number
    return None


def _longest_stretch(positions: Sequence[int]) -> list[int]:
    """Return the longest run of positions that follow one another."""
    if not positions:
        return []
    cuts = np.flatnonzero(np.diff(positions) != 1) + 1
    return max((run.tolist() for run in np.split(np.array(positions), cuts)), key=len)


def _whole(block: bytes, separator: str, indices: Sequence[int], dropped: dict[str, int]) -> bytes:
    """Return the block without a last line that is cut off."""
    block = block.rstrip(b" \t")
    if not block or block.endswith(b"\n"):
        return block
    above, _, last = block.rpartition(b"\n")
    if b'"' not in last and last.count(separator.encode()) > max(indices):
        return block + b"\n"
    _, _, before = above.rpartition(b"\n")
    fewer = any(last.count(mark) < before.count(mark) for mark in (b",", b";", b"\t", b'"'))
    tails = [re.search(rb"[.,](\d*)\D*$", line) for line in (before, last)]
    digits = [len(tail[1]) if tail else 0 for tail in tails]
    if fewer or digits[1] < digits[0]:
        _count(dropped, "cut last line", 1)
        return above + b"\n"
    return block + b"\n"


def _filled(block: bytes) -> int:
    """Return the number of lines that are not blank."""
    if b"\n\n" not in block and b" \n" not in block and b"\t\n" not in block:
        return block.count(b"\n") - block.startswith(b"\n")
    return sum(bool(line.strip()) for line in block.split(b"\n"))


def _parsed(block: bytes, separator: str, indices: Sequence[int], decimal: str) -> list[Floats]:
    """Return the columns of a block; a ValueError says that a cell is no number."""
    width = cells_of(block[: block.index(b"\n")].decode("utf-8", "replace"), separator)
    options: dict = {"thousands": decimal[1]} if len(decimal) == 2 else {}
    frame = pd.read_csv(
        io.BytesIO(block),
        engine="c",
        header=None,
        names=list(range(max(len(width), max(indices) + 1))),
        index_col=False,
        usecols=sorted(set(indices)),
        dtype=dict.fromkeys(indices, float),
        sep=separator,
        decimal=decimal[0],
        skipinitialspace=True,
        low_memory=False,
        on_bad_lines="skip",
        **options,
    )
    return [frame[index].to_numpy(dtype=np.float64) for index in indices]
