"""Tabulate the constants of all pads with reference values, as CSV and LaTeX."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import floor, isfinite, log10
from pathlib import Path

from qlvbayes.fitting.summary import Constant, FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import write_whole
from qlvbayes.io.wording import as_cells, tex

_COLUMNS = ["pad", "parameter", "value", "unit"]
_HEADS = "pad,parameter,unit,median,low90,high90,reference"
_INDEXED = re.compile(r"([a-z])\[(\d+)\]")


@dataclass(frozen=True)
class Reference:
    """A value of a constant from elsewhere, with its unit."""

    value: float
    unit: str


@dataclass(frozen=True)
class Entry:
    """A constant of one pad: median, 90 % interval, and the reference value if there is one."""

    pad: str
    parameter: str
    unit: str
    median: float
    low: float
    high: float
    reference: float | None = None


References = Mapping[tuple[str, str], Reference]


def read_references(path: str | Path) -> dict[tuple[str, str], Reference]:
    """Read reference values by pad and parameter from a CSV file: ``pad,parameter,value,unit``."""
    file = Path(path)
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        remedy = f"name a CSV file with the columns {','.join(_COLUMNS)}"
        raise InputError("these references cannot be read", file=file, remedy=remedy) from error
    rows = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    parsed = list(csv.reader([line for _, line in rows]))
    if not parsed or [name.strip() for name in parsed[0]] != _COLUMNS:
        line = rows[0][0] if rows else None
        remedy = f"begin with the line {','.join(_COLUMNS)}"
        raise InputError("not a table of references", file=file, line=line, remedy=remedy)
    references: dict[tuple[str, str], Reference] = {}
    for (number, _), cells in zip(rows[1:], parsed[1:], strict=True):
        _add(references, [cell.strip() for cell in cells], file, number)
    return references


def _add(
    references: dict[tuple[str, str], Reference], cells: Sequence[str], file: Path, line: int
) -> None:
    """Add the reference of one row, or raise InputError."""
    if len(cells) != len(_COLUMNS):
        remedy = f"write {','.join(_COLUMNS)}"
        raise InputError(f"{len(cells)} columns, not 4", file=file, line=line, remedy=remedy)
    pad, parameter, text, unit = cells
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        remedy = "write a number or delete the row"
        raise InputError(f"value is not a number ('{text}')", file=file, line=line, remedy=remedy)
    if (pad, parameter) in references:
        remedy = "delete one of them"
        raise InputError(f"{parameter} of pad {pad} again", file=file, line=line, remedy=remedy)
    references[pad, parameter] = Reference(value, unit)


def matching_references(references: References, summaries: Iterable[FitSummary]) -> References:
    """Return the references that are in the constant's unit; another law may have another one."""
    units = {(s.pad, name): c.unit for s in summaries for name, c in s.parameters.items()}
    return {
        key: reference
        for key, reference in references.items()
        if units.get(key) in (None, reference.unit)
    }


def constants_table(
    summaries: Iterable[FitSummary], references: References | None = None
) -> list[Entry]:
    """Return the entries of every constant, pad by pad."""
    return [
        _entry(s.pad, name, c, references or {})
        for s in summaries
        for name, c in s.parameters.items()
    ]


def _entry(pad: str, name: str, constant: Constant, references: References) -> Entry:
    """Return the entry of one constant."""
    reference = references.get((pad, name))
    if reference is not None and reference.unit != constant.unit:
        raise InputError(
            f"the reference of {name} of pad {pad} is in {reference.unit or 'no unit'}",
            remedy=f"give it in {constant.unit}",
        )
    value = None if reference is None else reference.value
    return Entry(pad, name, constant.unit, constant.median, *constant.hdi90, value)


def as_csv(entries: Sequence[Entry]) -> str:
    """Return the table as CSV: one row for each constant of a pad."""
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    table.writerow(_HEADS.split(","))
    for e in entries:
        cells = [f"{x:.6g}" for x in (e.median, e.low, e.high)]
        cells += ["" if e.reference is None else f"{e.reference:.6g}"]
        table.writerow([*as_cells([e.pad, e.parameter, e.unit]), *cells])
    return file.getvalue()


def as_latex(entries: Sequence[Entry]) -> str:
    """Return the table for LaTeX's booktabs: constants in rows, pads and references in columns."""
    shown = [e for e in entries if not e.parameter.startswith("noise.")]
    pads = list(dict.fromkeys(e.pad for e in shown))
    known = {e.pad for e in shown if e.reference is not None}
    heads = [f"pad {tex(pad)}{' & reference' if pad in known else ''}" for pad in pads]
    entry_of = {(e.pad, e.parameter): e for e in shown}
    units = {e.parameter: e.unit for e in shown}
    rows = [
        [symbol(name), "" if unit == "1" else tex(unit)]
        + [cell for pad in pads for cell in _cells(entry_of.get((pad, name)), pad in known)]
        for name, unit in units.items()
    ]
    lines = [
        "% needs \\usepackage{booktabs}; median [90 \\% highest-density interval]",
        f"\\begin{{tabular}}{{ll{''.join('lr' if pad in known else 'l' for pad in pads)}}}",
        "\\toprule",
        " & ".join(["constant", "unit", *heads]) + " \\\\",
        "\\midrule",
        *(" & ".join(row) + " \\\\" for row in rows),
        "\\bottomrule",
        "\\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def write_constants(out: Path, entries: Sequence[Entry], *, for_print: bool = True) -> list[Path]:
    """Write ``out``/constants.csv, and .tex with a column a pad, completely or not at all."""
    texts = {"csv": as_csv(entries)}
    if for_print:
        texts["tex"] = as_latex(entries)
    for suffix, text in texts.items():
        write_whole(out / f"constants.{suffix}", text.encode())
    return [out / f"constants.{suffix}" for suffix in texts]


def symbol(name: str) -> str:
    """Return a constant's name in mathematical notation: '$c_0$' for 'c[0]'; others unchanged."""
    match = _INDEXED.fullmatch(name)
    if match:
        return f"${match[1]}_{match[2]}$"
    return f"${name}$" if len(name) == 1 else tex(name)


def rounded(entry: Entry) -> tuple[str, str, str]:
    """Return median, low and high to two digits of half the interval's width, or to four digits."""
    half = 0.5 * (entry.high - entry.low)
    values = (entry.median, entry.low, entry.high)
    decimals = 1 - floor(log10(half)) if half > 0.0 else 7
    if decimals > 6:
        return f"{values[0]:.4g}", f"{values[1]:.4g}", f"{values[2]:.4g}"
    median, low, high = (f"{round(x, decimals):.{max(decimals, 0)}f}" for x in values)
    return median, low, high


def _cells(entry: Entry | None, with_reference: bool) -> list[str]:
    """Return the cells of one constant of one pad, with its reference if there is a column."""
    if entry is None:
        return ["--", "--"] if with_reference else ["--"]
    median, low, high = (text.replace("-", "$-$") for text in rounded(entry))
    fixed = entry.low == entry.high
    cells = [f"{median} (fixed)" if fixed else f"{median} [{low}, {high}]"]
    if with_reference:
        cells.append("--" if entry.reference is None else f"{entry.reference:g}")
    return cells
