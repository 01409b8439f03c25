"""Read the text of a machine's file: bytes to lines, and lines of numbers to columns."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import Floats

Header = TypeVar("Header")

_UTF8, _LITTLE, _BIG = b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff"
_HEADER_LINES = 400  # more lines than any header has
_MOST_CELLS = 2000  # cells of a line: more than a machine has channels
_LONG = re.compile(rb"[^\n]{%d}" % _MOST_CELLS)
_SAMPLE = 400  # rows from which the decimal mark is taken
_NUMERIC = re.compile(rb'^[ \t]*["+\-.\d][\d+\-.,;:eE" \t]*$', re.MULTILINE)
_IN_ROWS = b'0123456789+-.,;:eE" \t\n'
_EXPORT = "export the measurements again"


def decoded(data: bytes) -> str:
    """Return bytes as text: UTF-8, UTF-16 or cp1252, without marks and NULs; it never fails."""
    start = data[:64]
    if data.startswith(_LITTLE):
        text = data[2:].decode("utf-16-le", "replace")
    elif data.startswith(_BIG):
        text = data[2:].decode("utf-16-be", "replace")
    elif len(start) > 16 and not any(start[1::2]):
        text = data.decode("utf-16-le", "replace")
    elif len(start) > 16 and not any(start[::2]):
        text = data.decode("utf-16-be", "replace")
    else:
        data = data.removeprefix(_UTF8)
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError as error:
            cut = error.start > len(data) - 4  # the last letter of a head may be cut
            text = data.decode("utf-8" if cut else "cp1252", "replace")
    return text.replace("\0", "").replace("\r\n", "\n").replace("\r", "\n")


def content(path: Path) -> bytes:
    """Return the whole text as UTF-8, unzipped, with lines ended by a newline alone.

    Raises
    ------
    InputError
        The file is missing, cannot be read, or is damaged gzip.
    """
    try:
        data = path.read_bytes()
        if data.startswith(b"\x1f\x8b"):
            data = gzip.decompress(data)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        remedy = "copy or compress it again"
        raise InputError(
            "the gzip data are cut off or damaged", file=path, remedy=remedy
        ) from error
    except OSError as error:
        remedy = "check the path and its rights"
        raise InputError(f"cannot be read ({error.strerror})", file=path, remedy=remedy) from error
    if data.isascii() and b"\0" not in data:
        return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data
    return decoded(data).encode()


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line without quotation marks and blanks, or an endless line itself."""
    if line.count(separator) >= _MOST_CELLS:
        return [line]
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # an overlong field
        return [line]
    return [cell.strip() for cell in cells]


def separator_of(line: str) -> str:
    """Return the tab, semicolon or comma that separates the cells of a line of names."""
    return max("\t;,", key=line.count)


def cells_at(rows: bytes, separator: str, indices: Sequence[int]) -> bytes:
    """Return only the cells at these indices, as text in other cells is no number.

    A last line without an end stays so, unless another cell follows those: ``read_rows`` then sees
    whether it is cut off.
    """
    mark = separator.encode()
    kept, cells = [], []
    for line in rows.split(b"\n"):
        if b'"' in line:
            cells = [f'"{cell}"'.encode() for cell in cells_of(line.decode("utf-8"), separator)]
        else:
            cells = line.split(mark)
        if len(cells) > max(indices):
            kept.append(mark.join(cells[index] for index in indices))
    whole = rows.endswith(b"\n") or len(cells) > max(indices) + 1
    return b"\n".join(kept) + b"\n" * whole


@dataclass(frozen=True)
class Lines:
    """Lines at the beginning of a file, and the offset in bytes at which each starts."""

    texts: tuple[str, ...]
    starts: tuple[int, ...]

    @classmethod
    def from_bytes(cls, data: bytes) -> Lines:
        """Return the first lines of a text as ``content`` gives it."""
        parts = data.split(b"\n", _HEADER_LINES)[:_HEADER_LINES]
        starts = np.cumsum([0, *(len(part) + 1 for part in parts)])
        return cls(
            tuple(part.decode("utf-8", "replace") for part in parts),
            tuple(min(int(start), len(data)) for start in starts),
        )

    def cells(self) -> Iterator[tuple[int, list[str]]]:
        """Yield each line's number (from 0) and its cells, separated by its own separator."""
        for number, text in enumerate(self.texts):
            yield number, cells_of(text, separator_of(text))


def with_header(
    path: Path, find: Callable[[Lines], Header | None], lacking: str, remedy: str
) -> tuple[bytes, Lines, Header]:
    """Return a file's text, its first lines, and what ``find`` sees of the header in them.

    Raises
    ------
    InputError
        The file cannot be read, or ``lacking`` the header; ``remedy`` says what to do then.
    """
    data = content(path)
    lines = Lines.from_bytes(data)
    header = find(lines)
    if header is None:
        raise InputError(lacking, file=path, remedy=remedy)
    return data, lines, header


@dataclass(frozen=True, eq=False)
class NumericRows:
    """Columns of numbers, one for each index asked for, and counts of dropped lines."""

    columns: tuple[Floats, ...]
    dropped: dict[str, int]


