"""Convert machine files to tidy tests, name their pads, and write them as one tidy CSV file."""

from __future__ import annotations

import contextlib
import gzip
import io
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.binary import WORKBOOK, of_sheets
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import folder_fault, same_folder, stem_of, write_whole
from qlvbayes.io.formats import Format, known_formats, matching, recognised
from qlvbayes.io.layouts import Layout, stated_layout
from qlvbayes.io.loading import (
    Answers,
    Loaded,
    oriented_tests,
    pattern_of,
    usable_tests,
    without_copies,
)
from qlvbayes.io.readings import LEAST_SAMPLES
from qlvbayes.io.recording import Recording, UnsureError
from qlvbayes.io.text import head_of, is_text
from qlvbayes.io.units import UnitSystem, column_name
from qlvbayes.io.wording import as_typed, computed, of_lines, prints, visible
from qlvbayes.io.zero import with_sliding, with_zeros

DEFAULT_PAD = "pad"  # the name in a tidy file without the column
_PATTERNS = (r"^(.+?)[ _.-]*\d+$", r"^(.+?)[ _-]+[^ _-]*$", r"^[^ _-]+", r"^.+$")
"""Parts of a test's name that may be its pad's: all before the last number, before the last
separator, before the first separator, or the whole name."""
_LEAD = 1.0  # s kept before contact, which show the force's zero and its noise
_FINEST = 1e-10  # last digit written over the largest value, far below any sensor's resolution


