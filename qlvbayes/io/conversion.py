"""Convert machine files to tidy tests, name their pads, and write them as one tidy CSV file."""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.binary import WORKBOOK, of_sheets
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import write_whole
from qlvbayes.io.formats import Format, known_formats, matching, recognised
from qlvbayes.io.layouts import Layout, stated_layout
from qlvbayes.io.loading import (
    Answers,
    Loaded,
    oriented_tests,
    usable_tests,
    without_copies,
)
from qlvbayes.io.naming import clocks_of, names_of, remarks_on, with_pads
from qlvbayes.io.readings import LEAST_SAMPLES
from qlvbayes.io.recording import Recording, UnsureError
from qlvbayes.io.text import head_of, is_text
from qlvbayes.io.units import UnitSystem, column_name
from qlvbayes.io.wording import of_lines, visible
from qlvbayes.io.zero import with_sliding, with_zeros

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
        read = with_pads(read, files, answers)
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
    names, units = names_of(kept, answers.tests), kept[0].units
    clocks, notes = clocks_of(kept, firsts)
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
    remarks = () if stated else remarks_on(kept, names, files)
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
