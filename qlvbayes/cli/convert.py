"""``qlvbayes convert``: files as machines write them, made tidy."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from qlvbayes.cli.console import err, out, waiting
from qlvbayes.cli.groups import with_groups
from qlvbayes.cli.options import AsJson, Style, split_names
from qlvbayes.io.checks import InputError
from qlvbayes.io.escaping import as_typed
from qlvbayes.io.formats.answers import FILE, SIGNS, Answers, UnsureError
from qlvbayes.io.formats.catalogue import FORMATS, own_formats
from qlvbayes.io.formats.conversion import Conversion, convert, in_short
from qlvbayes.io.formats.format import AbstractFormat
from qlvbayes.io.formats.tidy import write_tidy
from qlvbayes.io.wording import plain

Files = Annotated[list[Path], typer.Argument(help="Files as machines write them.")]
PadName = Annotated[
    str, typer.Option(help="Pad's name: one for all files, one a file, or one a test.")
]
PadFrom = Annotated[
    str | None,
    typer.Option(
        help="A regular expression that finds the pad's name in each test's, as '^[A-Z]+' "
        "finds AA in AA1: for files of several specimens.",
        show_default=False,
    ),
]
TestNames = Annotated[str, typer.Option(help="Names of the tests, as 'slow,fast'.")]
Sign = Annotated[
    str | None,
    typer.Option(
        help=f"What to turn over so that pressing is positive: {', '.join(SIGNS)}.",
        show_default=False,
    ),
]
Contact = Annotated[
    str | None,
    typer.Option(
        help=f"Displacement at contact in the tidy file's unit, or '{FILE}': its own zero.",
        show_default=False,
    ),
]
Units = Annotated[
    str | None,
    typer.Option(
        help="Units of time, displacement, force where the files state none: s,mm,N.",
        show_default=False,
    ),
]
Area = Annotated[
    float | None,
    typer.Option(
        help="Area (mm2), where strain meets force or displacement stress.", show_default=False
    ),
]
Columns = Annotated[
    str | None,
    typer.Option(
        help="Columns of time, displacement (or strain) and force (or stress), by name as t,x,F "
        "or by number as 1,2,3: for a table whose columns are not recognised.",
        show_default=False,
    ),
]
FormatsFile = Annotated[
    Path | None, typer.Option(help="A Python file with formats of your own.", show_default=False)
]


@dataclass(frozen=True)
class ReadingOptions:
    """Options that say how files of testing machines are read."""

    pad: PadName = ""
    pad_from: PadFrom = None
    test: TestNames = ""
    sign: Sign = None
    contact: Contact = None
    units: Units = None
    area: Area = None
    columns: Columns = None
    formats_file: FormatsFile = None

    @property
    def formats(self) -> tuple[type[AbstractFormat], ...]:
        """Formats of the package, then those of the user's file."""
        own = () if self.formats_file is None else own_formats(self.formats_file)
        return (*FORMATS, *own)

    def answers(self) -> Answers:
        """Return the answers for reading files; raise InputError where one cannot be used."""
        pads, tests = tuple(split_names(self.pad)), tuple(split_names(self.test))
        return Answers.from_words(
            self.sign, self.contact, self.units, self.area, pads, tests, self.pad_from, self.columns
        )

    def arguments(self) -> list[str]:
        """Return the options that are set, as arguments of the command ``convert``."""
        options = {
            "--sign": self.sign,
            "--contact": self.contact,
            "--units": self.units,
            "--area": None if self.area is None else plain(self.area, 6),
            "--columns": self.columns,
            "--pad": ",".join(split_names(self.pad)),
            "--pad-from": self.pad_from,
            "--test": ",".join(split_names(self.test)),
            "--formats-file": None if self.formats_file is None else str(self.formats_file),
        }
        return [word for option, value in options.items() if value for word in (option, value)]


@with_groups
def convert_command(
    files: Files,
    output: Annotated[Path, typer.Option("-o", "--output", help="A .csv or .csv.gz file.")],
    *,
    reading: ReadingOptions,
    style: Style = None,
    as_json: AsJson = False,
) -> None:
    """Turn files of testing machines into one tidy CSV file, and report how they were read.

    Layouts are recognised by the files' first bytes. Sign, zero, units, sampling, dropped rows and
    clocks are determined, reported with their values, and drawn in a picture next to the output.
    What a file leaves open is asked on a terminal, and refused in a pipe. Of several files those
    that cannot be used are left out and named last, with status 2.
    """
    if output.resolve() in [file.resolve() for file in files]:
        remedy = "choose another name with -o"
        raise InputError("this file would be written over", file=output, remedy=remedy)
    conversion = converted(files, reading)
    write_tidy(conversion, output)
    picture = _picture(conversion, output)
    if as_json:
        print(json.dumps([test.as_dict() for test in conversion.tests], allow_nan=False))
    else:
        out.print(*in_short(conversion.notices), sep="\n", soft_wrap=True)
        out.print(f"wrote {output}, picture {picture}")
    if conversion.faults:
        sys.stdout.flush()
        _stop_without(conversion, files, reading.pad)


def _stop_without(conversion: Conversion, files: list[Path], pad: str) -> NoReturn:
    """Name the files that were left out, and the command that goes on without them."""
    bad = {str(fault.file): fault for fault in conversion.faults}
    names = split_names(pad)
    kept = ",".join(n for n, f in zip(names, files, strict=False) if str(f) not in bad)
    words = [kept if len(names) > 1 and word == pad else word for word in sys.argv[1:]]
    again = as_typed("qlvbayes", *(word for word in words if word not in bad))
    for fault in conversion.faults:
        err.print(f"qlvbayes: {fault}")
    left = f"{len(bad)} of {len(files)} files {'is' if len(bad) == 1 else 'are'} left out"
    err.print(f"qlvbayes: {left} ({', '.join(bad)}); without: {again}")
    raise typer.Exit(2)


def converted(files: Sequence[Path], reading: ReadingOptions) -> Conversion:
    """Convert files; on a terminal ask for what they leave open, as often as needed."""
    formats = reading.formats
    asks = sys.stdin.isatty() and err.is_terminal
    while True:
        try:
            with waiting("reading"):
                conversion = convert(files, reading.answers(), formats, without_faulty=True)
            open_ = (
                fault for fault in conversion.faults if asks and isinstance(fault, UnsureError)
            )
            if (unsure := next(open_, None)) is None:
                return conversion
            raise unsure
        except UnsureError as error:
            if not asks:
                raise
            err.print(str(error))
            kind = float if error.option == "area" else str
            answer = typer.prompt(error.question, type=kind, err=True)
            reading = replace(reading, **{error.option: answer})


def _picture(conversion: Conversion, output: Path) -> Path:
    # imported here, so that other commands do not wait for matplotlib
    from qlvbayes.plots.conversion import plot_conversion
    from qlvbayes.plots.files import save_figure

    stem = output.name.removesuffix(".gz").removesuffix(".csv")
    return save_figure(plot_conversion(conversion), output.with_name(stem))
