"""The layouts of testing machines' text files, a row each, and the one reader of all of them."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import (
    NamedColumn,
    in_cells,
    in_two_rows,
    measured,
    plain_name,
    quantities,
)
from qlvbayes.io.formats.format import Recording, Sight, unsure_of_columns
from qlvbayes.io.formats.machineunits import QUANTITIES, unit_of
from qlvbayes.io.formats.textfile import (
    Lines,
    are_numbers,
    cells_of,
    content,
    decoded,
    is_like_number,
    refuse_cells,
    separator_of,
    with_tabs,
)
from qlvbayes.io.formats.texttable import (
    FindHeader,
    Header,
    any_header,
    are_units,
    find_header,
    may_name,
    read_below,
    refuse_unknown_units,
)
from qlvbayes.io.wording import joined

_LEAST = 10  # lines that a block of a test has at least
_SHOWN = 200  # characters of the file's own names that an error shows
_DATES = (
    "%A, %B %d, %Y %H:%M:%S", "%a, %B %d, %Y %H:%M:%S", "%A, %B %d, %Y %I:%M:%S %p",
    "%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%S", "%d/%m/%Y %H:%M:%S", "%d.%m.%Y %H:%M:%S",
    "%m/%d/%Y %I:%M:%S %p",
)  # fmt: skip

Shown = str | Callable[[Lines], bool]
"""Mark of a layout: a pattern that the first bytes have, or a function of their lines."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Layout of the text files of a testing machine or program, as one row of a table.

    ``name``, ``machine``, ``marks``, ``reads``, ``reference`` and ``general`` are as in
    `AbstractFormat`. ``shows`` are the marks in words, each with its pattern. The table begins
    below ``after``; ``header`` finds its names. ``block`` divides the text into its groups ``head``
    and ``rows``, where each block is a test of its own. ``title`` and ``began`` are patterns whose
    groups are the test's name and its date; ``part`` is what one of several parts is called.
    ``prepare`` makes the text a table where it is none, line by line. ``pressing`` is whether the
    layout fixes the signs of displacement and force.
    """

    name: str
    machine: str
    marks: str
    reads: str
    reference: str
    shows: Mapping[str, Shown]
    general: bool = False
    after: str = ""
    header: FindHeader = any_header
    block: str = ""
    title: str = ""
    began: str = ""
    part: str = ""
    prepare: Callable[[bytes], bytes] = bytes
    pressing: bool = False
    lacking: tuple[str, str] = field(
        default=("no row of names with units", "export the curves again")
    )

    def sniff(self, head: bytes) -> Sight:
        """Return which marks of the layout the first bytes of a file show."""
        text = decoded(head)
        lines = Lines.from_bytes(text.encode())
        return Sight.from_marks(
            {
                mark: bool(re.search(shown, text)) if isinstance(shown, str) else shown(lines)
                for mark, shown in self.shows.items()
            }
        )

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the tests of one file, in its order."""
        return tuple(self.tests_in(content(path), path))

    def tests_in(self, data: bytes, path: Path, name: str = "") -> list[Recording]:
        """Return the tests of a text, whose names begin with ``name``."""
        blocks = list(self._blocks(self.prepare(data)))
        if not blocks:
            raise InputError(
                "there is no block <DATA> with rows", file=path, remedy=self.lacking[1]
            )
        tests: list[Recording] = []
        for number, (head, above, rows) in enumerate(blocks, 1):
            title = _found(self.title, head)
            own = f"{number} {title}" if len(blocks) > 1 else title
            tests += self._tests(head, above, rows, path, f"{name} {own}".strip())
        return [replace(test, pressing=self.pressing or test.pressing) for test in tests]

    def _blocks(self, data: bytes) -> Iterator[tuple[str, int, bytes]]:
        """Yield each block: what is above its table, the number of lines there, and the rest."""
        if not self.block:
            yield data[:20_000].decode("utf-8", "replace"), 0, data
            return
        for found in re.finditer(self.block.encode(), data, re.DOTALL | re.MULTILINE):
            if found["rows"].count(b"\n") > _LEAST:
                rows = re.sub(rb"(?m)^<[^>\n]*>[^\n]*$", b"", found["rows"])  # marks of its parts
                head = found["head"].decode("utf-8", "replace")
                yield head, data.count(b"\n", 0, found.start("rows")), rows

    def _tests(self, head: str, above: int, data: bytes, path: Path, name: str) -> list[Recording]:
        data, blanks = with_tabs(data) if self.general else (data, False)
        lines = Lines.from_bytes(data)
        start = 0
        if self.after:
            texts = enumerate(lines.texts, 1)
            start = next((n for n, text in texts if re.match(self.after, text)), 0)
        shown = Lines(("",) * start + lines.texts[start:], lines.starts)
        header = self.header(shown, blanks)
        if header is None:
            refuse_unknown_units(lines, path)
            if names := columns_in(lines):
                raise unsure_of_columns(names, path)
            raise InputError(self.lacking[0], file=path, remedy=self.lacking[1])
        began = seconds_of(_found(self.began, head))
        return read_below(
            header, data, lines, path, above=above, name=name, began=began, part=self.part
        )


