"""Name pads and tests, and say when tests began: by what the user says, or the files state."""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.files import folder_fault, same_folder, stem_of
from qlvbayes.io.loading import Answers, Loaded, pattern_of
from qlvbayes.io.wording import as_typed, computed, prints

DEFAULT_PAD = "pad"  # the name in a tidy file without the column
_PATTERNS = (r"^(.+?)[ _.-]*\d+$", r"^(.+?)[ _-]+[^ _-]*$", r"^[^ _-]+", r"^.+$")
"""Parts of a test's name that may be its pad's: all before the last number, before the last
separator, before the first separator, or the whole name."""


def pad_name(name: str) -> str:
    """Return a pad's name; an InputError is raised where no folder can have it."""
    if (fault := folder_fault(_checked(name))) is not None:
        raise InputError(f"the pad's name '{name[:200]}' {fault[0]}", remedy=fault[1])
    return name


def with_pads(read: Sequence[Loaded], files: Sequence[Path], answers: Answers) -> list[Loaded]:
    """Return tests with the names of their pads.

    The user states one name for all, one a file, one a test, or a pattern that finds it in the
    names of the tests. Else lines above the tables name it; without one it is ``pad``.
    """
    given = [pad_name(name) for name in answers.pads]
    if answers.pad_from is not None:
        return [replace(one, pad=pad_in(one.named, answers.pad_from)) for one in read]
    if not given:
        spelled: dict[str, str] = {}
        named = []
        for one in read:
            stated = one.recording.stated
            pad = writable(stated.specimen) if stated.specimen else ""
            if not pad or folder_fault(pad) is not None:
                named.append(replace(one, pad=DEFAULT_PAD))
                continue
            pad = spelled.setdefault(same_folder(pad), pad)
            remark = f"the pad is called {pad}, as in '{stated.named}'; --pad states another name"
            named.append(replace(one, pad=pad, findings=(*one.findings, remark)))
        return named
    if len(given) == 1:
        given *= len(read)
    elif len(given) == len(files):
        of_file = dict(zip(files, given, strict=True))
        given = [of_file[one.file] for one in read]
    elif len(given) != len(read):
        called = ", ".join(one.named for one in read)[:200]
        raise InputError(
            f"--pad names {len(given)} pads; the number of files is {len(files)}, that of tests "
            f"{len(read)} ({called})",
            remedy="give one name for all, one a file, or one a test in this order",
        )
    return [replace(one, pad=pad) for one, pad in zip(read, given, strict=True)]


def pad_in(name: str, pattern: re.Pattern[str]) -> str:
    """Return the pad's name in a test's: the pattern's first group, or its whole match."""
    match = pattern.search(name)
    pad = (match[1] if match and match.re.groups else match and match[0]) or ""
    if not pad:
        raise InputError(
            f"the pattern '{pattern.pattern[:200]}' finds nothing in the name '{name}'",
            remedy="write a pattern that every test's name has, as '^[A-Z]+' finds AA in AA1",
        )
    return pad_name(pad)


def suggested_pattern(names: Sequence[str]) -> str:
    """Return a pattern that divides tests by their names among several pads."""
    divided: dict[str, int] = {}
    for text in _PATTERNS:
        pattern = pattern_of(text)
        with contextlib.suppress(InputError):
            divided[text] = len({pad_in(name, pattern) for name in names})
    several = [text for text, pads in divided.items() if pads > 1]
    return next((text for text in several if divided[text] < len(names)), (*several, "")[0])


