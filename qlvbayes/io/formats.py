"""List the formats of files, recognise the one of a file, and check the rules of a format."""

from __future__ import annotations

import inspect
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from qlvbayes.io import layouts
from qlvbayes.io.binary import BINARY, Binary
from qlvbayes.io.catalogue import (
    FORMAT_POINTS,
    Check,
    check_own,
    installed,
    own_classes,
    own_module,
    run_checks,
)
from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import (
    LABELS,
    NamedColumn,
    in_cells,
    is_tidy_name,
    measured,
    plain_name,
    quantities,
    unsure_of_columns,
)
from qlvbayes.io.header import columns_in
from qlvbayes.io.layouts import Layout
from qlvbayes.io.recording import (
    AbstractFormat,
    Channel,
    Recording,
    Sight,
)
from qlvbayes.io.splitting import LEAST
from qlvbayes.io.table import parse_number
from qlvbayes.io.text import (
    COMMENT,
    HEAD,
    Lines,
    decoded,
    head_of,
    is_like_number,
    is_text,
    with_tabs,
)
from qlvbayes.io.tidy import sniff
from qlvbayes.io.units import QUANTITIES, unit_of
from qlvbayes.io.wording import joined

__all__ = [
    "FORMATS", "AbstractFormat", "Channel", "FormatError", "Layout", "Recording", "Sight",
    "check_format", "format_checks",
]  # fmt: skip
Format = Layout | Binary | type[AbstractFormat]
"""Reader of files of one layout: a row of a table, or a class of a user's own."""
FORMATS: tuple[Format, ...] = (
    layouts.BLUEHILL_3,
    layouts.BLUEHILL_UNIVERSAL,
    layouts.WINTEST,
    layouts.TESTSUITE,
    layouts.TESTXPERT,
    layouts.CELLSCALE,
    layouts.MACH_1,
    layouts.CHIARO,
    layouts.LVM,
    *BINARY,
    layouts.TWO_CLOCKS,
    layouts.TABLE,
)
"""Every known layout, in the order in which they are tried."""
_COMPUTED = re.compile(
    r"[gek] ?(t|relax\w*)|j( ?t| creep)?|((relaxation|storage|loss|complex|dynamic|creep) )?"
    r"(modulus|compliance)|(relaxations|speicher|verlust)modul|(kriech)?nachgiebigkeit"
    r"|(module|modulo|complaisance|cedevolezza|complianza|compliancia)"
    r"( (de|di|en|a|conservativo|dissipativo|complexe).*)?"
)
"""Simplified names of what programs compute of measurements: moduli and compliances."""
_UNIT = re.compile(r"\s*[\[(][^\[\]()]{2,}[\])]$|[_ ](1/)?[kMG]?Pa$")  # (t) of G(t) is no unit
_HEADER = 60  # lines among which the names of columns are
_RISES = 0.8  # share of a column's rows that rise from the row before, at least, where it is a time


def known_formats() -> tuple[Format, ...]:
    """Return the package's layouts, then those that installed packages add.

    Their entry points are those of the group ``qlvbayes.formats``.
    """

    def check(kind: Format) -> None:
        whole = isinstance(kind, type) and issubclass(kind, AbstractFormat)
        if not isinstance(kind, Layout) and (not whole or inspect.isabstract(kind)):
            raise TypeError("it is no Layout, and no class that extends AbstractFormat")

    known = [kind.name for kind in FORMATS]
    return (*FORMATS, *installed(FORMAT_POINTS, "format", known, check))


def own_formats(path: Path) -> tuple[Format, ...]:
    """Return the layouts that a Python file defines: classes first, then rows as those here."""
    kinds = own_classes(path, AbstractFormat, "formats")  # type: ignore[type-abstract]
    rows = [row for row in vars(own_module(path, "formats")).values() if isinstance(row, Layout)]
    if not kinds and not rows:
        remedy = "write a Layout, or a class that extends AbstractFormat"
        raise InputError("defines no format", file=path, remedy=remedy)
    known = [kind.name for kind in FORMATS]
    check_own(path, kinds, AbstractFormat, "format", known)
    for row in rows:
        if row.name in (*known, *(kind.name for kind in kinds)):
            what = f"the format {row.name} comes with the package, or is in this file already"
            raise InputError(what, file=path, remedy="choose another name")
    return (*kinds, *rows)


