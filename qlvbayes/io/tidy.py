"""Find how a tidy file is written: its header line, separator, decimal mark, columns and units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import LABELS, in_cells, is_tidy_name, quantities, split_name
from qlvbayes.io.files import stem_of
from qlvbayes.io.table import EXPORT, THOUSANDS
from qlvbayes.io.text import (
    COMMENT,
    HEAD,
    cells_of,
    content,
    decoded,
    head_of,
    is_like_number,
    is_text,
    names_above,
)
from qlvbayes.io.units import (
    PAD,
    SAME,
    STRAIN,
    SUFFIXES,
    UnitRatio,
    UnitSystem,
    column_name,
    unit_system,
)
from qlvbayes.io.wording import as_typed

_HEAD = 1 << 19  # bytes in which the header stands, below the comments of a conversion
_SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}
_SEPARATOR_LINE = re.compile(r'"?sep=([,;\t])"?', re.IGNORECASE)
_FRACTION = re.compile(r"[+-]?\d*([.,])\d+([eE][+-]?\d+)?")
_TWICE = ("displacement", "force", "strain", "stress")  # what may stand there in two units
_COUNTERPART = {"strain": "displacement", "stress": "force"}
_COUNTERPART |= {other: one for one, other in _COUNTERPART.items()}


@dataclass(frozen=True)
class Column:
    """A column: its index, its name in the file, its unit, and a scale.

    ``scale`` converts to the unit of the displacement column for displacement and rate, to that of
    the force column for force and its sd, and to s for time.
    """

    index: int
    name: str
    suffix: str = ""
    scale: UnitRatio = SAME


@dataclass(frozen=True)
class Dialect:
    """Form of a tidy file: columns that are read and their units, separator, decimal mark, header.

    ``numeric`` are time, displacement, force and force_sd. ``ignored`` are other columns of the
    ``names``; ``line`` is that of the header.
    """

    units: UnitSystem
    numeric: dict[str, Column]
    labels: dict[str, Column]
    ignored: tuple[str, ...]
    names: Sequence[str]
    separator: str
    decimal: str
    line: int

    @property
    def notice(self) -> str | None:
        """Return a notice where the file does not have comma and decimal point; None otherwise."""
        if self.separator == "," and self.decimal == ".":
            return None
        mark = "decimal point" if self.decimal == "." else "decimal comma"
        return f"read as {_SEPARATORS[self.separator]}-separated values with {mark}"


def sniff(path: Path) -> Dialect:
    """Read the header and find out how the rows are written."""
    head = head_of(path, _HEAD)
    if not is_text(head[:HEAD]):
        remedy = "export the measurements as CSV text"
        raise InputError("this is binary, not text", file=path, remedy=remedy)
    text_of_head = decoded(head)
    if b"\0" in head and 2 * len(text_of_head) > 1.5 * len(head):  # and no UTF-16
        line = head.count(b"\n", 0, head.index(b"\0")) + 1
        raise InputError("the line has binary zeros", file=path, line=line, remedy=EXPORT)
    lines = text_of_head.split("\n")
    rows = ((n, t) for n, t in enumerate(lines, 1) if t.strip() and not COMMENT.match(t))
    written = list(islice(rows, 2))
    if not written:
        what = "there are only comments" if "#" in lines[0] else "the file is empty"
        raise InputError(what, file=path, remedy=EXPORT)
    stated = _SEPARATOR_LINE.fullmatch(written[0][1].strip())  # Excel's own line
    if stated and len(written) > 1:
        written = [written[1], *islice(rows, 1)]
    line, text = written[0]
    separator = stated[1] if stated else max(_SEPARATORS, key=text.count)
    names = cells_of(text, separator)
    if all(map(is_like_number, names)) and line > 1:  # the names are in the comment above
        over = names_above(COMMENT.sub("", lines[line - 2]), separator, len(names))
        if any(map(is_tidy_name, cells_of(over, separator))):
            names, line, written = cells_of(over, separator), line - 1, [*written[:1], *written]
    units, numeric, labels = _columns(names, path, line)
    if len(written) == 1:
        raise InputError("there are no rows below the header", file=path, line=line, remedy=EXPORT)
    used = {column.index for column in (*numeric.values(), *labels.values())}
    ignored = tuple(name for i, name in enumerate(names) if i not in used and name)
    below = (cells_of(row, separator) for _, row in chain(written[1:], rows))
    numbers = (row[c.index] for row in below for c in numeric.values() if c.index < len(row))
    # "1,234" in a comma-separated file may well be a thousand
    plain = (x for x in numbers if separator != "," or not THOUSANDS.fullmatch(x))
    decimal = next((match[1] for cell in plain if (match := _FRACTION.fullmatch(cell))), ".")
    return Dialect(units, numeric, labels, ignored, names, separator, decimal, line)


def _columns(
    names: Sequence[str], file: Path, line: int
) -> tuple[UnitSystem, dict[str, Column], dict[str, Column]]:
    """Return the file's own units, and the columns of numbers and of labels."""
    fail = partial(InputError, file=file, line=line)
    if sum(map(is_like_number, names)) > 1:
        remedy = "add a header line such as time_s,displacement_mm,force_N, or say which columns "
        remedy += "they are, as --columns 1,2,3 --units s,mm,N"
        raise fail("the first line has numbers, not column names", remedy=remedy)
    found: dict[str, Column] = {}
    unknown: list[tuple[str, str, str]] = []
    for index, name in enumerate(names):
        quantity, suffix = split_name(name) or ("", "")
        scales = SUFFIXES.get(quantity, {"": SAME})
        if quantity and suffix not in scales:
            unknown.append((quantity, suffix, name))
        elif quantity:
            if quantity in _TWICE and quantity in found and found[quantity].suffix != suffix:
                quantity += " 2"
            if quantity in found:
                both = f"'{found[quantity].name}' and '{name}'"
                raise fail(f"two columns for {quantity}: {both}", remedy="delete one of them")
            found[quantity] = Column(index, name, suffix, scales[suffix])
    for quantity, suffix, name in unknown:
        if quantity not in found and _COUNTERPART.get(quantity) not in found:  # no force_raw
            what = f"the unit '{suffix}' of '{name}' is unknown" if suffix else (
                f"'{name}' has no unit"
            )  # fmt: skip
            remedy = f"rename it to {_spelled(quantity)} and convert its values to that unit"
            raise fail(what, remedy=remedy)
    kind, other = (STRAIN, PAD) if {"strain", "stress"} & set(found) else (PAD, STRAIN)
    alien = [other.displacement_name, other.force_name, f"{other.force_name}_sd"]
    if "rate" in found and (found["rate"].suffix == "1_s") != (kind is STRAIN):
        alien.append("rate")
    if wrong := [found[key].name for key in alien if key in found]:
        what = f"'{wrong[0]}' does not go with {kind.displacement_name} and {kind.force_name}"
        remedy = "give displacement, force and rate_mm_s, or strain, stress and rate_1_s"
        raise fail(what, remedy=remedy)
    keys = {"time": "time", "displacement": kind.displacement_name, "force": kind.force_name}
    if missing := [key for key in keys.values() if key not in found]:
        what = f"no column for {' and '.join(missing)} (the file has: {', '.join(names)[:200]})"
        raise fail(what, remedy=_remedy(missing, names, file))
    keys["force_sd"] = f"{kind.force_name}_sd"
    keys |= {f"{key} 2": f"{keys[key]} 2" for key in ("displacement", "force")}
    way, load = found[keys["displacement"]], found[keys["force"]]
    own = dict.fromkeys(("displacement", "displacement 2", "rate", "contact_sd"), way.scale)
    own |= dict.fromkeys(("force", "force 2", "force_sd", "tare_sd"), load.scale)
    declared = (*LABELS, "rate", "start", "contact_sd", "tare_sd")
    keys |= dict(zip(declared, declared, strict=True))
    scaled = {
        key: replace(column, scale=column.scale.over(own.get(key, SAME)))
        for key, name in keys.items()
        if (column := found.get(name)) is not None
    }
    labels = {key: scaled.pop(key) for key in declared if key in scaled}
    system = unit_system("1" if kind is STRAIN else way.suffix, load.suffix)
    return system, scaled, labels


