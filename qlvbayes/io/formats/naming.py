"""Names of pads and tests, from the user or from the files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.escaping import computed, prints
from qlvbayes.io.files import folder_fault

_PAD = "pad"  # as in a tidy file without the column


def pads_of(files: Sequence[Path], given: Sequence[str]) -> list[str]:
    """A pad's name for each file: one for all, one a file, or the usual one."""
    names = [_checked(name) for name in given] or [_PAD]
    for name in names:
        if (fault := folder_fault(name)) is not None:
            raise InputError(f"the pad's name '{name[:200]}' {fault[0]}", remedy=fault[1])
    if len(names) == 1:
        return names * len(files)
    if len(names) != len(files):
        raise InputError(
            f"--pad names {len(names)} pads and there are {len(files)} files",
            remedy="give one name for all, or one a file",
        )
    return names


def tests_of(named: Sequence[tuple[str, str, Path]], given: Sequence[str]) -> list[str]:
    """A name for each test, from (pad, what the file calls it, file); unique within a pad.

    Raises InputError where --test gives another number of names, or two tests are called the same.
    """
    if given:
        if len(given) != len(named):
            called = ", ".join(name or file.stem for _, name, file in named)
            raise InputError(
                f"--test names {len(given)} tests and there are {len(named)} ({called[:200]})",
                remedy="give one name a test, in this order",
            )
        names = [_checked(name) for name in given]
    else:
        several = len({file for _, _, file in named}) > 1
        names = [_plain(_of_file(name, file, several)) for _, name, file in named]
    pairs = [(pad, name) for (pad, _, _), name in zip(named, names, strict=True)]
    for pad, name in pairs:
        if pairs.count((pad, name)) > 1:
            raise InputError(
                f"two tests of pad '{pad}' are called '{name}'",
                remedy="name them with --test, or the pads with --pad",
            )
    return names


def _of_file(name: str, file: Path, several: bool) -> str:
    if not name:
        return file.name.removesuffix(".gz").rpartition(".")[0] or file.name
    return f"{file.stem} {name}" if several else name


def _plain(name: str) -> str:
    """Without what a name of a folder or a cell of a CSV file must not have."""
    seen = "".join(sign if prints(sign) else "\n" for sign in name)
    plain = re.sub(r'[\\/,;"\n#]+', "-", seen).strip(" .")
    return (plain.lstrip("=@+- .") if computed(plain) else plain) or "test"


def _checked(name: str) -> str:
    if _plain(name) != name:
        remedy = f"write it as '{_plain(name)}'"
        raise InputError(f"the name {name!r} cannot be used", remedy=remedy)
    return name
