"""Read machines' texts: one row for each layout, and one reader for all of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import in_cells, plain_name, quantities, unsure_of_columns
from qlvbayes.io.header import (
    Header,
    columns_in,
    find_header,
    stated_above,
    stated_header,
    two_clock_header,
)
from qlvbayes.io.recording import Recording, Sight
from qlvbayes.io.splitting import LEAST, tests_below
from qlvbayes.io.table import parse_number
from qlvbayes.io.text import Lines, content, decoded, with_tabs
from qlvbayes.io.wording import joined

Shown = str | Callable[[Lines], bool]
"""Mark of a layout: a pattern that the first bytes have, or a function of their lines."""
_any_header = partial(find_header, tidy=True)  # a machine's table may have names of a tidy file


@dataclass(frozen=True, eq=False)
class Layout:
    """Layout of the text files of a testing machine or program, as one row of a table.

    ``name``, ``machine``, ``reference`` and ``general`` are as in `AbstractFormat`. ``shows`` are
    the marks in words, each with its pattern. The table begins below ``after``; ``header`` finds
    its names. ``block`` divides the text into its groups ``head`` and ``rows``, where each block is
    a test of its own. ``title`` is a pattern whose groups are the test's name; ``part`` is what one
    of several parts is called. ``prepare`` makes the text a table where it is none, line by line.
    ``pressing`` is whether the layout fixes the signs of displacement and force. ``lacking`` is
    what a file without a header lacks, and the remedy.
    """

    name: str
    machine: str
    reference: str
    shows: Mapping[str, Shown]
    general: bool = False
    after: str = ""
    header: Callable[[Lines, bool], Header | None] = _any_header
    block: str = ""
    title: str = ""
    part: str = ""
    prepare: Callable[[bytes], bytes] = bytes
    pressing: bool = False
    lacking: tuple[str, str] = ("no row of names with units", "export the curves again")

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
            found = self._tests(head, above, rows, path, f"{name} {own}".strip())
            tests += [replace(test, pressing=self.pressing or test.pressing) for test in found]
        return tests

    def _blocks(self, data: bytes) -> Iterator[tuple[str, int, bytes]]:
        """Yield each block: what is above its table, the number of lines there, and the rest."""
        if not self.block:
            yield data[:20_000].decode("utf-8", "replace"), 0, data
            return
        for found in re.finditer(self.block.encode(), data, re.DOTALL | re.MULTILINE):
            if found["rows"].count(b"\n") > LEAST:
                rows = re.sub(rb"(?m)^<[^>\n]*>[^\n]*$", b"", found["rows"])  # marks of its parts
                head = found["head"].decode("utf-8", "replace")
                yield head, data.count(b"\n", 0, found.start("rows")), rows

    def _tests(self, head: str, above: int, data: bytes, path: Path, name: str) -> list[Recording]:
        over = head.split("\n") if self.block else Lines.from_bytes(data).texts
        data, blanks = with_tabs(data) if self.general else (data, False)
        lines = Lines.from_bytes(data)
        start = 0
        if self.after:
            texts = enumerate(lines.texts, 1)
            start = next((n for n, text in texts if re.match(self.after, text)), 0)
        header = self.header(Lines(("",) * start + lines.texts[start:], lines.starts), blanks)
        if header is None:
            if columns := columns_in(lines):
                raise unsure_of_columns(columns, path)
            raise InputError(self.lacking[0], file=path, remedy=self.lacking[1])
        over = over if self.block else over[: header.line]
        tests = tests_below(header, data, lines, path, name, above, self.part)
        names = lines.texts[header.line]
        return [
            replace(
                test,
                stated=stated_above(over, names, test.clock).completed_by(
                    test.stated, of_rows=True
                ),
            )
            for test in tests
        ]


def _found(pattern: str, text: str) -> str:
    """Return the groups of a pattern where a text has it; empty otherwise."""
    match = re.search(pattern, text) if pattern else None
    return " ".join(group.strip(' "') for group in match.groups() if group) if match else ""


def _names_time_and(lines: Lines, force: str) -> bool:
    """Return whether a row names a time, and a force by such a word."""
    for _, cells in lines.cells():
        if not "".join(cells).strip("0123456789.,+-eE \t"):
            continue  # most rows are numbers
        columns = in_cells(cells)
        by_quantity = quantities([replace(column, unit="") for column in columns])
        load = any(re.fullmatch(force, plain_name(column.name)) for column in columns)
        if "time" in by_quantity and (load or (not force and {"force", "stress"} & {*by_quantity})):
            return True
    return False


def _has_table(lines: Lines) -> bool:
    data, blanks = with_tabs("\n".join(lines.texts).encode())
    return find_header(Lines.from_bytes(data), blanks) is not None


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
            units = settings.pop("Y_Unit_Label", [])
            units += [""] * len(cells)
            names = [f"{c} ({u})" if u else c for c, u in zip(cells, units, strict=False)]
            row, lines[k] = 0, mark.join(["Time (s)", *names])
        elif key in ("LabVIEW Measurement", "Channels"):
            row = -1
        elif row < 0:
            settings[key] = [cell for cell in cells if cell]
        elif line.strip():
            if not key and cells:
                stated = [(settings.get(name) or ["0"])[0] for name in ("X0", "Delta_X")]
                begin, step = (parse_number(c.replace(",", "."), ".") or 0.0 for c in stated)
                lines[k] = mark.join([f"{begin + row * step:.9g}", *cells])
            row += 1
    return "\n".join(lines).encode()


_RAW_DATA = r'(?i)"?(raw data|rohdaten|donn[eé]es brutes|datos sin procesar)[^,;\t]*"?[,;\t"]*$'
_STANDARD_FORCE = "standardkraft|standard force|force standard|fuerza estandar|forza standard"
_UNITS = r'(?m)^[,;\t]?("?\([^()\n]*\)"?[,;\t]?){3,}\s*$'
BLUEHILL_3 = Layout(
    "bluehill-3",
    "Instron, Bluehill 2 and 3 (raw data as CSV)",
    "Bluehill 3 reference manual, exported raw data",
    {
        "a row of names with time and load": partial(_names_time_and, force=""),
        "units in parentheses in the row below": _UNITS,
    },
    title=r'(?im)^"?specimen label:?"?[,;\t]\s*"?([^"\n]*)',
)
BLUEHILL_UNIVERSAL = Layout(
    "bluehill-universal",
    "Instron, Bluehill Universal (results and raw data as CSV)",
    "Bluehill Universal, exported raw data",
    {
        "a line 'Raw Data'": f"(?m)^{_RAW_DATA}".replace("(?m)^(?i)", "(?mi)^"),
        "names with units in parentheses": r"(?m)^[^\n(]*\((s|sec|ms|min)\)[^\n(]+\(",
    },
    after=_RAW_DATA,
)
WINTEST = Layout(
    "wintest",
    "Bose or TA ElectroForce, WinTest (text)",
    "WinTest, exported data acquisition",
    {
        "names with 'Elapsed Time'": r'(?m)^([^,;\t\n]*[,;\t])?"?Elapsed Time"?[,;\t]',
        "'Sec' in the row below": r'Elapsed Time"?[,;\t][^\n]*\n([^\n]*[,;\t])?"?Sec"?[,;\t]',
    },
    part="scan",
)
TESTSUITE = Layout(
    "testsuite",
    "MTS TestSuite (data acquisition as CSV or text)",
    "MTS TestSuite, exported raw data",
    {
        "a line 'Test Run:'": r'(?m)^[ "]*Test Run(?: Name)?\s*:',
        "a line 'Date:'": r'(?m)^[ "]*Date(?: Name)?\s*:',
    },
    title=r'(?m)^[ "]*Test Run(?: Name)?\s*:[ \t",;]*([^"\n]*)',
)
TESTXPERT = Layout(
    "testxpert",
    "ZwickRoell, testXpert II and III (text: .txt, .tra, .csv)",
    "testXpert, export of curves",
    {
        "a row of names with Standardkraft or Standard force and a time": partial(
            _names_time_and, force=_STANDARD_FORCE
        ),
    },
)
CELLSCALE = Layout(
    "cellscale",
    "CellScale UniVert, MicroTester (data as CSV)",
    "CellScale UniVert user manual, output columns",
    {
        "a column SetName": r"(?i)\A[^\n]*\bSet ?(Name)?\b",
        "a column Cycle": r"(?i)\A[^\n]*\bCycle\b",
        "a column Time_S": r"(?i)\A[^\n]*\bTime[ _]?\(?S\b",
    },
)
MACH_1 = Layout(
    "mach-1",
    "Biomomentum Mach-1 (text)",
    "Mach-1 Motion user manual, data files",
    {"a first line <Mach-1 File>": r"\A\s*<Mach-1 File>", "a block <INFO>": "<INFO>"},
    block=r"<INFO>(?P<head>.*?)<END INFO>.*?<DATA>[ \t]*\n(?P<rows>.*?)(?:<END DATA>|\Z)",
    title=r"<(?!END)([^>/]+)>",
    lacking=("no row of names with units", "export the file again, with its data"),
)
CHIARO = Layout(
    "chiaro",
    "Optics11 Chiaro, Piuma (text)",
    "Optics11 Life, Piuma and Chiaro user manual, data files",
    {
        "a line 'k (N/m)'": r"(?m)^k \(N/m\)",
        "names with Load and Indentation": r"(?m)^Time[^\n]*\tIndentation \(",
    },
    pressing=True,  # a tip is pressed in, and may stick
)
LVM = Layout(
    "lvm",
    "National Instruments LabVIEW, measurement file (.lvm)",
    "National Instruments, Specification for the LabVIEW Measurement File",
    {
        "a first line 'LabVIEW Measurement'": r"\A\s*LabVIEW Measurement",
        "a line '***End_of_Header***'": r"(?m)^\*\*\*End_of_Header\*\*\*",
    },
    prepare=_with_times,
)
TWO_CLOCKS = Layout(
    "two-clocks",
    "a laboratory's own CSV with a clock for each channel",
    "any logger that stamps its channels one by one",
    {
        "two columns of time, one named after force or displacement, and both channels": (
            lambda lines: two_clock_header(lines) is not None
        ),
    },
    header=two_clock_header,
    lacking=("the two clocks cannot be distinguished", "name the clocks t_disp_s and t_force_s"),
)
TABLE = Layout(
    "table",
    "a table of named columns with units (rheometers, most programs)",
    "Anton Paar RheoCompass, export of tables; ISO 6721-10 for the names",
    {
        "names of time, displacement or strain, and force or stress, with units or numbers below, "
        "and no name of a tidy file": _has_table,
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
        "none: the user knows the file",
        {"three columns, which --columns states": ""},
        general=True,
        header=lambda lines, _: stated_header(lines, stated, file),
        prepare=own.prepare if own else bytes,
    )