def _found(pattern: str, text: str) -> str:
    """Return the groups of a pattern where a text has it; empty otherwise."""
    match = re.search(pattern, text) if pattern else None
    return " ".join(group.strip(' "') for group in match.groups() if group) if match else ""


def seconds_of(text: str) -> float | None:
    """Return a date as seconds since 1970 on the machine's clock, or None where it is unclear."""
    for form in _DATES:
        try:
            return datetime.strptime(text.strip(), form).replace(tzinfo=UTC).timestamp()
        except ValueError:
            continue
    return None


# What the lines at the beginning show


def _names_time_and_load(lines: Lines) -> bool:
    return any(_timed(cells) for _, cells in lines.cells())


def _timed(cells: Sequence[str]) -> bool:
    by_quantity = quantities(in_two_rows(cells, []))
    return "time" in by_quantity and ("force" in by_quantity or "stress" in by_quantity)


def _units_below(lines: Lines, bracketed: bool) -> bool:
    """Return whether a row of units follows the names of time and load: in brackets, or not."""
    rows = [cells for _, cells in lines.cells()]
    for names, units in itertools.pairwise(rows):
        written = [unit for unit in units if unit]
        if len(written) < 3 or not (_timed(names) or not bracketed):
            continue
        if bracketed and all(re.fullmatch(r"\([^()]*\)", unit) for unit in written):
            return True
        if not bracketed and are_units(written) and not any("(" in unit for unit in written):
            return True
    return False


def _unit_of_time_below(lines: Lines) -> bool:
    rows = [cells for _, cells in lines.cells()]
    return any(
        "Elapsed Time" in names[:2] and "Sec" in units for names, units in itertools.pairwise(rows)
    )


def _raw_data(lines: Lines) -> bool:
    start = next((n for n, text in enumerate(lines.texts) if re.match(_RAW_DATA, text)), None)
    if start is None:
        return False
    below = (cells for number, cells in lines.cells() if number > start and any(cells))
    by_quantity = quantities(in_cells(next(below, [])))
    return "time" in by_quantity and bool(by_quantity["time"].unit) and len(by_quantity) > 2


def _own_names(lines: Lines, *, units: bool) -> bool:
    """Return whether a row names a time and testXpert's force, with units beside or below them."""
    rows = [cells for _, cells in lines.cells()]
    for names, below in zip(rows, [*rows[1:], []], strict=True):
        columns = in_cells(names)
        own = any(re.fullmatch(_STANDARD_FORCE, plain_name(column.name)) for column in columns)
        if own and "time" in quantities(columns):
            return not units or all(column.unit for column in columns) or are_units(below)
    return False


def _first_names(lines: Lines, words: str) -> bool:
    """Return whether a cell of the first line is one of the words."""
    cells = next(lines.cells(), (0, []))[1]
    return any(re.fullmatch(words, plain_name(column.name)) for column in in_cells(cells))


def _clock_in_seconds(lines: Lines) -> bool:
    named = quantities(in_cells(next(lines.cells(), (0, []))[1]))
    return "time" in named and named["time"].unit.lower() == "s"


def _two_clocks(lines: Lines) -> bool:
    return len(_clocks(_first_row(lines)[1])) == 2


_RAW_DATA = r'(?i)"?(raw data|rohdaten|donn[eé]es brutes|datos sin procesar)[^,;\t]*"?[,;\t"]*$'
_STANDARD_FORCE = "standardkraft|standard force|force standard|fuerza estandar|forza standard"


