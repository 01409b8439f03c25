"""Read the text of a measurement file, plain or gzip, checked, in blocks of whole lines."""

from __future__ import annotations

import gzip
import hashlib
import re
import zlib
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from qlvbayes.io.checks import InputError

BLOCK = 1 << 22
HEAD = 1 << 19

_BOM = b"\xef\xbb\xbf"
_GZIP = b"\x1f\x8b"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
OLD_OFFICE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"  # begins all Office files before 2007
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")
_SAVE = "save the file as UTF-8 text"
_EXPORT = "export the measurements as CSV text"


class OldWorkbookError(InputError):
    """Exception for a workbook of a kind that no reader here knows."""

    def __init__(self, path: Path) -> None:
        what = "this is an Excel workbook of the old kind (.xls)"
        super().__init__(what, file=path, remedy="open it and save it as .xlsx or CSV")


def digest(path: Path) -> str:
    """Return the SHA-256 of the file's bytes on the disk."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise unreadable(path, error) from error


@contextmanager
def unchanged(path: Path) -> Generator[None, None, None]:
    """Refuse a file that is being written: any fault found in it may be half a row."""
    before = _state(path)
    try:
        yield
    except InputError as error:
        _compare(path, before, error)
        raise
    _compare(path, before, None)


def _state(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except OSError:  # opening it gives the reason
        return None
    return status.st_size, status.st_mtime_ns


def _compare(path: Path, before: tuple[int, int] | None, error: InputError | None) -> None:
    if before is not None and _state(path) != before:
        remedy = "wait until it is written and try again"
        raise InputError("the file changed while it was read", file=path, remedy=remedy) from error


def blocks(path: Path, size: int = BLOCK) -> Generator[bytes, None, None]:
    r"""Yield the text in blocks of whole lines: UTF-8 without byte order mark, ended by \n."""
    with _open(path) as stream:
        data = _read(path, stream, size)
        _check_head(path, data[:HEAD])
        data = data.removeprefix(_BOM)
        line = 1
        while more := _read(path, stream, size):
            cut = _last_line_end(data)
            if not cut and len(data) > size:
                raise InputError("the line does not end", file=path, line=line, remedy=_EXPORT)
            if cut:
                block = _checked(path, data[:cut], line)
                line += block.count(b"\n")
                yield block
            data = data[cut:] + more
        if data:
            yield _checked(path, data, line)


def head(path: Path) -> bytes:
    """Return the first lines of the file (half a megabyte), as `blocks` gives them."""
    with closing(blocks(path, HEAD)) as first:
        return next(first, b"")


def _open(path: Path) -> BinaryIO:
    try:
        raw = path.open("rb")
    except OSError as error:
        raise unreadable(path, error) from error
    zipped = raw.read(2) == _GZIP
    raw.seek(0)
    named = path.suffix.lower() == ".gz"
    if zipped and named:
        raw.close()
        return cast(BinaryIO, gzip.open(path, "rb"))
    if zipped or named:
        raw.close()
        raise _misnamed(path, zipped)
    return raw


def _misnamed(path: Path, zipped: bool) -> InputError:
    if not zipped and path.stat().st_size == 0:
        return InputError("the file is empty", file=path, remedy="export the measurements again")
    if zipped:
        text, name = "the content is gzip though the name does not say so", f"{path.name}.gz"
    else:
        text, name = "the content is not gzip though the name says so", path.stem
    return InputError(text, file=path, remedy=f"rename it to {name}")


def cut_gzip(path: Path) -> InputError:
    """Return the error of a zipped file that does not end as it should."""
    remedy = "copy or compress it again"
    return InputError("the gzip data are cut off or damaged", file=path, remedy=remedy)


def unreadable(path: Path, error: OSError) -> InputError:
    """Return the error of a file that the system does not let read."""
    if path.is_dir():
        return InputError("this is a folder", file=path, remedy="name the files in it")
    if isinstance(error, FileNotFoundError):
        return InputError("no such file", file=path, remedy="check the path")
    return InputError(
        f"cannot be read ({error.strerror or error})", file=path, remedy="check its permissions"
    )


def _read(path: Path, stream: BinaryIO, size: int) -> bytes:
    try:
        return stream.read(size)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise cut_gzip(path) from error
    except OSError as error:
        raise unreadable(path, error) from error


def _check_head(path: Path, data: bytes) -> None:
    start = data[:64]
    if start[:2] in _UTF16 or (len(start) > 3 and (not any(start[::2]) or not any(start[1::2]))):
        raise InputError("the text is UTF-16", file=path, remedy=_SAVE)
    if data.startswith(OLD_OFFICE):
        raise OldWorkbookError(path)
    if _CONTROL.search(data):
        raise InputError("this is binary, not text", file=path, remedy=_EXPORT)
    if not data.removeprefix(_BOM).strip():
        raise InputError("the file is empty", file=path, remedy="export the measurements again")


def _last_line_end(data: bytes) -> int:
    r"""Return the length up to the last line end."""
    return data.rfind(b"\n") + 1 or data.rfind(b"\r", 0, len(data) - 1) + 1


def _checked(path: Path, block: bytes, line: int) -> bytes:
    if b"\r" in block:
        block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not block.endswith(b"\n"):
        block += b"\n"
    if b"\0" in block:
        at = line + block.count(b"\n", 0, block.index(b"\0"))
        raise InputError("the line has binary zeros", file=path, line=at, remedy=_EXPORT)
    if not block.isascii():
        _check_utf8(path, block, line)
    return block


def _check_utf8(path: Path, block: bytes, line: int) -> None:
    try:
        block.decode("utf-8")
    except UnicodeDecodeError as error:
        at = line + block.count(b"\n", 0, error.start)
        raise InputError("the text is not UTF-8", file=path, line=at, remedy=_SAVE) from error
