"""Find how a tidy file is written: its header line, separator, decimal mark, columns and units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import LABELS, split_name
from qlvbayes.io.files import stem_of
from qlvbayes.io.table import (
    EXPORT,
    HEAD,
    THOUSANDS,
    cells_of,
    content,
    decoded,
    head_of,
    is_text,
)
from qlvbayes.io.units import (
    PAD,
    SAME,
    STRAIN,
    SUFFIXES,
    Scale,
    UnitSystem,
    column_name,
    unit_system,
)
from qlvbayes.io.wording import as_typed

_HEAD = 1 << 19  # bytes in which the header stands, below the comments of a conversion
_SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}
_SEPARATOR_LINE = re.compile(r'"?sep=([,;\t])"?', re.IGNORECASE)
_FRACTION = re.compile(r"[+-]?\d*([.,])\d+([eE][+-]?\d+)?")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_TWICE = ("displacement", "force", "strain", "stress")  # what may stand there in two units
_COUNTERPART = {"strain": "displacement", "stress": "force"}
_COUNTERPART |= {other: one for one, other in _COUNTERPART.items()}
_OTHER_WORDS = {
    "time": ("t",),
    "displacement": ("disp", "position", "depth", "indentation", "stroke", "extension"),
    "force": ("load", "f"),
    "strain": ("eps", "epsilon"),
    "stress": ("sigma",),
}


@dataclass(frozen=True)
class Column:
    """A column: its index, its name in the file, its unit, and a scale.

    ``scale`` converts to the unit of the displacement column for displacement and rate, to that of
    the force column for force and its sd, and to s for time.
    """

    index: int
    name: str
    suffix: str = ""
    scale: Scale = SAME


@dataclass(frozen=True)
class Dialect:
    """Form of a tidy file: columns that are read and their units, separator, decimal mark, header.

    ``numeric`` are time, displacement, force and force_sd. ``ignored`` are names of other columns,
    ``width`` is the number of all; ``line`` is that of the header.
    """

    units: UnitSystem
    numeric: dict[str, Column]
    labels: dict[str, Column]
    ignored: tuple[str, ...]
    width: int
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
    rows = ((n, text) for n, text in enumerate(lines, 1) if text.strip() and text[0] != "#")
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
    units, numeric, labels = _columns(names, path, line)
    if len(written) == 1:
        raise InputError("there are no rows below the header", file=path, line=line, remedy=EXPORT)
    used = {column.index for column in (*numeric.values(), *labels.values())}
    ignored = tuple(name for i, name in enumerate(names) if i not in used and name)
    decimal = "."
    for _, row in chain(written[1:], rows):
        cells = cells_of(row, separator)
        several = [cells[c.index] for c in numeric.values() if c.index < len(cells)]
        # "1,234" in a comma-separated file may well be a thousand
        marks = [
            match[1]
            for cell in several
            if (separator != "," or not THOUSANDS.fullmatch(cell))
            and (match := _FRACTION.fullmatch(cell))
        ]
        if marks:
            decimal = marks[0]
            break
    return Dialect(units, numeric, labels, ignored, len(names), separator, decimal, line)


def _columns(
    names: Sequence[str], file: Path, line: int
) -> tuple[UnitSystem, dict[str, Column], dict[str, Column]]:
    """Return the file's own units, and the columns of numbers and of labels."""
    fail = partial(InputError, file=file, line=line)
    if sum(bool(_NUMBER.fullmatch(name)) for name in names) > 1:
        raise fail(
            "the first line has numbers, not column names",
            remedy="add a header line such as time_s,displacement_mm,force_N",
        )
    found: dict[str, Column] = {}
    unknown: list[tuple[str, str, str]] = []
    for index, name in enumerate(names):
        if (parts := split_name(name)) is None:
            continue
        quantity, suffix = parts
        scales = SUFFIXES.get(quantity, {"": SAME})
        if suffix not in scales:
            unknown.append((quantity, suffix, name))
            continue
        twin = f"{quantity} 2"  # of a quantity that stands there in two units
        if quantity in _TWICE and quantity in found and found[quantity].suffix != suffix:
            quantity = twin if twin not in found else quantity
        if quantity in found:
            both = f"'{found[quantity].name}' and '{name}'"
            raise fail(f"two columns for {quantity}: {both}", remedy="delete one of them")
        found[quantity] = Column(index, name, suffix, scales[suffix])
    for quantity, suffix, name in unknown:
        if quantity not in found and _COUNTERPART.get(quantity) not in found:  # no force_raw
            what = f"the unit '{suffix}' of '{name}' is unknown" if suffix else (
                f"'{name}' has no unit"
            )  # fmt: skip
            remedy = f"rename it to {_spellings(quantity)} and convert its values to that unit"
            raise fail(what, remedy=remedy)
    kind = _kind(found, fail)
    _refuse_missing(names, found, kind, file, fail)
    keys = {"time": "time", "displacement": kind.displacement_name, "force": kind.force_name}
    keys["force_sd"] = f"{kind.force_name}_sd"
    keys |= {f"{key} 2": f"{keys[key]} 2" for key in ("displacement", "force")}
    numeric = {key: found[own] for key, own in keys.items() if own in found}
    labels = {key: found[key] for key in (*LABELS, "rate", "start", "contact_sd") if key in found}
    way, load = numeric["displacement"], numeric["force"]
    system = unit_system("1" if kind is STRAIN else way.suffix, load.suffix)
    own = dict.fromkeys(("displacement", "displacement 2", "rate", "contact_sd"), way.scale)
    own |= dict.fromkeys(("force", "force 2", "force_sd"), load.scale)

    def scaled(columns: dict[str, Column]) -> dict[str, Column]:
        return {
            key: replace(column, scale=column.scale.over(own.get(key, SAME)))
            for key, column in columns.items()
        }

    return system, scaled(numeric), scaled(labels)