@dataclass(frozen=True, eq=False)
class Conversion:
    """All tests of some files, converted to one system of units.

    ``faults`` are the errors of files that could not be used. ``remarks`` say why tests that are
    taken as those of one pad may be of several, where nobody has stated it.
    """

    tests: tuple[Loaded, ...]
    units: UnitSystem
    faults: tuple[InputError, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def notices(self) -> tuple[str, ...]:
        """Return all findings, each a line that begins with the name of its test."""
        lines = []
        for test in self.tests:
            source = f"read as {test.format.machine}"
            first = source if test.file.stem == test.test else f"{test.file.name} {source}"
            lost = [f"dropped: {of_lines(rows, why)}" for why, rows in test.dropped.items()]
            lines += [f"{test.test}: {line}" for line in (first, *test.findings, *lost)]
        return (*self.remarks, *lines)


def in_short(notices: Sequence[str]) -> list[str]:
    """Return lines ``test: what`` for a terminal: what several tests share stands once."""
    lines: dict[str, list[str]] = {}
    for line in notices:
        lines.setdefault(line.partition(": ")[2] or line, []).append(line)
    return [
        same[0] if len(same) == 1 else f"{len(same)} tests: {what}" for what, same in lines.items()
    ]


def convert(
    files: Sequence[Path],
    answers: Answers = Answers(),  # noqa: B008 (frozen)
    kinds: Sequence[Format] | None = None,
    *,
    without_faulty: bool = False,
) -> Conversion:
    """Read machine files and convert them to tidy tests; ``kinds`` are all known by default."""
    kinds = known_formats() if kinds is None else kinds
    faults: dict[Path, InputError] = {}
    loaded: list[Loaded] = []
    for file in files:
        try:
            loaded += usable_tests(file, *_read(file, kinds, answers), answers)
        except InputError as error:
            faults[file] = error
    read: list[Loaded] = []
    for file in dict.fromkeys(one.file for one in loaded):
        try:
            read += oriented_tests([one for one in loaded if one.file == file], loaded, answers)
        except InputError as error:
            faults[file] = error
    # no test may be left out of those that the user names one by one
    one_by_one = bool(answers.tests) or len(answers.pads) not in (0, 1, len(files))
    if not (one_by_one and faults):
        read = _with_pads(read, files, answers)
    read = with_sliding(without_copies(read))
    zeroed = with_zeros(read, answers)
    for one, found in zip(read, zeroed, strict=True):
        if isinstance(found, UnsureError):
            faults.setdefault(one.file, found)
    if faults and (not without_faulty or len(faults) == len(set(files)) or one_by_one):
        raise next(faults[file] for file in files if file in faults)
    kept, firsts = [], []
    for one, found in zip(read, zeroed, strict=True):
        if isinstance(found, Loaded) and one.file not in faults:
            kept.append(found)
            firsts.append(_first_row(found, own=found.contact is one.contact))
    if not kept:
        raise InputError("no test can be used", file=files[0], remedy="look at the file")
    names, units = _names_of(kept, answers.tests), kept[0].units
    clocks, notes = _clocks_of(kept, firsts)
    tidied = [
        _tidied(one, firsts[k], names[k], units, clocks[k], notes.get(k))
        for k, one in enumerate(kept)
    ]
    for pad in {test.pad for test in tidied}:  # by its clock
        places = [k for k, test in enumerate(tidied) if test.pad == pad]
        if all(tidied[k].start_s is not None for k in places):
            own = sorted((tidied[k] for k in places), key=lambda test: test.start_s or 0.0)
            for k, test in zip(places, own, strict=True):
                tidied[k] = test
    stated = answers.pads or answers.pad_from is not None
    remarks = () if stated else _remarks_on(kept, names, files)
    return Conversion(tuple(tidied), units, tuple(faults.values()), remarks)


def _read(
    file: Path, kinds: Sequence[Format], answers: Answers
) -> tuple[Format, Sequence[Recording]]:
    """Return a file's layout and recordings; an error of a format's code becomes an InputError."""
    if answers.columns is None:
        kind = recognised(file, kinds)
        read: Callable[[], Sequence[Recording]] = partial(kind.read, file)
    else:
        head = head_of(file)
        whole = matching(head, kinds)
        own = whole[0] if len(whole) == 1 else None
        kind = stated = stated_layout(
            answers.columns, file, own if isinstance(own, Layout) else None
        )
        read = partial(stated.read, file)
        if own is WORKBOOK:
            read = partial(of_sheets, WORKBOOK.vectors(file), file, stated)
        elif not is_text(head):
            raise InputError("this is no table of text", file=file, remedy="leave --columns out")
    try:
        return kind, read()
    except InputError:
        raise
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        what = f"the file cannot be read as {kind.name} ({text})"
        raise InputError(what, file=file, remedy="export it again") from error


def _first_row(one: Loaded, *, own: bool) -> int:
    """Return the first row that is kept: none is long before the contact that is the test's own."""
    contact = one.contact
    if contact is None or not own:
        return 0
    # where the user states an earlier contact, that one; what rubs has its history from rest on
    until = min(contact.rows, int(np.argmax(one.displacement > one.zero)))
    until = min(until, one.moved) if contact.sliding else until
    first = int(np.searchsorted(one.time, one.time[until] - _LEAD))
    if len(one.time) - first < LEAST_SAMPLES:
        what = f"only {len(one.time) - first} rows are left"
        raise InputError(what, file=one.file, remedy="export the whole test")
    return first


def _tidied(
    one: Loaded,
    first: int,
    name: str,
    units: UnitSystem,
    start: float | None,
    remark: str | None,
) -> Loaded:
    """Return a test with its name and zero, in the units of all tests, from its first row on."""
    if units.dimensionless != one.units.dimensionless:
        raise InputError(
            "this file has strain and stress and others have displacement and force",
            file=one.file,
            remedy="convert them one by one",
        )
    if first:
        one.dropped[f"rows of the approach, more than {_LEAD:g} s before contact"] = first
    way, load = one.displacement[first:] - one.zero, one.force[first:] - one.tare
    sd, tare_sd = one.zero_sd, one.tare_sd
    if units != one.units:
        length, newtons = (one.units.factor_to(units, kind) for kind in ("displacement", "force"))
        way, load, tare_sd = way * length, load * newtons, tare_sd * newtons
        sd = None if sd is None else sd * length
    clock, lag, sampled = one.recording.load_time, one.sampling.lag, one.sampling.describe()
    if clock is not None and lag is not None:
        sampled += (
            f"; two clocks: {clock.name} of the force runs {lag * 1e3:.4g} ms behind "
            f"{one.recording.time.name} row by row; the displacement is brought to the force's "
            "times"
        )
    findings = [*one.findings, sampled, *([remark] if remark else [])]
    if units != one.units:
        way_in, load_in = units.displacement, units.force
        findings.append(f"converted to {way_in} and {load_in}, the units of the first file")
    time = one.time[first:] - one.time[first]
    return replace(
        one, test=name, units=units, time=time, displacement=way, force=load, start_s=start,
        zero_sd=sd, tare_sd=tare_sd, findings=tuple(findings),
    )  # fmt: skip


# Names of pads and tests, and clocks: what the user says, or what the files state


def _pad_name(name: str) -> str:
    """Return a pad's name; an InputError is raised where no folder can have it."""
    if (fault := folder_fault(_checked(name))) is not None:
        raise InputError(f"the pad's name '{name[:200]}' {fault[0]}", remedy=fault[1])
    return name


def _with_pads(read: Sequence[Loaded], files: Sequence[Path], answers: Answers) -> list[Loaded]:
    """Return tests with the names of their pads.

    The user states one name for all, one a file, one a test, or a pattern that finds it in the
    names of the tests. Else lines above the tables name it; without one it is ``pad``.
    """
    given = [_pad_name(name) for name in answers.pads]
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


def _remarks_on(
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


def _names_of(tests: Sequence[Loaded], given: Sequence[str]) -> list[str]:
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


def _clocks_of(
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


# The tidy file


def write_tidy(conversion: Conversion, path: Path) -> None:
    """Write all tests, with the findings as comments above them; whole or not at all."""
    write_csv(tidy_text(conversion), path)


def write_csv(text: bytes, path: Path) -> None:
    """Write the bytes of a .csv file, or of a .csv.gz file compressed; whole or not at all."""
    if not path.name.lower().endswith((".csv", ".csv.gz")):
        remedy = "give a name that ends in .csv or .csv.gz"
        raise InputError("this is no name of a CSV file", file=path, remedy=remedy)
    write_whole(path, gzip.compress(text, mtime=0) if path.suffix.lower() == ".gz" else text)


def tidy_text(conversion: Conversion) -> bytes:
    """Return the bytes of the file; numbers have ten digits at the largest value."""
    units, tests = conversion.units, conversion.tests
    length = "" if units.dimensionless else units.displacement
    # optional columns: the cell of each test
    optional = {
        "start_s": [None if t.start_s is None else f"{t.start_s:.9g}" for t in tests],
        column_name("contact_sd", units.displacement): [
            None if t.zero_sd is None else f"{t.zero_sd:.3g}" for t in tests
        ],
        "contact_stage": [None if t.zero_sd is None else t.contact_stage for t in tests],
        column_name("tare_sd", units.force): [
            f"{t.tare_sd:.3g}" if t.tare_sd else None for t in tests
        ],
        "control": ["force" if t.prescribed_force else None for t in tests],
    }
    optional = {
        name: cells for name, cells in optional.items() if any(c is not None for c in cells)
    }
    names = ["pad", "test", *optional, "time_s", column_name(units.displacement_name, length)]
    names.append(column_name(units.force_name, units.force))
    out = io.BytesIO()
    for line in conversion.notices:
        out.write(f"# {visible(line)}\n".encode())
    out.write((",".join(names) + "\n").encode())
    for k, test in enumerate(tests):
        labels = ",".join([test.pad, test.test, *(cells[k] or "" for cells in optional.values())])
        table = np.stack([test.time, test.displacement, test.force], axis=1)
        decimals = [_decimals(column) for column in table.T]
        line = ",".join([labels.replace("%", "%%"), *(f"%.{d}f" for d in decimals)]) + "\n"
        for block in np.array_split(table, -(-len(table) // 4096)):
            out.write(((line * len(block)) % tuple(block.ravel().tolist())).encode())
    return out.getvalue()


def _decimals(column: Floats) -> int:
    largest = float(np.abs(column).max())
    return int(np.clip(-np.floor(np.log10(largest * _FINEST)), 0, 15)) if largest > 0.0 else 1
