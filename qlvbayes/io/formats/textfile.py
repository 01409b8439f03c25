"""Read the text of a machine's file: bytes to lines, and lines to cells and headers."""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.textcells import is_like_number

Header = TypeVar("Header")

_UTF8, _LITTLE, _BIG = b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff"
_HEADER_LINES = 400  # more lines than any header has
MOST_CELLS = 2000  # cells of a line: more than a machine has channels
_MARKS = "\t;|,"
_LEAST_MARKS = 2  # separators of a row of time, displacement and force
_COMMENT = re.compile(rb"(?m)^[ \t]*[#%]+[ \t]*")
_NAME = re.compile(r"[^\s(\[]+(?:\s?[(\[][^)\]]*[)\]])?|[(\[][^)\]]*[)\]]")  # with its unit
SHOWN = 60  # characters of a line that an error shows


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
    """Return the whole text as UTF-8, unzipped, with lines ended by a newline alone."""
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
    """Return the tab, semicolon, bar or comma that separates three cells or more of a line."""
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
    """Return rows in parts, cut where the line of names is repeated, each with its first line."""
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
    """Return a file's text, its first lines, and what ``find`` sees of the header in them."""
    data = content(path)
    lines = Lines.from_bytes(data)
    header = find(lines)
    if header is None:
        raise InputError(lacking, file=path, remedy=remedy)
    return data, lines, header


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