def _kind(found: Mapping[str, Column], fail: partial[InputError]) -> UnitSystem:
    """Return whether a file has displacement and force, or strain and stress."""
    for one, other in (("displacement", "strain"), ("force", "stress")):
        if one in found and other in found:
            both = f"'{found[one].name}' and '{found[other].name}'"
            raise fail(f"two columns for one quantity: {both}", remedy="delete one of them")
    kind, not_this = (STRAIN, PAD) if {"strain", "stress"} & set(found) else (PAD, STRAIN)
    for key in (not_this.displacement_name, not_this.force_name, f"{not_this.force_name}_sd"):
        if key in found:
            pair = f"{kind.displacement_name} and {kind.force_name}"
            raise fail(
                f"'{found[key].name}' does not go with {pair}",
                remedy="give displacement with force, or strain with stress",
            )
    if "rate" in found and (found["rate"].suffix == "1_s") != (kind is STRAIN):
        right = "1_s" if kind is STRAIN else "mm_s"
        raise fail(f"'{found['rate'].name}' is of the wrong unit", remedy=f"give rate_{right}")
    return kind


def _refuse_missing(
    names: Sequence[str],
    found: Mapping[str, Column],
    units: UnitSystem,
    file: Path,
    fail: partial[InputError],
) -> None:
    needed = ("time", units.displacement_name, units.force_name)
    missing = [quantity for quantity in needed if quantity not in found]
    if not missing:
        return
    remedies = [remedy for quantity in missing if (remedy := _rename(quantity, names))]
    if len(names) == 1:
        remedies = ["separate the columns by commas"]
    elif len(remedies) < len(missing):
        wanted = (column_name(quantity, next(iter(SUFFIXES[quantity]))) for quantity in missing)
        remedies.append(f"the columns needed are {', '.join(wanted)}")
    if len(names) >= len(needed):
        typed = as_typed("qlvbayes", "look", str(file))
        remedies.append(f"or name three of them: {typed} --columns T,X,F -o tidy.csv")
    shown = ", ".join(names[:12])[:200]
    what = f"no column for {' and '.join(missing)} (the file has: {shown})"
    raise fail(what, remedy="; ".join(remedies))


def _rename(quantity: str, names: Sequence[str]) -> str | None:
    """Return the remedy for a column that means the quantity but is spelled 'Force [N]'."""
    words = (quantity, *_OTHER_WORDS[quantity])
    for name in names:
        first, *rest = re.findall(r"[A-Za-zµμ]+|$", name)
        if first.lower() in words:
            units = [re.sub("[µμ]", "u", unit) for unit in rest]
            known = [unit for unit in units if unit and unit in SUFFIXES[quantity]]
            new = column_name(quantity, known[-1]) if known else _spellings(quantity)
            return f"rename '{name}' to {new}"
    return None


def _spellings(quantity: str) -> str:
    return " or ".join(column_name(quantity, suffix) for suffix in SUFFIXES[quantity])


def joined(files: Sequence[Path], pad: str) -> bytes:
    """Return one tidy file of several that hold a test each: the tests of one pad.

    Their rows stay as they are, below one header and behind the pad and a test's name, that of its
    file. InputError if a file names its pads or tests, or has other columns than the first.
    """
    lines, first = [], sniff(files[0])
    head = content(files[0]).decode().split("\n")[first.line - 1]
    lines.append(first.separator.join(["pad", "test", head]))
    for file in files:
        dialect = sniff(file)
        header, *rows = content(file).decode().split("\n")[dialect.line - 1 :]
        if {"pad", "test"} & set(dialect.labels):
            remedy = "leave it out: its tests have a pad"
            raise InputError("it names its pads or tests itself", file=file, remedy=remedy)
        if (header, dialect.decimal) != (head, first.decimal):
            what = f"its columns ({header.strip()}) are not those of {files[0].name}"
            raise InputError(what, file=file, remedy="join files with the same columns")
        named = first.separator.join([pad, stem_of(file), ""])
        lines += [named + row for row in rows if row.strip() and not row.startswith("#")]
    return ("\n".join(lines) + "\n").encode()