def remarks_on(
    tests: Sequence[Loaded], names: Sequence[str], files: Sequence[Path]
) -> tuple[str, ...]:
    """Return why tests that are taken as those of one pad may be of several, and how to say it."""
    remarks = []
    for pad in dict.fromkeys(one.pad for one in tests):
        begin, kinds = {}, {}
        for one in reversed(tests):
            if one.pad == pad:
                letters = re.match(r"[^\W\d]\D*", stem_of(one.file))  # up to the first digit
                begin[one.file] = writable(letters[0].strip(" _-.")) if letters else ""
                channels = (one.recording.time, one.recording.way, one.recording.load)
                columns = [f"{c.name} ({c.unit})" if c.unit else c.name for c in channels]
                kinds[one.file] = ", ".join([*columns, one.format.name])
        for what, of in (("names", begin), ("columns or units", kinds)):
            groups = list(dict.fromkeys(of[file] for file in files if file in of))
            if len(groups) < 2:
                continue
            called = groups if what == "names" and all(groups) else []
            own = called or [f"{pad}{k}" for k in range(1, len(groups) + 1)]
            each = [own[groups.index(of[file])] if file in of else pad for file in files]
            remarks.append(
                f"files with different {what} are taken as tests of one pad, {pad} "
                f"({'; '.join(groups[:4])}): if they are several, name the pad of each file with "
                f"--pad {as_typed(','.join(each))}; --pad {as_typed(pad)} says that they are one"
            )
            break
    in_file = Counter(one.file for one in tests if one.pad == DEFAULT_PAD)
    several = [name for one, name in zip(tests, names, strict=True) if in_file[one.file] > 1]
    if several:
        remarks.append(
            f"the tests of one file are taken as those of one pad ({', '.join(several[:6])}): if "
            "they are several specimens, --pad-from REGEX finds the pads' names in the tests', or "
            "--pad names the pad of each test"
        )
    return tuple(remarks)


def names_of(tests: Sequence[Loaded], given: Sequence[str]) -> list[str]:
    """Return a unique name for each test, from those that the user gives, or from the files."""
    if given and len(given) != len(tests):
        called = ", ".join(one.named for one in tests)[:200]
        raise InputError(
            f"--test names {len(given)} tests and there are {len(tests)} ({called})",
            remedy="give one name a test, in this order",
        )
    several = len({one.file for one in tests}) > 1
    names = [_checked(name) for name in given]
    for one in () if given else tests:
        name = one.recording.name
        own = f"{one.file.stem} {name}" if several else name
        names.append(writable(own if name else stem_of(one.file)))
    folders: dict[str, str] = {}
    pairs = Counter((one.pad, name) for one, name in zip(tests, names, strict=True))
    for (pad, name), count in pairs.items():
        if (other := folders.setdefault(same_folder(pad), pad)) != pad:
            what = f"the pads '{other}' and '{pad}' differ in upper and lower case only"
            raise InputError(what, remedy="write one name, or two that differ in more")
        if count > 1:
            what = f"two tests of pad '{pad}' are called '{name}'"
            raise InputError(what, remedy="name them with --test, or the pads with --pad")
    return names


def writable(name: str) -> str:
    """Return a name without characters that a folder's name or a CSV cell must not have."""
    seen = "".join(sign if prints(sign) else "\n" for sign in name)
    plain = re.sub(r'[\\/,;"\n#]+', "-", seen).strip(" .")
    return (plain.lstrip("=@+- .") if computed(plain) else plain) or "test"


def _checked(name: str) -> str:
    if writable(name) != name:
        remedy = f"write it as '{writable(name)}'"
        raise InputError(f"the name {name!r} cannot be used", remedy=remedy)
    return name


def clocks_of(
    read: Sequence[Loaded], firsts: Sequence[int]
) -> tuple[list[float | None], dict[int, str]]:
    """Return the pad's clock at each test's first row, and a note on it by test.

    There is a clock where all tests of a pad state when they began, on days that are clear or the
    same, and none began before the one before had ended, to the second.
    """
    starts: list[float | None] = [None] * len(read)
    notes: dict[int, str] = {}
    for pad in {one.pad for one in read}:
        tests = [k for k, one in enumerate(read) if one.pad == pad]
        stated = {k: read[k].recording.stated for k in tests}
        began = {
            k: one.began + float(read[k].time[firsts[k]])
            for k, one in stated.items()
            if one.began is not None
        }
        if len(tests) < 2 or not began:
            continue
        order = sorted(began, key=lambda k: began[k])
        ends = {k: began[k] + float(read[k].time[-1] - read[k].time[firsts[k]]) for k in began}
        days = {one.either for one in stated.values()}
        why = ""
        if len(began) < len(tests):
            why = "other tests of the pad state none"
        elif len(days) > 1:
            why = f"day and month of {max(days)} may be exchanged"
        elif any(began[after] < ends[before] - 1.0 for before, after in pairwise(order)):
            why = "by their dates the pad's tests overlap"
        for k in began:
            lines = stated[k].dated or "the file"
            notes[k] = (
                f"the date is not used, as {why}" if why else f"start_s is taken from '{lines}'"
            )
            starts[k] = None if why else began[k] - began[order[0]]
    return starts, notes
