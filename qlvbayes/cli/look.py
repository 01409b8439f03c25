"""``qlvbayes look``: what is in the files, before anything is fitted; or made one tidy file."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer
from rich.table import Table
from rich.text import Text

from qlvbayes.cli.console import err, out, table, waiting
from qlvbayes.cli.options import InputOptions, converted, split_names
from qlvbayes.cli.settings import StudySettings
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import as_typed, plain

if TYPE_CHECKING:
    from qlvbayes.io.conversion import Conversion
    from qlvbayes.io.data import Measurements
    from qlvbayes.io.units import UnitSystem
    from qlvbayes.pipeline.source import Source
    from qlvbayes.report.firstlook import FirstLook, PadSeen, Shown

_STYLES = {"yes": "green", "hardly": "yellow", "no": "red"}


def look(
    inputs: InputOptions, output: Path | None = None, *, cause: bool = False, as_json: bool = False
) -> None:
    """Look at measurements before anything is fitted: what is in them, and what they can show.

    Shows the phases, speeds and sampling of each test, and for each pad its noise, its contact and
    the readings that are left out. Says which parts of the model the tests can show: yes, hardly
    (these tests cannot distinguish it from something else) or no, with the reason and the test that
    would show it.
    With -o OUT it leaves OUT/look.json and for each pad the picture OUT/look_<pad>.png: readings,
    the motion taken from them, and what is left between both.

    With -o FILE.csv it turns files of testing machines into one tidy file and leaves a
    picture next to it. Layouts are recognised by the files' first bytes; sign, zero, units,
    sampling, dropped rows and clocks are determined and reported. What a file leaves open is asked
    on a terminal, and refused in a pipe.

    Options:
    output -o --output: Folder for look.json and the pictures; or a .csv or .csv.gz file, to make
        machines' files tidy. Without it nothing is written.
    cause: Fit the plain model once, and print a first guess of what it misses, learnt from
        simulated pads; 'diagnose' decides.
    """
    if output is not None and output.name.lower().endswith((".csv", ".csv.gz")):
        _make_tidy(inputs, output, as_json=as_json)
        return
    # imported here, so that the help does not wait for them
    from qlvbayes.motion.experiment import prepare
    from qlvbayes.motion.pad import arguments_of, refuse_unknown
    from qlvbayes.report.firstlook.looking import look_into

    chosen, source = inputs.chosen, inputs.source()
    studies, refused = _studies(source)
    parts, gaps = chosen["use"], chosen["leave-out"]
    if studies:
        refuse_unknown([pad for one in studies for pad in one.pads], parts, gaps)
    if studies and not as_json:
        out.print(source.grouping, soft_wrap=True)
    looks = []
    for study in studies:
        folder = output
        if output is not None and len(studies) > 1:
            folder = output / Path(study.source).stem
        files: tuple[str, ...] = (study.source,)
        commands: tuple[str, ...]
        arguments = [*arguments_of(study.pads, parts, gaps), *_of_specimen(chosen)]
        if source.conversion is None:
            commands = (_study_of(study.source, arguments),)
        else:
            files = tuple(dict.fromkeys(str(test.file) for test in source.conversion.tests))
            named = ["--pad", inputs.pad_words] if inputs.pad_words else []
            reading = [*files, *named, *chosen.arguments()]
            commands = (
                as_typed("qlvbayes", "look", *reading, "-o", "tidy.csv"),
                as_typed("qlvbayes", "study", *reading, *arguments, "-o", "results"),
            )
        with waiting("looking"):
            seen, figures = look_into(
                folder, study, study.pads, prepared=partial(prepare, **chosen.readings),
                bonded=chosen["bonded"], files=files, next_commands=commands,
            )  # fmt: skip
        looks.append(seen)
        if not as_json:
            show_look(seen, figures)
        if cause:
            _print_guesses(study, inputs, as_json=as_json)
    if as_json and looks:
        text = [one.to_json() for one in looks]
        print(text[0] if len(text) == 1 else f"[{','.join(text)}]")
    for error in refused[:-1]:
        err.print(f"notice: left out: {error}")
    if refused:
        raise InputError(refused[-1])


def _make_tidy(inputs: InputOptions, output: Path, *, as_json: bool) -> None:
    # imported here, so that the help does not wait for them
    from qlvbayes.io.conversion import in_short, write_csv, write_tidy
    from qlvbayes.io.files import stem_of
    from qlvbayes.io.tidy import joined
    from qlvbayes.pipeline.source import files_at, is_tidy
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.look import plot_conversion

    files = [file for path in inputs.paths for file in files_at(path)]
    if output.resolve() in [file.resolve() for file in files]:
        remedy = "choose another name with -o"
        raise InputError("this file would be written over", file=output, remedy=remedy)
    pads = tuple(split_names(inputs.pad_words))
    stated = inputs.chosen.states_reading
    following = _study_of(str(output), _of_specimen(inputs.chosen), output.parent)
    if len(files) > 1 and len(pads) == 1 and not stated and all(map(is_tidy, files)):
        write_csv(joined(files, pads[0]), output)
        if as_json:
            tests = [{"file": str(one), "pad": pads[0], "test": stem_of(one)} for one in files]
            print(json.dumps(tests))
            return
        out.print(f"wrote {output}: {len(files)} tests of pad {pads[0]}")
        _print_next([following])
        return
    conversion = converted(files, inputs.chosen, pads)
    write_tidy(conversion, output)
    stem = output.name.removesuffix(".gz").removesuffix(".csv")
    picture = save_figure(plot_conversion(conversion), output.with_name(stem))
    if as_json:
        print(json.dumps([test.as_dict() for test in conversion.tests], allow_nan=False))
    else:
        out.print(*in_short(conversion.notices), sep="\n", soft_wrap=True)
        out.print(f"wrote {output}, picture {picture}")
        _print_next([following])
    if conversion.faults:
        sys.stdout.flush()
        _stop_without(conversion, files, inputs.pad_words)


def _stop_without(conversion: Conversion, files: list[Path], pads: str) -> NoReturn:
    """Name the files that were left out, and the command that goes on without them."""
    bad = {str(fault.file): fault for fault in conversion.faults}
    names = split_names(pads)
    kept = ",".join(n for n, f in zip(names, files, strict=False) if str(f) not in bad)
    words = [kept if len(names) > 1 and word == pads else word for word in sys.argv[1:]]
    again = as_typed("qlvbayes", *(word for word in words if word not in bad))
    for fault in conversion.faults:
        err.print(f"qlvbayes: {fault}")
    left = f"{len(bad)} of {len(files)} files {'is' if len(bad) == 1 else 'are'} left out"
    err.print(f"qlvbayes: {left} ({', '.join(bad)}); without: {again}")
    raise typer.Exit(2)


def _studies(source: Source) -> tuple[list[Measurements], list[str]]:
    """Return the measurements of each file, or of machines' files together; and the refusals."""
    from qlvbayes.io.data import Measurements

    by_file: dict[str, Measurements] = {}
    refused: list[str] = []
    with waiting("reading"):
        for one in source:
            if not isinstance(one, Measurements):
                refused.append(one.text)
                continue
            before = by_file.get(one.source)
            pads = one.pads if before is None else (*before.pads, *one.pads)
            by_file[one.source] = replace(one, pads=pads)
    return list(by_file.values()), refused