# Two clocks

_CLOCK = r"(t|time|clock|timestamp|zeit)( .*)?|.* (t|time|clock|timestamp)"
_OF_LOAD = r"(force|load|f|fz|cell|loadcell|stress|kraft)"
_OF_WAY = r"(disp|displacement|d|position|pos|encoder|stage|platen|strain|extension|weg|x|z)"


def _first_row(lines: Lines) -> tuple[int, list[NamedColumn]]:
    """Return the first line that is no comment, and the columns that it names."""
    for number, text in enumerate(lines.texts):
        if text.strip() and not text.startswith(("#", "%")):
            return number, in_cells(cells_of(text, separator_of(text)))
    return 0, []


def _clocks(columns: Sequence[NamedColumn]) -> list[NamedColumn]:
    return [column for column in columns if re.fullmatch(_CLOCK, plain_name(column.name))]


def _assigned(clocks: Sequence[NamedColumn]) -> tuple[NamedColumn, NamedColumn] | None:
    """Return the clocks of displacement and force; None where the names do not distinguish them."""
    if len(clocks) != 2:
        return None
    loads, ways = (
        [c for c in clocks if any(re.fullmatch(words, w) for w in plain_name(c.name).split())]
        for words in (_OF_LOAD, _OF_WAY)
    )
    if len(loads) > 1 or len(ways) > 1 or not (loads or ways) or loads == ways:
        return None
    load = loads[0] if loads else next(c for c in clocks if c is not ways[0])
    way = ways[0] if ways else next(c for c in clocks if c is not loads[0])
    return (way, load) if way is not load else None


def _two_clock_header(lines: Lines, blanks: bool = False) -> Header | None:
    """Return a header with a clock for each channel, of which the names say which is whose."""
    number, columns = _first_row(lines)
    clocks = _assigned(_clocks(columns))
    by_quantity = measured([c for c in columns if c not in _clocks(columns)])
    by_quantity.pop("time")
    if clocks is None or not all(by_quantity.values()):
        return None
    picked = {"time": clocks[0], **{key: one for key, one in by_quantity.items() if one}}
    return Header(number, number + 1, columns, picked, clocks[1])


# LabVIEW's own text


def _with_times(data: bytes) -> bytes:
    """Return LabVIEW's measurement file as a table: names with units, and the time of every row.

    Where the file has no column of time, a row's time is X0 + i Delta_X of its header, which names
    the units too. Each line stays at its number.
    """
    lines = data.decode("utf-8", "replace").split("\n")
    first = next((line for line in lines if line.startswith("Separator")), "")
    mark = "," if "comma" in first.lower() else "\t"
    settings: dict[str, list[str]] = {}
    row = -1  # of the numbers below the last header
    for k, line in enumerate(lines):
        key, *cells = [cell.strip() for cell in line.split(mark)]
        if key == "X_Value":
            settings["unit"] = settings.pop("Y_Unit_Label", [])
            names = [
                f"{name} ({unit})" if unit else name
                for name, unit in zip(cells, [*settings["unit"], *cells], strict=False)
            ]
            if len(settings["unit"]) < len(cells):
                names[len(settings["unit"]) :] = cells[len(settings["unit"]) :]
            row, lines[k] = 0, mark.join(["Time (s)", *names])
        elif key in ("LabVIEW Measurement", "Channels"):
            row = -1
        elif row < 0:
            settings[key] = [cell for cell in cells if cell]
        elif line.strip():
            if not key and cells:
                begin, step = (_as_number(settings.get(name, [])) for name in ("X0", "Delta_X"))
                lines[k] = mark.join([f"{begin + row * step:.9g}", *cells])
            row += 1
    return "\n".join(lines).encode()


def _as_number(cells: Sequence[str]) -> float:
    try:
        return float(cells[0].replace(",", ".")) if cells else 0.0
    except ValueError:
        return 0.0


# Columns that the user states

_QUANTITIES = ("time", "displacement", "force")


