"""Name pads and tests, as the user or the files say."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.escaping import computed, prints
from qlvbayes.io.files import folder_fault, same_folder
from qlvbayes.io.formats.columns import plain_name

_MEAN = re.compile(
    r"\b(mean|average|mittelwert\w*|mittlere?|durchschnitt\w*|moyenn?e?|media|medio|promedio)\b"
)
_MEDIUM = re.compile(r"\b(mittlere?|moyenn?e?|media|medio)\b")  # adjectives of a speed too
_OF_SPECIMENS = re.compile(
    r"specimens?|samples?|proben?\w*|prufling\w*|eprouvettes?|echantillons?|probetas?|muestras?|provin[oi]"
    r"|campion[ei]|curves?|kurven?|courbes?|curv[ae]s?|essais?|prov[ae]|ensayos?|tests?|versuche?"
    r"|values?|werte?|valeurs?|valor\w*|of|de[rsnl]?|di|du|la|le|les|los|las|all\w*|n|\d+|\w{1,3}"
)
_CONDITION = re.compile(
    r"\b(speeds?|velocit\w+|rates?|vitesses?|velocidad\w*|geschwindigkeit\w*|tempo|strain|load|force"
    r"|depth|temperature\w*|pressure)\b"
)
DEFAULT_PAD = "pad"  # the name in a tidy file without the column
_SHOWN = 200  # characters of a name or pattern that an error shows
_PATTERNS = (r"^(.+?)[ _.-]*\d+$", r"^(.+?)[ _-]+[^ _-]*$", r"^[^ _-]+", r"^.+$")
"""Parts of a test's name that may be its pad's: all before the last number, before the last
separator, before the first separator, or the whole name."""


def pads_of(files: Sequence[Path], given: Sequence[str]) -> list[str] | None:
    """Return a pad's name for each file: one for all, one for each, or the default."""
    names = [_pad_name(name) for name in given] or [DEFAULT_PAD]
    if len(names) == 1:
        return names * len(files)
    return names if len(names) == len(files) else None


def pads_of_tests(named: Sequence[str], files: Sequence[Path], given: Sequence[str]) -> list[str]:
    """Return a pad's name for each test, from the tests' names in the files."""
    if len(given) != len(named):
        called = ", ".join(named)[:200]
        raise InputError(
            f"--pad names {len(given)} pads; the number of files is {len(files)}, that of tests "
            f"{len(named)} ({called})",
            remedy="give one name for all, one a file, or one a test in this order",
        )
    return [_pad_name(name) for name in given]


def _pad_name(name: str) -> str:
    """Return a pad's name; an InputError is raised where no folder can have it."""
    if (fault := folder_fault(_checked(name))) is not None:
        raise InputError(f"the pad's name '{name[:200]}' {fault[0]}", remedy=fault[1])
    return name


def pattern_of(text: str) -> re.Pattern[str]:
    """Return the pattern that finds a pad's name in a test's; raise InputError where it is none."""
    try:
        return re.compile(text)
    except (re.error, RecursionError, OverflowError) as error:
        remedy = "write for example '^[A-Z]+', which finds AA in AA1"
        what = f"'{text[:_SHOWN]}' is no pattern of pads' names ({error})"
        raise InputError(what, remedy=remedy) from None


def pad_in(name: str, pattern: re.Pattern[str]) -> str:
    """Return the pad's name in a test's: the pattern's first group, or its whole match."""
    match = pattern.search(name)
    pad = (match[1] if match and match.re.groups else match and match[0]) or ""
    if not pad:
        raise InputError(
            f"the pattern '{pattern.pattern[:_SHOWN]}' finds nothing in the name '{name}'",
            remedy="write a pattern that every test's name has, as '^[A-Z]+' finds AA in AA1",
        )
    return _pad_name(pad)


def suggested_pattern(names: Sequence[str]) -> str:
    """Return a pattern that divides tests by their names among several pads."""
    divided: dict[str, int] = {}
    for text in _PATTERNS:
        pattern = pattern_of(text)
        with contextlib.suppress(InputError):
            divided[text] = len({pad_in(name, pattern) for name in names})
    several = [text for text, pads in divided.items() if pads > 1]
    return next((text for text in several if divided[text] < len(names)), (*several, "")[0])


def is_mean(name: str) -> bool:
    """Return whether a name is that of the mean specimen, no test: 'Eprouvette moyenne'."""
    plain = plain_name(name)
    if _MEAN.search(plain) is None or _CONDITION.search(plain):
        return False
    if _MEAN.search(_MEDIUM.sub(" ", plain)) is not None:
        return True
    return all(_OF_SPECIMENS.fullmatch(word) for word in _MEDIUM.sub(" ", plain).split())


def tests_of(named: Sequence[tuple[str, str, Path]], given: Sequence[str]) -> list[str]:
    """Return a unique name for each test, from (pad, its name in the file, file)."""
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
    _check_folders([pad for pad, _, _ in named])
    pairs = [(pad, name) for (pad, _, _), name in zip(named, names, strict=True)]
    for pad, name in pairs:
        if pairs.count((pad, name)) > 1:
            raise InputError(
                f"two tests of pad '{pad}' are called '{name}'",
                remedy="name them with --test, or the pads with --pad",
            )
    return names


def _check_folders(pads: Iterable[str]) -> None:
    """Raise InputError where some disks would take the folders of two pads for one."""
    folders: dict[str, str] = {}
    for pad in pads:
        if (other := folders.setdefault(same_folder(pad), pad)) != pad:
            what = f"the pads '{other}' and '{pad}' differ in upper and lower case only"
            raise InputError(what, remedy="write one name, or two that differ in more")


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
