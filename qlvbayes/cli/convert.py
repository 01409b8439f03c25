"""``qlvbayes convert``: files as machines write them, made tidy."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.cli.console import err, out, waiting
from qlvbayes.cli.plainoptions import AsJson, Style, split_names
from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.answers import FILE, SIGNS, Answers, UnsureError
from qlvbayes.io.formats.catalogue import FORMATS, own_formats
from qlvbayes.io.formats.conversion import Conversion, convert, told
from qlvbayes.io.formats.format import AbstractFormat
from qlvbayes.io.formats.tidy import write_tidy

Files = Annotated[list[Path], typer.Argument(help="Files as machines write them.")]
PadName = Annotated[str, typer.Option(help="Pad's name: one for all files, or one a file.")]
TestNames = Annotated[str, typer.Option(help="Names of the tests, as 'slow,fast'.")]
Sign = Annotated[
    str | None,
    typer.Option(
        help=f"What to turn over so that pressing is positive: {', '.join(SIGNS)}.",
        show_default=False,
    ),
]
ContactPlace = Annotated[
    str | None,
    typer.Option(
        help=f"Displacement at contact in the tidy file's unit, or '{FILE}': its own zero.",
        show_default=False,
    ),
]
UnitsSaid = Annotated[
    str | None,
    typer.Option(
        help="Units of time, displacement, force where the files tell none: s,mm,N.",
        show_default=False,
    ),
]
Area = Annotated[
    float | None,
    typer.Option(
        help="Area (mm2), where strain meets force or displacement stress.", show_default=False
    ),
]
FormatsFile = Annotated[
    Path | None, typer.Option(help="A Python file with formats of your own.", show_default=False)
]


def convert_command(
    files: Files,
    output: Annotated[Path, typer.Option("-o", "--output", help="A .csv or .csv.gz file.")],
    pad: PadName = "",
    test: TestNames = "",
    sign: Sign = None,
    contact: ContactPlace = None,
    units: UnitsSaid = None,
    area: Area = None,
    formats_file: FormatsFile = None,
    style: Style = None,
    as_json: AsJson = False,
) -> None:
    """Turn files of testing machines into one tidy CSV file, and say what was found in them.

    Layouts are told by the files' first bytes. Sign, zero, units, sampling, dropped rows and
    clocks are found, told with their numbers, and drawn in a picture beside the output. What a
    file leaves open is asked on a terminal, and refused in a pipe.
    """
    if output.resolve() in [file.resolve() for file in files]:
        remedy = "choose another name with -o"
        raise InputError("this file would be written over", file=output, remedy=remedy)
    kinds = FORMATS if formats_file is None else (*FORMATS, *own_formats(formats_file))
    said = Said(sign, contact, units, area, tuple(split_names(pad)), tuple(split_names(test)))
    found = converted(files, said, kinds)
    write_tidy(found, output)
    picture = _picture(found, output)
    if as_json:
        print(json.dumps([test.as_dict() for test in found.tests], allow_nan=False))
        return
    for one in found.tests:
        out.print(*told(one), sep="\n  ")
    out.print(f"wrote {output}, picture {picture}")


@dataclass(frozen=True)
class Said:
    """The options as they were typed, or answered."""

    sign: str | None
    contact: str | None
    units: str | None
    area: float | None
    pads: tuple[str, ...]
    tests: tuple[str, ...]

    def answers(self) -> Answers:
        """As the files are read with them; InputError where one cannot be used."""
        return Answers.of(self.sign, self.contact, self.units, self.area, self.pads, self.tests)


def converted(files: list[Path], said: Said, kinds: tuple[type[AbstractFormat], ...]) -> Conversion:
    """Convert; on a terminal ask for what is missing, as often as needed."""
    while True:
        try:
            with waiting("reading"):
                return convert(files, said.answers(), kinds)
        except UnsureError as error:
            if not (sys.stdin.isatty() and err.is_terminal):
                raise
            err.print(str(error))
            kind = float if error.option == "area" else str
            answer = typer.prompt(error.question, type=kind, err=True)
            said = replace(said, **{error.option: answer})


def _picture(found: Conversion, output: Path) -> Path:
    # here, so that other commands do not wait for matplotlib
    from qlvbayes.plots.conversion import plot_conversion
    from qlvbayes.plots.files import save_figure

    stem = output.name.removesuffix(".gz").removesuffix(".csv")
    return save_figure(plot_conversion(found), output.with_name(stem))