def matching(head: bytes, kinds: Sequence[Format]) -> list[Format]:
    """Return the formats whose marks are all there; general ones only where no other fits."""
    fitting = [kind for kind in kinds if kind.sniff(head).whole]
    return [kind for kind in fitting if not kind.general] or fitting


def recognised(path: Path, kinds: Sequence[Format]) -> Format:
    """Return the one format of a file."""
    head = head_of(path)
    if not head.strip(b"\0 \t\r\n"):
        raise InputError("the file is empty", file=path, remedy="export the measurements again")
    whole = matching(head, kinds)
    if len(whole) == 1:
        return whole[0]
    if whole:
        names = joined([kind.name for kind in whole])
        raise InputError(
            f"the layouts {names} all fit", file=path, remedy="export it in another way"
        )
    if is_text(head) and refuse_by_content(head, path, unnamed=True):
        sniff(path)  # its error says which column is to be renamed
        raise InputError(
            "the file is tidy already",
            file=path,
            remedy="give it to fit, diagnose or study, or state --columns to convert it anew",
        )
    raise InputError(
        "no known layout",
        file=path,
        remedy="export CSV with time_s, displacement_mm, force_N, state --columns, or describe the "
        "layout with --formats-file",
    )


def refuse_by_content(head: bytes, path: Path, *, unnamed: bool = False) -> bool:
    """Raise InputError for what a table that is not tidy holds in place of measurements, or lacks.

    A file whose first line has names of a tidy one is left to the reader of those, which is
    returned, and so is one that begins with numbers, unless the columns of ``unnamed`` tables are
    asked for too.
    """
    whole = head if len(head) < HEAD else head.rpartition(b"\n")[0]
    lines = Lines.from_bytes(with_tabs(decoded(whole).encode())[0])
    for _, cells in islice(lines.cells(), _HEADER):
        results = (c for c in cells if _COMPUTED.fullmatch(plain_name(_UNIT.sub("", c))))
        found = next(results, None) if len(cells) > 1 else None
        if found is not None and not {"force", "stress"} & set(quantities(in_cells(cells))):
            raise InputError(
                f"'{found}' is computed of measurements: the file has no displacement (or strain) "
                "and no force (or stress) of a test, which this program fits",
                file=path,
                remedy="export the readings, strain and stress over time",
            )
    columns = columns_in(lines)
    if (line := _line_without_time(lines, columns)) is not None:
        raise InputError(
            "there is no time: no column rises from row to row as one does (the file has: "
            f"{', '.join(column.written for column in columns)[:200]})",
            file=path,
            line=line,
            remedy="export the time of every sample",
        )
    rows = (t for t in decoded(head).splitlines() if t.strip() and not COMMENT.match(t))
    row = next((t for t in rows if not t.startswith("sep=")), "")
    names = [name.strip(' "') for name in re.split(r"[,;\t| ]", row)]
    tidy = any(is_tidy_name(name) for name in names if name not in LABELS)
    named = unnamed or sum(map(is_like_number, names)) < 2
    a_table = len(columns) > 2 or any(measured(columns).values())
    if a_table and named and not tidy:
        raise unsure_of_columns(columns, path)
    return tidy


def _line_without_time(lines: Lines, columns: Sequence[NamedColumn]) -> int | None:
    """Return the first line of rows of which no column rises as a time does; None if one does."""
    rows = [(n, row) for n, row in lines.cells() if len(row) > 2 and all(map(is_like_number, row))]
    if len(rows) <= LEAST or len({len(row) for _, row in rows}) > 1:
        return None
    numbers = [[parse_number(c.replace(",", "."), ".") for c in row] for _, row in rows]
    steps = np.diff(np.array(numbers, dtype=np.float64), axis=0)  # a clock of hh:mm:ss is NaN
    rising = np.count_nonzero(~(steps <= 0.0), axis=0) >= _RISES * len(steps)
    for k, column in enumerate(columns[: len(rising)]):  # one in mm or N is no time
        words = re.split(r"[\s_,/()\[\]]+", column.written)
        kinds = ("displacement", "force", "stress")
        rising[k] &= not any(unit_of(word, kind) for word in words if word for kind in kinds)
    return None if rising.any() else rows[0][0] + 1


# The rules of a format

_TIDY = b"pad,test,time_s,displacement_mm,force_N\nB,slow,0,0,0.01\nB,slow,0.01,0.02,0.03\n"


