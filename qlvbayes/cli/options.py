"""Define options that several commands share, and the class of all commands.

What their help does not need is imported where it is used: a model takes seconds to import.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, is_dataclass
from functools import cached_property, wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from qlvbayes.cli.console import err, waiting
from qlvbayes.cli.settings import FILE, KEYS, StudySettings, expanded, help_lines
from qlvbayes.io.checks import InputError, meant
from qlvbayes.io.runtime import cores
from qlvbayes.io.wording import listed
from qlvbayes.parallel.engines import Engine, opened_engine
from qlvbayes.parallel.running import Shard

if TYPE_CHECKING:
    from qlvbayes.io.conversion import Conversion
    from qlvbayes.pipeline.source import Source

STYLE = "--style FILE: a Matplotlib style file (.mplstyle) for the figures, over the package's own."
Pads = Annotated[str, typer.Option("--pads", "--pad", help="Only these pads, as 'B,C'.")]
OnePad = Annotated[str, typer.Option("--pads", "--pad", help="The pad. Default: the only one.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Files = Annotated[
    list[Path] | None,
    typer.Argument(
        help="Measurements: tidy .csv or .csv.gz files, or as testing machines write them; files, "
        "or folders of them. Pads of several tidy files are named after their files; machines' "
        "files are tests of one pad.",
        metavar="FILE",
        show_default=False,
    ),
]
PadsRead = Annotated[
    str,
    typer.Option(
        "--pads",
        "--pad",
        help="Only these pads, as 'B,C'; of machines' files, which name none, the pads' names: one "
        "for all, one a file, or one a test.",
    ),
]
SettingsFile = Annotated[
    Path | None,
    typer.Option(
        "--settings",
        help="A study.toml, as 'study' writes it: any of the settings below, files and pads.",
        show_default=False,
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", help="A setting, as 'sign=force', in place of --sign force; repeatable."),
]
Fitted = Annotated[Path, typer.Argument(help="The folder that 'fit' or 'study' wrote.")]
Out = Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")]
Data = Annotated[
    Path | None,
    typer.Option(
        help="The measurements, if they have moved since the fit: file or folder.",
        show_default=False,
    ),
]
EffectsFile = Annotated[
    Path | None, typer.Option(help="A Python file with effects of your own.", show_default=False)
]
Jobs = Annotated[
    str,
    typer.Option(
        "--jobs",
        "--cluster",
        help="Processes that work side by side, each at a pad of its own; 0: as many as cores; or "
        "the address of a Dask scheduler whose workers do it, as tcp://HOST:8786. Results do not "
        "depend on it.",
    ),
]
ShardText = Annotated[
    str | None,
    typer.Option(
        "--shard",
        help="Do one part of many, as 3/200, or in an array of SLURM as slurm; 'report --gather' "
        "then makes what is made of all.",
        show_default=False,
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Makes a run repeat.")]
SettingsSeed = Annotated[
    int | None, typer.Option(min=0, help="Makes a run repeat. Default: that of the settings, or 0.")
]


class Command(TyperCommand):
    """Command whose settings may be given as options, and whose figures take a style."""

    def __init__(self, *words: Any, **options: Any) -> None:
        if lines := help_lines(str(options.get("name"))):
            head = f"Settings, in {FILE} or as options:"
            options["epilog"] = "\n\n".join((head, *lines, STYLE))
        super().__init__(*words, **options)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of the command line, and draw its figures in the style of ``--style``."""
        left = list(args)
        place = next((k for k, x in enumerate(left) if x.partition("=")[0] == "--style"), len(left))
        equals, file = left[place].partition("=")[1:] if place < len(left) else ("", "")
        if equals or place + 1 < len(left):
            file = file if equals else left[place + 1]
            del left[place : place + (1 if equals else 2)]
            # imported here, so that commands do not wait for matplotlib
            from qlvbayes.plots.style import using

            ctx.with_resource(using(Path(file)))
        return super().parse_args(ctx, expanded(self.name or "", left))


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with one option for each field of those parameters that are dataclasses."""
    own = signature(command, eval_str=True)
    kinds: dict[str, Any] = {name: one.annotation for name, one in own.parameters.items()}
    grouped = [name for name, kind in kinds.items() if is_dataclass(kind)]
    groups = {name: signature(kinds[name], eval_str=True).parameters for name in grouped}
    single = [
        option.replace(kind=Parameter.KEYWORD_ONLY)
        for name, one in own.parameters.items()
        for option in groups.get(name, {name: one}).values()
    ]

    @wraps(command)
    def run(**given: Any) -> None:
        for name, options in groups.items():
            values = {option: given.pop(option) for option in options}
            given[name] = kinds[name](**values)
        command(**given)

    run.__signature__ = own.replace(parameters=single)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in single}
    return run


@dataclass(frozen=True)
class WorkOptions:
    """Options that say which workers do the work, and which part of it."""

    jobs: Jobs = "1"
    shard: ShardText = None

    def engine(self) -> AbstractContextManager[Engine | None]:
        """Return the engine for a ``with`` statement, which yields None for this process."""
        return engine_of_jobs(self.jobs)

    @property
    def part(self) -> Shard:
        """Part of the pads that is run; reading it raises InputError on an invalid --shard."""
        return Shard.from_text(self.shard) if self.shard else Shard()


@dataclass(frozen=True)
class InputOptions:
    """Options of every command that reads measurements."""

    files: Files = None
    pads: PadsRead = ""
    settings: SettingsFile = None
    set: Set = None

    @cached_property
    def chosen(self) -> StudySettings:
        """The settings of the file and of options."""
        return StudySettings.from_options(self.settings, self.set or ())

    @property
    def paths(self) -> list[Path]:
        """Files to read; InputError where there are none."""
        paths = list(self.files or self.chosen["files"] or ())
        if not paths:
            raise InputError("no file given", remedy="name measurements, as pads.csv")
        return paths

    @property
    def pad_words(self) -> str:
        """The pads as the user names them, here or in the file of settings."""
        return self.pads or self.chosen["pads"] or ""

    def source(self, part: Shard | None = None) -> Source:
        """Return the pads of the files; InputError on an unknown name in a single file."""
        from qlvbayes.pipeline.source import Source

        settings = self.chosen
        return Source.from_files(
            self.paths,
            only=lambda known: among(self.pad_words, known),
            shard=part,
            convert=lambda files, pads: converted(files, settings, pads),
            stated=settings.states_reading,
            pad_names=settings["pad-from"] is None,
        )


def engine_of_jobs(text: str) -> AbstractContextManager[Engine | None]:
    """Return what ``--jobs`` says: so many processes, or the Dask cluster of an address."""
    if "://" in text:
        return opened_engine(cluster=text)
    if not text.isdecimal():
        raise InputError(f"--jobs {text!r}", remedy="write a number, or tcp://HOST:PORT")
    return opened_engine(int(text) or cores())


def known_names(names: str, known: Collection[str], folder: Path, what: str = "fit") -> list[str]:
    """Return the names in ``A, B``.

    Raise InputError where a folder has no fit (or ``what``) of one.
    """
    for name in (selected := among(names, known)):
        if name not in known:
            remedy = f"{meant(name, known)}name of {listed(known)}"
            raise InputError(f"no {what} of pad '{name}'", file=folder, remedy=remedy)
    return selected


def among(text: str, known: Collection[str]) -> list[str]:
    """Return the names in ``A, B`` as a list; a known name may contain commas itself."""
    parts, names = text.split(","), []
    while parts:
        ends = range(len(parts), 1, -1)
        end = next((k for k in ends if ",".join(parts[:k]).strip() in known), 1)
        names.append(",".join(parts[:end]).strip())
        parts = parts[end:]
    return [name for name in names if name]


def split_names(text: str) -> list[str]:
    """Return the names in ``A, B`` as a list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def positive_values(option: str, text: str, example: str = "0.1,1,30") -> tuple[float, ...]:
    """Return the numbers in ``0.1, 1``; raise InputError where one is not above zero."""
    try:
        values = tuple(float(word) for word in split_names(text))
    except ValueError:
        values = (0.0,)
    if not all(0.0 < x < float("inf") for x in values):
        raise InputError(f"{option} {text!r} are not numbers above 0", remedy=f"write {example!r}")
    return values


def converted(
    files: Sequence[Path], settings: StudySettings, pads: tuple[str, ...] = ()
) -> Conversion:
    """Convert machines' files; on a terminal ask for what they leave open, as often as needed."""
    from qlvbayes.io.conversion import convert
    from qlvbayes.io.recording import UnsureError

    asks = sys.stdin.isatty() and err.is_terminal
    while True:
        try:
            with waiting("reading"):
                found = convert(
                    files, settings.answers(pads), settings.formats, without_faulty=True
                )
            unsure = next((one for one in found.faults if isinstance(one, UnsureError)), None)
            if unsure is None or not asks:
                return found
        except UnsureError as error:
            if not asks:
                raise
            unsure = error
        err.print(str(unsure))
        answer = typer.prompt(unsure.question, type=KEYS[unsure.option].kind, err=True)
        settings = StudySettings(settings.values | {unsure.option: answer})
