"""Read the text of a machine's file: bytes to lines, and lines of numbers to columns."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import Floats
from qlvbayes.io.reading.clock import LARGEST_SHARE

Header = TypeVar("Header")

_UTF8, _LITTLE, _BIG = b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff"
_HEADER_LINES = 400  # more lines than any header has
_MOST_CELLS = 2000  # cells of a line: more than a machine has channels
_LONG = re.compile(rb"[^\n]{%d}" % _MOST_CELLS)
_MARKS = "\t;|,"
_LEAST_MARKS = 2  # separators of a row of time, displacement and force
_SAMPLE = 400  # rows from which the decimal mark is taken where all the others agree
_IN_ROWS = b'0123456789+-.,;eE" \t\n'  # all that lines of numbers alone have
_MINUS = re.compile(r"[\u2212\u2012\u2013\ufe63\uff0d](?=[\d.,])")
_BETWEEN_THOUSANDS = re.compile(r"(?<=\d)[ \u00a0\u202f\u2009\u2007](?=\d{3}(?!\d))")
_SPACED = re.compile(rb"\d \d{3}")
_CLOCK = re.compile(  # ISO 8601, or the date as in German
    r"(\d{4}-\d\d-\d\d[T ]|\d\d?\.\d\d?\.\d{4} )?(\d+):(\d\d):(\d\d([.,]\d+)?)(Z|[+-]\d\d:?\d\d)?"
)
_DAY = 86400.0  # s
_COMMENT = re.compile(rb"(?m)^[ \t]*[#%]+[ \t]*")
_NAME = re.compile(r"[^\s(\[]+(?:\s?[(\[][^)\]]*[)\]])?|[(\[][^)\]]*[)\]]")  # with its unit
_FOOTER = 8  # lines at the end in which a summary of the table may stand,
_SUMMED = 3  # and most rows of numbers in it
_FEWEST = 20  # lines of a table that may have one
_LIKE_NUMBER = re.compile(r"[+-]?(\d[\d.,]*|[.,]\d+)([eE][+-]?\d+)?|" + _CLOCK.pattern)
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--", "---"}
_SHOWN = 60  # characters of a line that an error shows
_FEW_EMPTY = 10  # rows in turn with an empty cell that a logger of two rates leaves
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


def with_tabs(data: bytes) -> tuple[bytes, bool]:
    """Return a text with tabs where blanks separate its numbers, and whether they do.

    Marks of comments at the beginning of lines are left out, also where nothing else changes. Names
    above the numbers keep their units: 'time [s]  force [N]' are two cells.
    """
    data = _COMMENT.sub(b"", data)
    lines = Lines.from_bytes(data)
    for number, line in enumerate(lines.texts):
        cells = line.split()
        if len(cells) < _LEAST_MARKS + 1 or not all(map(is_like_number, cells)):
            continue
        if "\t" in line:
            return data, False
        names = map(_NAME.findall, lines.texts[:number])
        head = [
            "\t".join(some) if len(some) == len(cells) else text
            for some, text in zip(names, lines.texts, strict=False)
        ]
        rows = re.sub(rb"[ \t]+", b"\t", data[lines.starts[number] :])
        rows = re.sub(rb"(?m)^\t|\t$", b"", rows)
        return "".join(f"{line}\n" for line in head).encode() + rows, True
    return data, False


def separator_of(line: str) -> str:
    """Return the tab, semicolon, bar or comma that separates three cells or more of a line.

    A comma comes last, as it is also in 'Kraft, N' and in decimals.
    """
    several = (mark for mark in _MARKS if line.count(mark) >= _LEAST_MARKS)
    return next(several, max(_MARKS, key=line.count))


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


def sections(rows: bytes, names: str, first: int) -> list[tuple[int, bytes]]:
    """Return rows in parts, cut where the line of names is repeated, each with its first line.

    ``first`` is the line, from 0, at which the rows begin.
    """
    mark = b"\n" + names.encode() + b"\n"
    *before, last = (b"\n" + rows).split(mark)
    parts = [*(part + b"\n" for part in before), last]
    parts[0] = parts[0][1:]
    numbered = []
    for part in parts:
        numbered.append((first, part))
        first += part.count(b"\n") + 1
    return numbered


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
    """Return columns at the given indices of lines of numbers; other lines are counted.

    Only cells at these indices are judged: text in others is no fault. The decimal mark is found
    from the numbers; a last line that is cut off is dropped. ``line`` is the number of the block's
    first line in the file. ``sparse`` is true where each channel has rows of its own, so that empty
    cells are no fault.

    Raises
    ------
    InputError
        No line holds numbers at all the indices, the decimal mark is ambiguous, or more than 2 % of
        the lines between the first and the last one cannot be used.
    """
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


def _without_footer(
    block: bytes, separator: str, indices: Sequence[int], dropped: dict[str, int]
) -> bytes:
    """Return the block without a summary below it: some rows of numbers after a text or a gap.

    A mean, or the row of the largest force, is none of the test's readings.
    """
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
    time = used[0].lower()
    return not any(used) or not (time in _MISSING or is_like_number(time))


def _count(dropped: dict[str, int], why: str, rows: int) -> None:
    if rows:
        dropped[why] = dropped.get(why, 0) + rows


def _with_plain_numbers(block: bytes) -> bytes:
    """Return the block with ASCII's minus, and without spaces at thousands."""
    if block.isascii() and (b" " not in block or not _SPACED.search(block)):
        return block
    return plain_number(block.decode("utf-8", "replace")).encode()