class FormatError(AssertionError):
    """Exception for a format that breaks a rule; the text says which rule."""


def check_format(kind: Format, files: Sequence[str | Path]) -> None:
    """Check that a format keeps the rules, on files of its own (two or more different ones).

    The format declares itself. It recognises its own files and no tidy file, and no other format
    claims them. It looks at any bytes without an error. It reads columns of one length with finite
    numbers, one for each quantity. From a file that is cut, has NULs or a byte order mark, or is
    UTF-16, it gives tests or an InputError and nothing else. A FormatError has a line for each rule
    that is broken.

    Parameters
    ----------
    kind, files
        The format's class; two or more files of it.
    """
    run_checks(format_checks(kind, files), FormatError)


def format_checks(kind: Format, files: Sequence[str | Path]) -> Iterator[Check]:
    """Yield name and function of each check of `check_format`, so that each is its own test.

    Parameters
    ----------
    kind, files
        As there: ``@pytest.mark.parametrize(("name", "check"), format_checks(MyFormat, FILES))``.
    """
    yield "declarations", partial(_check_declarations, kind, files)
    for name, rule in _RULES.items():
        for file in map(Path, files):
            yield f"{name}, {file.name}", partial(rule, kind, file)
    yield "tidy file", partial(_check_tidy, kind)


def _check_tidy(kind: Format) -> None:
    if kind.sniff(_TIDY).whole:
        raise FormatError(f"{kind.name} claims a tidy file")


def _check_declarations(kind: Format, files: Sequence[str | Path]) -> None:
    called = getattr(kind, "__name__", None) or kind.name
    if inspect.isabstract(kind):
        missing = ", ".join(sorted(getattr(kind, "__abstractmethods__", ())))
        raise FormatError(f"{called} lacks {missing}")
    for word in ("name", "machine", "reference"):
        text = getattr(kind, word, "")
        if not text.strip() or "\n" in text:
            raise FormatError(f"{called}: {word} must be one line of text")
    if len(files) < 2:
        raise FormatError(f"{kind.name}: give two files or more, of different tests or machines")


def _check_known(kind: Format, file: Path) -> None:
    head = file.read_bytes()[:HEAD]
    if not (sight := kind.sniff(head)).whole:
        missing = ", ".join(sight.missing)
        raise FormatError(f"{kind.name} does not know its own file {file.name}: no {missing}")
    others = [o for o in FORMATS if o is not kind and (kind.general or not o.general)]
    if claim := [other.name for other in others if other.sniff(head).whole]:
        raise FormatError(f"{kind.name}: {', '.join(claim)} claims {file.name} too")


def _check_recordings(kind: Format, file: Path) -> None:
    for recording in kind.read(file):
        channels = (recording.time, recording.way, recording.load)
        for channel, words in zip(channels, QUANTITIES, strict=True):
            what = f"{kind.name}, {file.name}: '{channel.name}' is"
            if channel.quantity not in words:
                raise FormatError(f"{what} {channel.quantity}, not {' or '.join(words)}")
            values = np.asarray(channel.values)
            if values.dtype != np.float64 or values.ndim != 1 or not np.isfinite(values).all():
                raise FormatError(f"{what} not (n,) of finite float64")


def _check_damage(kind: Format, file: Path) -> None:
    data, half = file.read_bytes(), file.stat().st_size // 2
    damaged = {f"cut to {s:.1%}": data[: int(s * len(data))] for s in (0.999, 0.97, 0.7, 0.3, 0.05)}
    damaged |= {"with NULs": data[:half] + bytes(9) + data[half:], "with nothing in it": b""}
    damaged |= {"with a byte order mark": b"\xef\xbb\xbf" + data}
    damaged |= {"as UTF-16": data.decode("latin-1").encode("utf-16")}
    with tempfile.TemporaryDirectory() as folder:
        hurt = Path(folder) / file.name
        for what, some in damaged.items():
            hurt.write_bytes(some)
            try:
                kind.sniff(some[:HEAD])
                kind.read(hurt)
            except InputError:
                continue
            except Exception as error:
                text = f"{type(error).__name__}: {error}"[:200]
                raise FormatError(
                    f"{kind.name}: reading {file.name} {what} ends in {text}"
                ) from error


_RULES: dict[str, Callable[[Format, Path], None]] = {
    "known": _check_known,
    "recordings": _check_recordings,
    "damaged": _check_damage,
}