def named_columns(text: str) -> tuple[str, str, str]:
    """Return ``t,x,F`` as the columns of time, displacement (or strain) and force (or stress)."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != len(_QUANTITIES) or len({*parts, ""}) != len(parts) + 1:
        raise InputError(
            f"--columns {text[:_SHOWN]!r} are not three different columns",
            remedy="write the names of time, displacement and force as t,x,F, or their numbers "
            "from 1 as 1,2,3",
        )
    return parts[0], parts[1], parts[2]


def stated_header(lines: Lines, stated: Sequence[str], file: Path) -> Header:
    """Return the header of the table that has the stated columns; an InputError says what lacks."""
    numbered = all(name.isdecimal() for name in stated)
    header = _by_number(lines, stated) if numbered else _by_name(lines, stated)
    if header is not None:
        return header
    if all(name.isdecimal() and int(name) for name in stated):
        refuse_cells(lines, [int(number) - 1 for number in stated], file)
    widest = max((cells for _, cells in lines.cells()), key=len, default=[])
    shown = f" (the file has: {', '.join(widest)[:_SHOWN]})" if len(widest) > 1 else ""
    raise InputError(
        f"the columns {joined(list(stated))} are not there{shown}",
        file=file,
        remedy="write them as the file does, or their numbers from 1, as --columns 1,2,3",
    )


def _by_name(lines: Lines, stated: Sequence[str]) -> Header | None:
    """Return the table below the first line that has the stated names; None without one."""
    for number, names in lines.cells():
        columns = in_cells(names)
        found = [_named(name, names, columns) for name in stated]
        indices = [column.index for column in found if column is not None]
        if len(indices) < len(stated):
            continue
        separator = separator_of(lines.texts[number])
        below = number + 1
        while below < len(lines.texts) and not lines.texts[below].strip():
            below += 1
        units = cells_of(lines.texts[below], separator) if below < len(lines.texts) else []
        first = number + 1
        if units and not are_numbers(units, indices):
            columns, first = in_two_rows(names, units), below + 1
        return _stated(number, first, columns, indices)
    return None


def _by_number(lines: Lines, stated: Sequence[str]) -> Header | None:
    """Return the table from the first line with numbers in the stated columns; None without one."""
    indices = [int(number) - 1 for number in stated]
    for first, cells in lines.cells():
        if min(indices) < 0 or not are_numbers(cells, indices):
            continue
        named = _names_above(lines, first, len(cells), indices)
        if not named:
            columns = [NamedColumn(k, f"column {k + 1}", "") for k in range(len(cells))]
            return _stated(first, first, columns, indices)
        columns = in_two_rows(*named) if len(named) > 1 else in_cells(named[0])
        return _stated(first - len(named), first, columns, indices)
    return None


def _stated(
    line: int, first: int, columns: Sequence[NamedColumn], indices: Sequence[int]
) -> Header:
    picked = {key: columns[index] for key, index in zip(_QUANTITIES, indices, strict=True)}
    return Header(line, first, columns, picked)


def _names_above(lines: Lines, first: int, width: int, indices: Sequence[int]) -> list[list[str]]:
    """Return the row of names, and that of units, directly above a first row of numbers."""
    separator = separator_of(lines.texts[first])
    above = [cells_of(text, separator) for text in lines.texts[max(first - 2, 0) : first]]
    wide = [row for row in above if width <= len(row) <= width + 1]
    rows = [row for row in wide if not any(is_like_number(row[index]) for index in indices)]
    kinds = [kind for either in QUANTITIES for kind in either]
    units = any(unit_of(cell, kind) for row in rows[-1:] for cell in row for kind in kinds)
    return rows if units else rows[-1:]


def _named(name: str, cells: Sequence[str], columns: Sequence[NamedColumn]) -> NamedColumn | None:
    """Return the column that is called so, as a whole, without its unit, or in other capitals."""
    pairs = list(zip(columns, cells, strict=True))
    for column, cell in pairs:
        if name in (cell, column.name):
            return column
    plain = plain_name(name)
    alike = [c for c, cell in pairs if plain and plain in (plain_name(cell), plain_name(c.name))]
    return alike[0] if len(alike) == 1 else None


def columns_in(lines: Lines) -> list[str]:
    """Return the names, or else the numbers, of a table's columns; empty where there is none."""
    for number, cells in lines.cells():
        if len(cells) < len(_QUANTITIES) or not are_numbers(cells, range(len(_QUANTITIES))):
            continue
        named = _names_above(lines, number, len(cells), range(len(_QUANTITIES)))
        shown = [name or str(k + 1) for k, name in enumerate(named[0] if named else [])]
        return shown or [str(k + 1) for k in range(len(cells))]
    return []