def plain_number(text: str) -> str:
    """Return numbers with ASCII's minus and without spaces at thousands: '1 234,5' -> '1234,5'."""
    return _BETWEEN_THOUSANDS.sub("", _MINUS.sub("-", text))


def is_like_number(cell: str) -> bool:
    """Return whether a cell may be a number, with whatever decimal mark, or a time of hh:mm:ss."""
    return _LIKE_NUMBER.fullmatch(cell) is not None


def are_numbers(cells: Sequence[str], indices: Sequence[int]) -> bool:
    """Return whether there are numbers in all the cells at these indices."""
    return len(cells) > max(indices) and all(is_like_number(cells[index]) for index in indices)


def refuse_cells(lines: Lines, indices: Sequence[int], file: Path) -> None:
    """Raise InputError where a cell at one of the indices has a digit and is no number.

    The first line is taken that has digits in all the cells.
    """
    for number, cells in lines.cells():
        used = [cells[index] for index in indices if index < len(cells)]
        if len(used) < len(indices) or not all(re.search(r"\d", cell) for cell in used):
            continue
        bad = [cell for cell in used if not is_like_number(cell)]
        if bad:
            raise InputError(
                f"'{bad[0][:_SHOWN]}' is no number",
                file=file,
                line=number + 1,
                remedy="write plain numbers, and times in s, as 10:59:55.1 or as an ISO 8601 date",
            )


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
            if line.count(separator) >= _MOST_CELLS:
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
            if all(map(_NUMBER.fullmatch, cells)):
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
        """Return the error of a block that loses more than 2 % of its rows; None otherwise.

        Lines before the first row and after the last one are no rows. Empty cells count where more
        than a few follow one another, and so leave a gap.
        """
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
        return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


_NO_NUMBERS = "lines without numbers"
_EMPTY = "rows with an empty cell"
_BLANK = "rows without any used cell"  # they count as empty between other rows, and not at the end
_TOO_WIDE = "rows with too many cells"
_TOO_LONG = "lines of too many cells"


def _fault(cells: Sequence[str], used: Sequence[str], width: int, *, short: bool) -> str | None:
    """Return why a line is no row; None where it is one.

    ``width`` is the number of cells of the rows above; ``short`` is true where cells are lacking.
    """
    if not all(map(_LIKE_NUMBER.fullmatch, used)):
        judged = cells if short else used  # a title in a cell of its own
        known = all(c.lower() in _MISSING or _LIKE_NUMBER.fullmatch(c) for c in judged)
        if not known:
            return _NO_NUMBERS
        return _EMPTY if any(used) else _BLANK
    wide = 0 < width < len(cells)
    if wide and all(not cell or _LIKE_NUMBER.fullmatch(cell) for cell in cells):
        return _TOO_WIDE  # a decimal comma may have split a number
    return None


def _longest_stretch(positions: Sequence[int]) -> list[int]:
    """Return the longest run of positions that follow one another."""
    if not positions:
        return []
    cuts = np.flatnonzero(np.diff(positions) != 1) + 1
    return max((run.tolist() for run in np.split(np.array(positions), cuts)), key=len)


def with_point(cell: str, decimal: str) -> str:
    """Return a cell with a decimal point; a date, hours, minutes and seconds become seconds."""
    if clock := _CLOCK.fullmatch(cell):
        date = (clock[1] or "1970-01-01").strip(" T")
        if "." in date:
            date = "-".join(part.zfill(2) for part in reversed(date.split(".")))
        days = np.datetime64(date).astype(int)
        minutes = 1440 * days + 60 * int(clock[2]) + int(clock[3])
        return f"{60 * minutes + float(clock[4].replace(',', '.')):.9f}"
    if len(decimal) == 2:
        cell = cell.replace(decimal[1], "")
    return cell.replace(decimal[0], ".")


def _whole(block: bytes, separator: str, indices: Sequence[int], dropped: dict[str, int]) -> bytes:
    """Return the block without a last line that is cut off.

    Such a line has no line end, no cell beyond those that are used, and is shorter than the one
    above.
    """
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


def decimal_mark(cells: Iterable[str], file: Path) -> str:
    """Return the decimal mark; '.,' for points with commas at thousands, ',.' for the reverse."""
    marked = [cell for cell in cells if "." in cell or "," in cell]
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
