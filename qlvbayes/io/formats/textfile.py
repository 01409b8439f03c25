"""Read the text of a machine's file: bytes to lines, and lines to cells."""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.reading.csvtext import cut_gzip, unreadable

MOST_CELLS = 2000  # cells of a line: more than a machine has channels
SHOWN = 60  # characters of a line that an error shows
_HEADER_LINES = 400  # more lines than any header has
_MARKS = "\t;|,"
_LEAST_MARKS = 2  # separators of a row of time, displacement and force
_CODES = ("utf-8", "cp932", "cp1252")
"""Codes of letters that are tried in turn; the last one takes any bytes."""
_KANA = re.compile("[\u3041-\u30ff].*[\u3041-\u30ff\u4e00-\u9fff]|[\u4e00-\u9fff]{2}")
_BINARY = re.compile(r"[\x00-\x08\x0e-\x1a\x1c-\x1f\x7f]")
_COMMENT = re.compile(rb"(?m)^[ \t]*[#%]+[ \t]*")
_NAME = re.compile(  # a quoted name, or one with its unit
    r"\"[^\"]*\"|[^\s(\[\"]+(?:\s?[(\[][^)\]]*[)\]])?|[(\[][^)\]]*[)\]]"
)

_MINUS = re.compile(r"[\u2212\u2012\u2013\ufe63\uff0d](?=[\d.,])")
_BETWEEN_THOUSANDS = re.compile(r"(?<=\d)[ \u00a0\u202f\u2009\u2007](?=\d{3}(?!\d))")
_CLOCK = re.compile(  # ISO 8601, or the date as in German, French or English
    r"(\d{4}-\d\d-\d\d[T ]|\d\d?[./]\d\d?[./]\d{4} )?(\d+):(\d\d):(\d\d([.,]\d+)?)"
    r"(Z|[+-]\d\d:?\d\d)?"
)
_LIKE_NUMBER = re.compile(r"[+-]?(\d[\d.,]*|[.,]\d+)([eE][+-]?\d+)?|" + _CLOCK.pattern)
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--", "---"}


def decoded(data: bytes) -> str:
    """Return bytes as text: UTF-8, UTF-16, Shift-JIS or Windows, without NULs; it never fails."""
    start = data[:64]
    if data.startswith(b"\xff\xfe") or (len(start) > 16 and not any(start[1::2])):
        text = data.removeprefix(b"\xff\xfe").decode("utf-16-le", "replace")
    elif data.startswith(b"\xfe\xff") or (len(start) > 16 and not any(start[::2])):
        text = data.removeprefix(b"\xfe\xff").decode("utf-16-be", "replace")
    else:
        text = _of_bytes(data.removeprefix(b"\xef\xbb\xbf"))
    return text.replace("\0", "").replace("\r\n", "\n").replace("\r", "\n")


def _of_bytes(data: bytes) -> str:
    for code in _CODES[:-1]:
        try:
            text = data.decode(code)
        except UnicodeDecodeError as error:
            if error.start > len(data) - 4 and code == "utf-8":  # the last letter of a head is cut
                return data.decode(code, "replace")
            continue
        if code == "utf-8" or _KANA.search(text):
            return text
    return data.decode(_CODES[-1], "replace")


def content(path: Path) -> bytes:
    """Return the whole text as UTF-8, unzipped, with lines ended by a newline alone."""
    try:
        data = path.read_bytes()
        if data.startswith(b"\x1f\x8b"):
            data = gzip.decompress(data)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise cut_gzip(path) from error
    except OSError as error:
        raise unreadable(path, error) from error
    if data.isascii() and b"\0" not in data:
        return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data
    return decoded(data).encode()