def read_rows(block: bytes, separator: str, indices: Sequence[int], file: Path) -> NumericRows:
    """Return columns at the given indices of lines of numbers; other lines are counted.

    The decimal mark is found from the numbers; a last line that is cut off is dropped.

    Raises
    ------
    InputError
        No line holds numbers at all the indices, or the decimal mark is ambiguous.
    """
    dropped: dict[str, int] = {}
    block = _without_endless(_whole(block, dropped), separator, dropped)
    if block.translate(None, _IN_ROWS):
        lines = [line for line in block.split(b"\n") if line.strip()]
        kept = [match.group() for match in _NUMERIC.finditer(block) if match.group().strip()]
        _count(dropped, "lines without numbers", len(lines) - len(kept))
        block = b"\n".join(kept) + b"\n"
    if not block.strip():
        raise InputError("there are no rows of numbers", file=file, remedy=_EXPORT)
    decimal = _decimal(block, separator, indices, file)
    columns = _parsed(block, separator, indices, decimal, file, dropped)
    good = np.logical_and.reduce([np.isfinite(column) for column in columns])
    _count(dropped, "rows with an empty cell", int(np.count_nonzero(~good)))
    if not good.any():
        raise InputError("there are no rows of numbers", file=file, remedy=_EXPORT)
    if not good.all():
        columns = [column[good] for column in columns]
    return NumericRows(tuple(columns), dropped)


def _count(dropped: dict[str, int], why: str, rows: int) -> None:
    if rows:
        dropped[why] = dropped.get(why, 0) + rows


def _without_endless(block: bytes, separator: str, dropped: dict[str, int]) -> bytes:
    """Return the block without lines of more cells than a machine has channels.

    Each of these cells would take a column.
    """
    if not _LONG.search(block):
        return block
    mark = separator.encode()
    lines = block.split(b"\n")
    kept = [line for line in lines if line.count(mark) < _MOST_CELLS]
    _count(dropped, "lines of too many cells", len(lines) - len(kept))
    return b"\n".join(kept)


def _whole(block: bytes, dropped: dict[str, int]) -> bytes:
    """Return the block without a last line that is cut off.

    Such a line has no line end and is shorter than the one above.
    """
    block = block.rstrip(b" \t")
    if not block or block.endswith(b"\n"):
        return block
    above, _, last = block.rpartition(b"\n")
    _, _, before = above.rpartition(b"\n")
    fewer = any(last.count(mark) < before.count(mark) for mark in (b",", b";", b"\t", b'"'))
    tails = [re.search(rb"[.,](\d*)\D*$", line) for line in (before, last)]
    digits = [len(tail[1]) if tail else 0 for tail in tails]
    if fewer or digits[1] < digits[0]:
        _count(dropped, "cut last line", 1)
        return above + b"\n"
    return block + b"\n"


def _decimal(block: bytes, separator: str, indices: Sequence[int], file: Path) -> str:
    """Return the decimal mark; '.,' for points with commas at thousands, ',.' for the reverse."""
    end = 0
    for _ in range(_SAMPLE):
        end = block.find(b"\n", end) + 1
        if not end:
            break
    rows = block[: end or None].decode("utf-8", "replace").split("\n")
    cells = [cells_of(row, separator) for row in rows if row.strip()]
    shown = [row[index] for row in cells for index in indices if index < len(row)]
    marked = [cell for cell in shown if "." in cell or "," in cell]
    both = [cell for cell in marked if "." in cell and "," in cell]
    if both:
        last = {max(".,", key=cell.rfind) for cell in both}
        if len(last) == 1:
            mark = last.pop()
            return mark + (",." if mark == "." else ".,")[0]
    points = sum("." in cell for cell in marked)
    if not marked or points == len(marked):
        return "."
    if points:
        if all("." in c or re.fullmatch(r"[+-]?[1-9]\d{0,2}(,\d{3})+", c) for c in marked):
            return ".,"
        raise InputError(
            "some numbers have a decimal point and some a decimal comma",
            file=file,
            remedy="export with one decimal mark",
        )
    if all(re.fullmatch(r"[+-]?[1-9]\d{0,2}(,\d{3})+", cell) for cell in marked):
        raise InputError(
            f"'{marked[0]}' may be a decimal comma or a thousand",
            file=file,
            remedy="export with decimal points",
        )
    return ","


def _filled(block: bytes) -> int:
    """Return the number of lines that are not blank."""
    if b"\n\n" not in block and b" \n" not in block and b"\t\n" not in block:
        return block.count(b"\n") - block.startswith(b"\n")
    return sum(bool(line.strip()) for line in block.split(b"\n"))


def _parsed(
    block: bytes,
    separator: str,
    indices: Sequence[int],
    decimal: str,
    file: Path,
    dropped: dict[str, int],
) -> list[Floats]:
    width = cells_of(block[: block.index(b"\n")].decode("utf-8", "replace"), separator)
    options: dict = {"thousands": decimal[1]} if len(decimal) == 2 else {}
    try:
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
    except ValueError as error:
        text = str(error).split("\n")[0][:100]
        raise InputError(f"the rows cannot be read ({text})", file=file, remedy=_EXPORT) from error
    _count(dropped, "rows with too many cells", _filled(block) - len(frame))
    return [frame[index].to_numpy(dtype=np.float64) for index in indices]