def _print_guesses(study: Measurements, inputs: InputOptions, *, as_json: bool) -> None:
    """Print a first guess of what each pad's model misses; next to JSON, on standard error."""
    from qlvbayes.guess.guess import first_guess
    from qlvbayes.model.choices import Choices
    from qlvbayes.motion.experiment import prepare

    chosen = inputs.chosen
    bonded = study.units.bonded_default if chosen["bonded"] is None else chosen["bonded"]
    for pad in study.pads:
        with waiting("fitting once"):
            guess = first_guess(prepare(pad, **chosen.readings), Choices(bonded=bonded))
        (err if as_json else out).print(f"pad {pad.name}: {guess.sentence}", soft_wrap=True)


def _of_specimen(chosen: StudySettings) -> list[str]:
    """Return the options that say how the specimen is held and which readings count."""
    held = {None: [], True: ["--bonded"], False: ["--loose"]}[chosen["bonded"]]
    return [*held, *["--keep-all-readings"] * bool(chosen["keep-all-readings"])]


def _study_of(file: str, arguments: Sequence[str], folder: Path = Path()) -> str:
    """Return the command that studies a tidy file, with results in a folder, as it is typed."""
    out = folder / f"{Path(file).name.partition('.')[0]}_results"
    return as_typed("qlvbayes", "study", file, "-o", str(out), *arguments)


def _print_next(commands: Sequence[str]) -> None:
    if commands:
        out.print("next:", *(f"  {command}" for command in commands), sep="\n", soft_wrap=True)


def show_look(look: FirstLook, figures: Sequence[Path]) -> None:
    """Print the tables and lines of a first look."""
    from qlvbayes.io.conversion import in_short
    from qlvbayes.report.firstlook.words import lines_of

    if look.notices:
        lines = (f"  {text}" for text in in_short(look.notices))
        out.print("as read:", *lines, sep="\n", soft_wrap=True)
    for pad, figure in zip_longest(look.pads, figures):
        out.print(_tests(pad, look.units))
        for line in lines_of(pad, look.units):
            out.print(f"  {line}", soft_wrap=True)
        for notice in pad.notices:
            out.print(f"  {notice.removeprefix(f'pad {pad.pad}: ')}", soft_wrap=True)
        if figure is not None:
            out.print(f"  picture: {figure}")
        out.print(_shown(f"pad {pad.pad}: what these tests show", pad.shown))
    if look.between:
        out.print(_shown("the pads, side by side", look.between))
    cautions = [caution for pad in look.pads for caution in pad.cautions]
    if cautions:
        out.print("before a fit:", *(f"  {text}" for text in cautions), sep="\n", soft_wrap=True)
    _print_next(look.next)


def _tests(pad: PadSeen, units: UnitSystem) -> Table:
    from qlvbayes.report.firstlook.words import phases_in_words

    fluid = f", {pad.fluid}" if pad.fluid else ""
    title = f"pad {pad.pad}{fluid}: {len(pad.tests)} test{'' if len(pad.tests) == 1 else 's'}"
    depth = units.displacement_name if units.dimensionless else f"depth {units.displacement}"
    left = any(test.left_out for test in pad.tests)
    made = table(
        title, "test", "role", f">speed {units.speed}", f">{depth}",
        f">{units.force_name} {units.force}", "what the platen does", "readings, interval",
        *[">left out"] * left,
    )  # fmt: skip
    for test in pad.tests:
        rate = "" if test.rate is None else plain(test.rate)
        interval = test.sampling.replace(" rows", "").replace(" a row", "")
        made.add_row(
            test.test, test.role, rate, plain(test.depth), plain(test.peak),
            phases_in_words(test.phases), interval, *[str(test.left_out or "")] * left,
        )  # fmt: skip
    return made


def _shown(title: str, shown: Sequence[Shown]) -> Table:
    made = table(title, "part of the model", "shown", "because", "what would show it")
    for one in shown:
        names = ", ".join(name for name in (*one.constants, *one.effects) if name != one.about)
        about = f"{one.about} ({names})" if names else one.about
        made.add_row(about, Text(one.answer, style=_STYLES[one.answer]), one.reason, one.remedy)
    return made