def is_text(head: bytes) -> bool:
    """Return whether the first bytes of a file are text: without signs that none has."""
    return _BINARY.search(decoded(head)) is None


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line without quotation marks and blanks, or an endless line itself."""
    if line.count(separator) >= MOST_CELLS:
        return [line]
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # an overlong field
        return [line]
    return [cell.strip() for cell in cells]


def with_tabs(data: bytes) -> tuple[bytes, bool]:
    """Return a text with tabs where blanks separate its numbers, and whether they do."""
    data = _COMMENT.sub(b"", data)
    lines = Lines.from_bytes(data)
    for number, line in enumerate(lines.texts):
        cells = [cell.strip('"') for cell in line.split()]
        if len(cells) < _LEAST_MARKS + 1 or not all(map(_stands_alone, cells)):
            continue
        if "\t" in line:
            return data, False
        names = map(_NAME.findall, lines.texts[:number])
        head = [
            "\t".join(some) if len(some) in (len(cells), len(cells) - 1) else text
            for some, text in zip(names, lines.texts, strict=False)
        ]
        rows = re.sub(rb"[ \t]+", b"\t", data[lines.starts[number] :])
        rows = re.sub(rb"(?m)^\t|\t$", b"", rows)
        return "".join(f"{line}\n" for line in head).encode() + rows, True
    return data, False


def _stands_alone(cell: str) -> bool:
    return is_like_number(cell) and cell[-1] not in ",;"


def separator_of(line: str) -> str:
    """Return the tab, semicolon, bar or comma that separates three cells or more of a line."""
    several = (mark for mark in _MARKS if line.count(mark) >= _LEAST_MARKS)
    return next(several, max(_MARKS, key=line.count))


@dataclass(frozen=True)
class Lines:
    """Lines at the beginning of a text, and the offset in bytes at which each starts."""

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
    """Return rows in parts, cut where the line of names is repeated, each with its first line."""
    *before, last = (b"\n" + rows).split(b"\n" + names.encode() + b"\n")
    parts = [*(part + b"\n" for part in before), last]
    parts[0] = parts[0][1:]
    numbered = []
    for part in parts:
        numbered.append((first, part))
        first += part.count(b"\n") + 1
    return numbered


def plain_number(text: str) -> str:
    """Return numbers with ASCII's minus and without spaces at thousands: '1 234,5' -> '1234,5'."""
    return _BETWEEN_THOUSANDS.sub("", _MINUS.sub("-", text))


def is_like_number(cell: str) -> bool:
    """Return whether a cell may be a number, with whatever decimal mark, or a time of hh:mm:ss."""
    return _LIKE_NUMBER.fullmatch(cell) is not None


def is_number(cell: str) -> bool:
    """Return whether a cell is a number with a decimal point."""
    return _NUMBER.fullmatch(cell) is not None


def is_missing(cell: str) -> bool:
    """Return whether a cell is empty, or has a mark for no number."""
    return cell.lower() in _MISSING


def are_numbers(cells: Sequence[str], indices: Sequence[int]) -> bool:
    """Return whether there are numbers in all the cells at these indices."""
    return len(cells) > max(indices) and all(is_like_number(cells[index]) for index in indices)


def with_point(cell: str, decimal: str) -> str:
    """Return a cell with a decimal point; a date, hours, minutes and seconds become seconds."""
    if clock := _CLOCK.fullmatch(cell):
        days = _days(clock[1].strip(" T")) if clock[1] else 0
        minutes = 1440 * days + 60 * int(clock[2]) + int(clock[3])
        return f"{60 * minutes + float(clock[4].replace(',', '.')):.9f}"
    if len(decimal) == 2:
        cell = cell.replace(decimal[1], "")
    return cell.replace(decimal[0], ".")


def _days(date: str) -> int:
    """Return the days since 1970 of a date: the year first, or the day (the month if it must)."""
    if "-" not in date:
        day, month, year = map(int, re.split("[./]", date))
        day, month = (month, day) if month > 12 else (day, month)
        date = f"{year:04}-{month:02}-{day:02}"
    try:
        return int(np.datetime64(date).astype(int))
    except ValueError:  # no such day
        return 0


def decimal_mark(cells: Iterable[str], file: Path) -> str:
    """Return the decimal mark; '.,' for points with commas at thousands, ',.' for the reverse."""
    marked = [cell for cell in cells if "." in cell or "," in cell]
    last = {max(".,", key=cell.rfind) for cell in marked if "." in cell and "," in cell}
    if len(last) == 1:
        return ".," if last == {"."} else ",."
    points = sum("." in cell for cell in marked)
    if points == len(marked):
        return "."
    grouped = all("." in cell or _THOUSANDS.fullmatch(cell) for cell in marked)
    if points and grouped:
        return ".,"
    if points:
        what, marks = (
            "some numbers have a decimal point and some a decimal comma",
            "one decimal mark",
        )
    elif grouped:
        what, marks = f"'{marked[0]}' may be a decimal comma or a thousand", "decimal points"
    else:
        return ","
    raise InputError(what, file=file, remedy=f"export with {marks}")


def refuse_cells(lines: Lines, indices: Sequence[int], file: Path) -> None:
    """Raise InputError where a cell at one of the indices has a digit and is no number."""
    for number, cells in lines.cells():
        used = [cells[index] for index in indices if index < len(cells)]
        if len(used) < len(indices) or not all(re.search(r"\d", cell) for cell in used):
            continue
        bad = [cell for cell in used if not is_like_number(cell)]
        if bad:
            raise InputError(
                f"'{bad[0][:SHOWN]}' is no number",
                file=file,
                line=number + 1,
                remedy="write plain numbers, and times in s, as 10:59:55.1 or as an ISO 8601 date",
            )
