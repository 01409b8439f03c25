"""Read text of any encoding: bytes to lines, lines to cells."""

from __future__ import annotations

import csv
import gzip
import hashlib
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from qlvbayes.io.checks import InputError

HEAD = 1 << 14  # bytes that a format may look at: the longest known headers have a few thousand
_MOST_CELLS = 2000  # cells of a line: more than a machine has channels
_HEADER_LINES = 400  # more lines than any header has
_MARKS = "\t;|,"
_KANA = re.compile(rb"[\x82\x83][\x40-\xf1]")  # a letter in Shift JIS; in cp1252 a low quotation
# mark or a florin sign before another letter
_KANAS = 2  # of which a European text may have so many
_BINARY = re.compile(r"[\x00-\x08\x0e-\x1a\x1c-\x1f\x7f]")
COMMENT = re.compile(r"(?m)^[ \t]*([#%!*]+|//+|;(?=[^;\n]*$))[ \t]*")  # signs of comments
_NAME = re.compile(  # a quoted name, or one with its unit
    r"\"[^\"]*\"|[^\s(\[\"]+(?:\s?[(\[][^)\]]*[)\]])?|[(\[][^)\]]*[)\]]"
)
CLOCK = re.compile(  # ISO 8601, or the date as in German, French or English
    r"(\d{4}-\d\d-\d\d[T ]|\d\d?[./]\d\d?[./]\d{4} )?(\d+):(\d\d):(\d\d([.,]\d+)?)"
    r"( ?(?P<half>[AaPp])[Mm])?(Z|[+-]\d\d:?\d\d)?"
)
_LIKE_NUMBER = re.compile(r"[+-]?(\d[\d.,]*|[.,]\d+)([eE][+-]?\d+)?|" + CLOCK.pattern)


def hour_of_day(hour: int, half: str | None) -> int:
    """Return an hour of 24, of one that an A or a P tells to be before or after noon."""
    return hour % 12 + 12 * (half in ("P", "p")) if half else hour


def digest(path: Path) -> str:
    """Return the SHA-256 of the file's bytes on the disk."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise _unreadable(path, error) from error


def head_of(path: Path, size: int = HEAD) -> bytes:
    """Return the first bytes of a file, unzipped; all of them where the size is -1."""
    try:
        with path.open("rb") as raw:
            zipped = raw.read(2) == b"\x1f\x8b"
            raw.seek(0)
            with cast(BinaryIO, gzip.open(raw)) if zipped else raw as stream:
                return stream.read(size)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        remedy = "copy or compress it again"
        raise InputError(
            "the gzip data are cut off or damaged", file=path, remedy=remedy
        ) from error
    except OSError as error:
        raise _unreadable(path, error) from error


def content(path: Path) -> bytes:
    """Return the whole text as UTF-8, unzipped, with lines ended by a newline alone."""
    data = head_of(path, -1)
    if data.isascii() and b"\0" not in data:
        return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data
    return decoded(data).encode()


def _unreadable(path: Path, error: OSError) -> InputError:
    """Return the error of a file that the system does not let read."""
    if path.is_dir():
        return InputError("this is a folder", file=path, remedy="name the files in it")
    if isinstance(error, FileNotFoundError):
        return InputError("no such file", file=path, remedy="check the path")
    return InputError(
        f"cannot be read ({error.strerror or error})", file=path, remedy="check its permissions"
    )


def decoded(data: bytes) -> str:
    """Return bytes as text: UTF-8, UTF-16, Shift JIS or Windows, without NULs; it never fails."""
    start = data[:64]
    if data.startswith(b"\xff\xfe") or (len(start) > 16 and not any(start[1::2])):
        text = data.removeprefix(b"\xff\xfe").decode("utf-16-le", "replace")
    elif data.startswith(b"\xfe\xff") or (len(start) > 16 and not any(start[::2])):
        text = data.removeprefix(b"\xfe\xff").decode("utf-16-be", "replace")
    else:
        data = data.removeprefix(b"\xef\xbb\xbf")
        try:
            text = data.decode()
        except UnicodeDecodeError as error:  # the last letter of a head may be cut
            cut = error.start > len(data) - 4
            single = "cp932" if len(_KANA.findall(data)) > _KANAS else "cp1252"
            text = data.decode("utf-8" if cut else single, "replace")
    return text.replace("\0", "").replace("\r\n", "\n").replace("\r", "\n")


def is_text(head: bytes) -> bool:
    """Return whether the first bytes of a file are text: without signs that none has."""
    return _BINARY.search(decoded(head)) is None


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line without quotation marks and blanks, or an endless line itself."""
    if line.count(separator) >= _MOST_CELLS:
        return [line]
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # an overlong field
        return [line]
    return [cell.strip() for cell in cells]


def separator_of(line: str) -> str:
    """Return the tab, semicolon, bar or comma that separates three cells or more of a line."""
    several = (mark for mark in _MARKS if line.count(mark) > 1)
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


def with_tabs(data: bytes) -> tuple[bytes, bool]:
    """Return a text with tabs where blanks separate its numbers, and whether they do.

    Names above the numbers are separated as these are, and the signs of comments are left out.
    """
    data = re.sub(COMMENT.pattern.encode(), b"", data)
    lines = Lines.from_bytes(data)
    for number, line in enumerate(lines.texts):
        cells, mark = [cell.strip('"') for cell in line.split()], separator_of(line)
        blanks = "\t" not in line and not any(cell.endswith((",", ";")) for cell in cells)
        if not blanks or len(cells) < 3:
            cells, blanks = cells_of(line, mark), False
        if len(cells) < 3 or not all(map(is_like_number, cells)):
            continue
        mark = "\t" if blanks else mark
        head = [names_above(text, mark, len(cells)) for text in lines.texts[:number]]
        rows = data[lines.starts[number] :]
        if blanks:
            rows = re.sub(rb"(?m)^\t|\t$", b"", re.sub(rb"[ \t]+", b"\t", rows))
        return "".join(f"{line}\n" for line in head).encode() + rows, blanks
    return data, False


def names_above(line: str, mark: str, width: int) -> str:
    """Return a line above ``width`` columns, separated by their mark where it names each of them.

    The names of columns that blanks separate may leave out that of the first.
    """
    by_mark = [name.strip() for name in line.split(separator_of(line))]
    counts = (width, width - 1) if mark == "\t" else (width,)
    by_blanks = [] if mark in line else _NAME.findall(line)
    return mark.join(next((n for n in (by_mark, by_blanks) if len(n) in counts), [line]))


def is_like_number(cell: str) -> bool:
    """Return whether a cell may be a number, with whatever decimal mark, or a time of hh:mm:ss."""
    return _LIKE_NUMBER.fullmatch(cell) is not None
