"""List all layouts, in the order in which they are tried, and read a user's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats import layouts
from qlvbayes.io.formats.binary import BINARY
from qlvbayes.io.formats.format import AbstractFormat, Format
from qlvbayes.io.formats.ros import RosTable
from qlvbayes.io.installed import FORMATS as FORMAT_POINTS
from qlvbayes.io.installed import installed
from qlvbayes.io.usermodule import check_own, own_classes, own_values

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
    RosTable,
    layouts.TWO_CLOCKS,
    layouts.TABLE,
)
"""Every known layout, in the order in which they are tried."""


def known_formats() -> tuple[Format, ...]:
    """Return the package's layouts, then those that installed packages add.

    Their entry points are those of the group ``qlvbayes.formats``.
    """

    def check(kind: Format) -> None:
        if not isinstance(kind, layouts.Layout) and not _is_format(kind):
            raise TypeError("it is no Layout, and no class that extends AbstractFormat")

    known = [kind.name for kind in FORMATS]
    return (*FORMATS, *installed(FORMAT_POINTS, "format", known, check))


def _is_format(kind: object) -> bool:
    whole = isinstance(kind, type) and issubclass(kind, AbstractFormat)
    return whole and not getattr(kind, "__abstractmethods__", None)


def own_formats(path: Path) -> tuple[Format, ...]:
    """Return the layouts that a Python file defines: classes first, then rows as those here."""
    kinds = own_classes(path, AbstractFormat, "formats")  # type: ignore[type-abstract]
    rows: Sequence[layouts.Layout] = own_values(path, layouts.Layout)
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