def _may_be_named(lines: Lines) -> bool:
    lines, _ = _between_blanks(lines)
    return find_header(lines, _) is not None or any(
        all(measured(in_cells(cells)).values()) for _, cells in lines.cells() if may_name(cells)
    )


def _has_table(lines: Lines) -> bool:
    return find_header(*_between_blanks(lines)) is not None


def _between_blanks(lines: Lines) -> tuple[Lines, bool]:
    data, blanks = with_tabs("\n".join(lines.texts).encode())
    return Lines.from_bytes(data), blanks


BLUEHILL_3 = Layout(
    "bluehill-3",
    "Instron, Bluehill 2 and 3 (raw data as CSV)",
    "a row of names with time, and a row of units, each in parentheses",
    "Time, (Compressive) Extension, (Compressive) Load; start time, label",
    "Bluehill 3 reference manual, exported raw data",
    {
        "a row of names with time and load": _names_time_and_load,
        "units in parentheses in the row below": partial(_units_below, bracketed=True),
    },
    title=r'(?im)^"?specimen label:?"?[,;\t]\s*"?([^"\n]*)',
    began=r'(?im)^"?general : start time:?"?[,;\t]\s*"?([^"\n]*)',
)
BLUEHILL_UNIVERSAL = Layout(
    "bluehill-universal",
    "Instron, Bluehill Universal (results and raw data as CSV)",
    "a line 'Raw Data' and below it names with units in parentheses",
    "Time (s), Displacement (mm), Force (N) below 'Raw Data'",
    "Bluehill Universal, exported raw data",
    {
        "a line 'Raw Data'": f"(?m)^{_RAW_DATA}".replace("(?m)^(?i)", "(?mi)^"),
        "names with units in parentheses below it": _raw_data,
    },
    after=_RAW_DATA,
)
WINTEST = Layout(
    "wintest",
    "Bose or TA ElectroForce, WinTest (text)",
    "names with 'Elapsed Time', and units with 'Sec' in the row below",
    "Elapsed Time, Disp, Load of every scan (a test each)",
    "WinTest, exported data acquisition",
    {
        "names with 'Elapsed Time'": r'(?m)^([^,;\t\n]*[,;\t])?"?Elapsed Time"?[,;\t]',
        "'Sec' in the row below": _unit_of_time_below,
    },
    part="scan",
)
TESTSUITE = Layout(
    "testsuite",
    "MTS TestSuite (data acquisition as CSV or text)",
    "lines 'Test Run:' and 'Date:', and a row of units without parentheses",
    "(Running) Time, (Axial) Displacement, (Axial) Force; run name and date",
    "MTS TestSuite, exported raw data",
    {
        "a line 'Test Run:'": r'(?m)^[ "]*Test Run(?: Name)?\s*:',
        "a line 'Date:'": r'(?m)^[ "]*Date(?: Name)?\s*:',
        "a row of units below the names": partial(_units_below, bracketed=False),
    },
    title=r'(?m)^[ "]*Test Run(?: Name)?\s*:[ \t",;]*([^"\n]*)',
    began=r'(?m)^[ "]*Date(?: Name)?\s*:[ \t",;]*([^"\n]*)',
)
TESTXPERT = Layout(
    "testxpert",
    "ZwickRoell, testXpert II and III (text: .txt, .tra, .csv)",
    "testXpert's own names (Standardkraft, Standard force) in addition to a time",
    "Prüfzeit or Test time, Standardweg or Standard travel, Standardkraft",
    "testXpert, export of curves",
    {
        "a row of names with Standardkraft or Standard force and a time": partial(
            _own_names, units=False
        ),
        "units in brackets or in the row below": partial(_own_names, units=True),
    },
    began=r"(\d[\d./-]+ \d+:\d\d:\d\d(?: [AP]M)?)",
)
CELLSCALE = Layout(
    "cellscale",
    "CellScale UniVert, MicroTester (data as CSV)",
    "columns SetName and Cycle in addition to Time_S",
    "Time_S, Displacement_mm or Tip_um, Force_N or Force_uN; sets and cycles are one test",
    "CellScale UniVert user manual, output columns",
    {
        "a column SetName": partial(_first_names, words="set|set ?name"),
        "a column Cycle": partial(_first_names, words="cycle"),
        "a column Time_S": _clock_in_seconds,
    },
)
MACH_1 = Layout(
    "mach-1",
    "Biomomentum Mach-1 (text)",
    "a first line <Mach-1 File>, and a block <INFO>",
    "Time, s; Position (z), mm; Fz, gf or N, of every <DATA> block (a test)",
    "Mach-1 Motion user manual, data files",
    {"a first line <Mach-1 File>": r"\A\s*<Mach-1 File>", "a block <INFO>": "<INFO>"},
    block=r"<INFO>(?P<head>.*?)<END INFO>.*?<DATA>[ \t]*\n(?P<rows>.*?)(?:<END DATA>|\Z)",
    title=r"<(?!END)([^>/]+)>",
    began=r"(?s)Date[ :]*\t([^\n]*).*Time[ :]*\t([^\n.]*)",
    lacking=("no row of names with units", "export the file again, with its data"),
)
CHIARO = Layout(
    "chiaro",
    "Optics11 Chiaro, Piuma (text)",
    "a line 'k (N/m)', and names with Load (uN) and Indentation (nm)",
    "Time (s), Indentation (nm), Load (uN); date",
    "Optics11 Life, Piuma and Chiaro user manual, data files",
    {
        "a line 'k (N/m)'": r"(?m)^k \(N/m\)",
        "names with Load and Indentation": r"(?m)^Time[^\n]*\tIndentation \(",
    },
    began=r"\A\W*Date\t([^\t\n]*)\tTime\t([^\t\n]*)",
    pressing=True,  # a tip is pressed in, and may stick
)
LVM = Layout(
    "lvm",
    "National Instruments LabVIEW, measurement file (.lvm)",
    "a first line 'LabVIEW Measurement', and a line '***End_of_Header***'",
    "channels by name or unit (Y_Unit_Label); X_Value, or else X0 + i Delta_X of the header",
    "National Instruments, Specification for the LabVIEW Measurement File",
    {
        "a first line 'LabVIEW Measurement'": r"\A\s*LabVIEW Measurement",
        "a line '***End_of_Header***'": r"(?m)^\*\*\*End_of_Header\*\*\*",
    },
    prepare=_with_times,
    began=r"(?s)Date\t(\d+/\d+/\d+).*?Time\t(\d+:\d+:\d+)",
)
TWO_CLOCKS = Layout(
    "two-clocks",
    "a laboratory's own CSV with a clock for each channel",
    "two columns of time, one named after force or displacement; units",
    "displacement on its own clock, brought to the times of the force",
    "any logger that stamps its channels one by one",
    {
        "two columns of time": _two_clocks,
        "one of them named after force or displacement, and both channels": lambda lines: (
            _two_clock_header(lines) is not None
        ),
    },
    header=_two_clock_header,
    lacking=("the two clocks cannot be distinguished", "name the clocks t_disp_s and t_force_s"),
)
TABLE = Layout(
    "table",
    "a table of named columns with units (rheometers, most programs)",
    "names of time, displacement or strain, force or stress, with units",
    "the three columns, units in brackets, in the row below or in that above, UTF-16 too",
    "Anton Paar RheoCompass, export of tables; ISO 6721-10 for the names",
    {
        "a row that names time, displacement or strain, and force or stress": _may_be_named,
        "their units or numbers below them, and no name of a tidy file": _has_table,
    },
    general=True,
    header=find_header,
    lacking=("no row of names with units", "export it again"),
)


def stated_layout(stated: Sequence[str], file: Path, own: Layout | None) -> Layout:
    """Return the layout of a text of which the user states time, displacement and force.

    ``own`` is the layout that the file's marks show, if it has any: its text is made a table alike.
    """
    return Layout(
        "columns",
        f"a table with the columns {joined(list(stated))}, as stated",
        "three columns, which --columns states",
        "these columns; units after the names, below them, or by --units",
        "none: the user knows the file",
        {"three columns, which --columns states": ""},
        general=True,
        header=lambda lines, _: stated_header(lines, stated, file),
        prepare=own.prepare if own else bytes,
    )
