"""``qlvbayes look``: what is in the files, before anything is fitted."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from qlvbayes.cli.console import err, out, waiting
from qlvbayes.cli.convert import ReadingOptions, converted
from qlvbayes.cli.groups import with_groups
from qlvbayes.cli.options import (
    AsJson,
    Bonded,
    KeepAllReadings,
    LeaveOut,
    Pads,
    Style,
    Use,
    chosen_pads,
)
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, measurements_of, read_measurements
from qlvbayes.io.escaping import as_typed
from qlvbayes.io.formats.conversion import in_short
from qlvbayes.io.reading.csvtext import digest
from qlvbayes.io.reading.dialect import sniff
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.pad import arguments_of, refuse_unknown
from qlvbayes.pipeline.looking import look_into
from qlvbayes.pipeline.source import files_at
from qlvbayes.report.firstlook import FirstLook, PadSeen, Shown
from qlvbayes.report.firstlook.words import lines_of, phases_in_words

_STYLES = {"yes": "green", "hardly": "yellow", "no": "red"}


@with_groups
def look_command(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Measurements: tidy .csv, or as machines write them; files, or folders of them."
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for look.json and the pictures.")
    ] = Path("look"),
    pads: Pads = "",
    *,
    reading: ReadingOptions,
    bonded: Bonded = None,
    keep_all_readings: KeepAllReadings = False,
    use: Use = None,
    leave_out: LeaveOut = None,
    style: Style = None,
    as_json: AsJson = False,
) -> None:
    """Look at measurements before anything is fitted: what is in them, and what they can show.

    Shows the phases, speeds and sampling of each test, and for each pad its noise, its contact and
    the readings that are left out. Says which parts of the model the tests can show: yes, hardly
    (these tests cannot distinguish it from something else) or no, with the reason and the test that
    would show it.
    Leaves OUT/look.json and for each pad the picture OUT/look_<pad>.png: readings, the motion taken
    from them, and what is left between both.
    """
    inputs = _read([file for path in files for file in files_at(path)], reading)
    parts, gaps = tuple(use or ()), tuple(leave_out or ())
    if inputs.studies:
        refuse_unknown([pad for one in inputs.studies for pad in one.study.pads], parts, gaps)
    looks: list[FirstLook] = []
    for one in inputs.studies:
        folder = output if len(inputs.studies) == 1 else output / Path(one.files[0]).stem
        with waiting("looking"):
            look, figures = look_into(
                folder, one.study, chosen_pads(one.study, pads), bonded=bonded,
                keep_all_readings=keep_all_readings, use=parts, leave_out=gaps, files=one.files,
                next_commands=one.commands(arguments_of(one.study.pads, parts, gaps)),
            )  # fmt: skip
        looks.append(look)
        if not as_json:
            show_look(look, figures)
    if as_json and looks:
        text = [look.to_json() for look in looks]
        print(text[0] if len(text) == 1 else f"[{','.join(text)}]")
    for error in inputs.refused[:-1]:
        err.print(f"notice: left out: {error}")
    if inputs.refused:
        raise inputs.refused[-1]


@dataclass(frozen=True)
class _Input:
    """Measurements, the files that they came from, and the commands to go on with."""

    study: Measurements
    files: tuple[str, ...]
    next: tuple[tuple[str, ...], ...]  # the words of each command; the last one is ``study``

    def commands(self, arguments: Sequence[str]) -> tuple[str, ...]:
        """Return the commands as they are typed, with further arguments of ``study``."""
        *before, study = self.next
        return tuple(as_typed(*words) for words in (*before, (*study, *arguments)))


@dataclass(frozen=True)
class _Inputs:
    """All measurements that could be read, and the errors of the files that were refused."""

    studies: tuple[_Input, ...]
    refused: tuple[InputError, ...]


def _read(files: Sequence[Path], reading: ReadingOptions) -> _Inputs:
    """Read tidy files one by one, and machine files together, as ``convert`` does.

    A file that cannot be read does not stop the others. A single machine file without options is
    read as every command reads it.
    """
    tidy = [file for file in files if _is_tidy(file)]
    machine = [file for file in files if file not in tidy]
    if tidy and not machine and (options := reading.arguments()):
        what = f"{options[0]} is for files as machines write them, and this one is tidy"
        raise InputError(what, file=tidy[0], remedy="leave it out")
    studies: list[_Input] = []
    refused: list[InputError] = []
    with waiting("reading"):
        for file in tidy:
            try:
                studies.append(_as_it_is(file))
            except InputError as error:
                refused.append(error)
    while machine:
        try:
            read, faults = _of_machines(machine, reading)
            studies.append(read)
            refused += faults
            break
        except InputError as error:
            refused.append(error)
            left = [file for file in machine if str(file) != str(error.file)]
            machine = left if len(left) < len(machine) else []
    return _Inputs(tuple(studies), tuple(refused))


def _is_tidy(file: Path) -> bool:
    try:
        return not sniff(file).columns.ignored
    except InputError:
        return False


def _as_it_is(file: Path) -> _Input:
    words = ("qlvbayes", "study", str(file), "-o", f"{file.name.partition('.')[0]}_results")
    return _Input(read_measurements(file), (str(file),), (words,))


def _of_machines(
    files: Sequence[Path], reading: ReadingOptions
) -> tuple[_Input, tuple[InputError, ...]]:
    """Return what could be read of machine files, and why others could not be read."""
    if len(files) == 1 and reading == ReadingOptions():
        return _as_it_is(files[0]), ()
    conversion = converted(files, reading)
    digests = "".join(digest(file) for file in files)
    sha256 = hashlib.sha256(digests.encode()).hexdigest()
    names = tuple(map(str, files))
    study = measurements_of(conversion, names[0], sha256)
    commands = (
        ("qlvbayes", "convert", *names, *reading.arguments(), "-o", "tidy.csv"),
        ("qlvbayes", "study", "tidy.csv", "-o", "results"),
    )
    return _Input(study, names, commands), conversion.faults


def show_look(look: FirstLook, figures: Sequence[Path]) -> None:
    """Print the tables and lines of a first look."""
    if look.notices:
        lines = (f"  {text}" for text in in_short(look.notices))
        out.print("as read:", *lines, sep="\n", soft_wrap=True)
    for pad, figure in zip(look.pads, figures, strict=True):
        out.print(_tests(pad, look.units))
        for line in lines_of(pad, look.units):
            out.print(f"  {line}", soft_wrap=True)
        for notice in pad.notices:
            out.print(f"  {notice.removeprefix(f'pad {pad.pad}: ')}", soft_wrap=True)
        out.print(f"  picture: {figure}")
        out.print(_shown(f"pad {pad.pad}: what these tests show", pad.shown))
    if look.between:
        out.print(_shown("the pads, side by side", look.between))
    cautions = [caution for pad in look.pads for caution in pad.cautions]
    if cautions:
        out.print("before a fit:", *(f"  {text}" for text in cautions), sep="\n", soft_wrap=True)
    if look.next:
        out.print("next:", *(f"  {command}" for command in look.next), sep="\n", soft_wrap=True)


def _tests(pad: PadSeen, units: UnitSystem) -> Table:
    fluid = f", {pad.fluid}" if pad.fluid else ""
    title = f"pad {pad.pad}{fluid}: {len(pad.tests)} test{'' if len(pad.tests) == 1 else 's'}"
    table = Table(title=title, title_justify="left", title_style="bold")
    depth = units.displacement_name if units.dimensionless else f"depth {units.displacement}"
    table.add_column("test", overflow="fold")
    table.add_column("role")
    for name in (f"speed {units.speed}", depth, f"{units.force_name} {units.force}"):
        table.add_column(name, justify="right")
    table.add_column("what the platen does")
    table.add_column("readings, interval")
    left = any(test.left_out for test in pad.tests)
    if left:
        table.add_column("left out", justify="right")
    for test in pad.tests:
        table.add_row(
            test.test,
            test.role,
            "" if test.rate is None else plain(test.rate),
            plain(test.depth),
            plain(test.peak),
            phases_in_words(test.phases),
            test.sampling.replace(" rows", "").replace(" a row", ""),
            *([str(test.left_out) if test.left_out else ""] if left else []),
        )
    return table


def _shown(title: str, shown: Sequence[Shown]) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    for name in ("part of the model", "shown", "because", "what would show it"):
        table.add_column(name)
    for one in shown:
        names = ", ".join(name for name in (*one.constants, *one.effects) if name != one.about)
        table.add_row(
            f"{one.about} ({names})" if names else one.about,
            Text(one.answer, style=_STYLES[one.answer]),
            one.reason,
            one.remedy,
        )
    return table