def _remedy(missing: Sequence[str], names: Sequence[str], file: Path) -> str:
    """Return how columns that lack are named, where others mean them, or how they are stated."""
    if len(names) == 1:
        typed = as_typed("qlvbayes", "look", str(file), "-o", "tidy.csv")
        return f"separate the columns by commas; of a machine's file, {typed} says what it lacks"
    meant = {key: column for key, column in quantities(in_cells(names)).items() if key in missing}
    remedies = [
        f"rename '{names[one.index]}' to "
        + (column_name(key, one.unit) if one.unit in SUFFIXES[key] else _spelled(key))
        for key, one in meant.items()
    ]
    if len(meant) < len(missing):
        wanted = (column_name(key, next(iter(SUFFIXES[key]))) for key in missing)
        remedies.append(f"the columns needed are {', '.join(wanted)}")
    if len(names) > 2:
        typed = as_typed("qlvbayes", "look", str(file))
        remedies.append(f"or name three of them: {typed} --columns T,X,F -o tidy.csv")
    return "; ".join(remedies)


def _spelled(quantity: str) -> str:
    return " or ".join(column_name(quantity, suffix) for suffix in SUFFIXES[quantity])


def joined(files: Sequence[Path], pad: str) -> bytes:
    """Return one tidy file of several that hold a test each: the tests of one pad.

    Their rows stay as they are, below one header and behind the pad and a test's name, that of its
    file. InputError if a file names its pads or tests, or has other columns than the first.
    """
    lines, first = [], sniff(files[0])
    lines.append(first.separator.join(["pad", "test", *first.names]))
    for file in files:
        dialect = sniff(file)
        rows = content(file).decode().split("\n")[dialect.line :]
        if {"pad", "test"} & set(dialect.labels):
            remedy = "leave it out: its tests have a pad"
            raise InputError("it names its pads or tests itself", file=file, remedy=remedy)
        if (dialect.names, dialect.decimal) != (first.names, first.decimal):
            what = f"its columns ({', '.join(dialect.names)}) are not those of {files[0].name}"
            raise InputError(what, file=file, remedy="join files with the same columns")
        named = first.separator.join([pad, stem_of(file), ""])
        lines += [named + row for row in rows if row.strip() and not row.startswith("#")]
    return ("\n".join(lines) + "\n").encode()
