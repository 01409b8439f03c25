"""Name pads and tests, as the user or the files say."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.escaping import computed, prints
from qlvbayes.io.files import folder_fault
from qlvbayes.io.formats.columns import plain_name

_MEAN = re.compile(
    r"\b(mean|average|mittelwert\w*|mittlere?|durchschnitt\w*|moyenn?e?|media|medio|promedio)\b"
)
_PAD = "pad"  # the name in a tidy file without the column


def pads_of(files: Sequence[Path], given: Sequence[str]) -> list[str]:
    """Return a pad's name for each file: one for all, one for each, or the default."""
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


def pad_in(name: str, pattern: re.Pattern[str]) -> str:
    """Return the pad's name in a test's: the pattern's first group, or its whole match.

    An InputError is raised where the pattern matches nothing.
    """
    match = pattern.search(name)
    pad = (match[1] if match and match.re.groups else match and match[0]) or ""
    if not pad:
        raise InputError(
            f"--pad-from {pattern.pattern!r} finds nothing in the name '{name}'",
            remedy="write a pattern that every test's name has, as '^[A-Z]+' finds AA in AA1",
        )
    if (fault := folder_fault(_checked(pad))) is not None:
        raise InputError(f"the pad's name '{pad[:200]}' {fault[0]}", remedy=fault[1])
    return pad


def is_mean(name: str) -> bool:
    """Return whether a name is that of the mean specimen, no test: 'Eprouvette moyenne'."""
    return _MEAN.search(plain_name(name)) is not None


def tests_of(named: Sequence[tuple[str, str, Path]], given: Sequence[str]) -> list[str]:
    """Return a unique name for each test, from (pad, its name in the file, file).

    An InputError is raised where --test gives another number of names, or two tests have one name.
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
        names = [_plain(_test_name(name, file, several)) for _, name, file in named]
    pairs = [(pad, name) for (pad, _, _), name in zip(named, names, strict=True)]
    for pad, name in pairs:
        if pairs.count((pad, name)) > 1:
            raise InputError(
                f"two tests of pad '{pad}' are called '{name}'",
                remedy="name them with --test, or the pads with --pad",
            )
    return names


def _test_name(name: str, file: Path, several: bool) -> str:
    if not name:
        return file.name.removesuffix(".gz").rpartition(".")[0] or file.name
    return f"{file.stem} {name}" if several else name


def _plain(name: str) -> str:
    """Return a name without characters that a folder's name or a CSV cell must not have."""
    seen = "".join(sign if prints(sign) else "\n" for sign in name)
    plain = re.sub(r'[\\/,;"\n#]+', "-", seen).strip(" .")
    return (plain.lstrip("=@+- .") if computed(plain) else plain) or "test"


def _checked(name: str) -> str:
    if _plain(name) != name:
        remedy = f"write it as '{_plain(name)}'"
        raise InputError(f"the name {name!r} cannot be used", remedy=remedy)
    return name
