"""Define options that several commands share, and the class of all commands.

An option is a parameter of its command's function. Its help stands in the function's docstring,
below ``Options:``, a line ``parameter WORDS: help`` each: words that begin with a dash are the
option's names, ``0..9`` is its range, and one in capitals makes it an argument called so. A
parameter that is a dataclass stands for options that its fields are.

What the help does not need is imported where it is used: a model takes seconds to import.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, is_dataclass
from functools import cached_property, wraps
from inspect import Parameter, getdoc, signature
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
OPTIONS = "Options:\n"
"""Head of the part of a docstring that has the help of the options."""
_SHARED = """Options:
folder FOLDER: The folder that 'fit' or 'study' wrote.
output -o --output: Folder for the results.
pads --pads --pad: Only these pads, as 'B,C'.
data: The measurements, if they have moved since the fit: file or folder.
seed 0..: Makes a run repeat.
as_json --json: Print JSON.
jobs --jobs --cluster: Processes that work side by side, each at a pad of its own; 0: as many as
    cores; or the address of a Dask scheduler whose workers do it, as tcp://HOST:8786. Results do
    not depend on it.
"""
_ENTRY = re.compile(r"(\w+)((?: [^\s:]+)*): (.*)")


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


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """Return a function with the options that a command's signature and docstring describe."""
    scope = sys.modules[command.__module__].__dict__
    groups: dict[str, tuple[Any, list[str]]] = {}
    single: list[Parameter] = []
    for name, one in signature(command, eval_str=True).parameters.items():
        kind: Any = one.annotation
        if is_dataclass(one.annotation):
            fields = signature(kind, eval_str=True).parameters.values()
            groups[name] = kind, [field.name for field in fields]
            single += [_described(field, _entries(kind), {}) for field in fields]
        else:
            single.append(_described(one, _entries(command), scope))

    @wraps(command)
    def run(**given: Any) -> None:
        for name, (kind, fields) in groups.items():
            given[name] = kind(**{field: given.pop(field) for field in fields})
        command(**given)

    run.__signature__ = signature(command, eval_str=True).replace(parameters=single)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in single}
    return run


def _entries(of: Any) -> dict[str, tuple[list[str], str]]:
    """Return the words and the help of each option in a docstring, or of those that all share."""
    found: dict[str, tuple[list[str], str]] = {}
    for text in (_SHARED, getdoc(of) or ""):
        for line in text.partition(OPTIONS)[2].splitlines():
            if match := _ENTRY.fullmatch(line):
                name = match[1]
                found[name] = match[2].split(), match[3]
            else:
                found[name] = found[name][0], f"{found[name][1]} {line.strip()}"
    return found


def _described(
    one: Parameter, entries: dict[str, tuple[list[str], str]], scope: Mapping[str, Any]
) -> Parameter:
    """Return a parameter as typer takes it; ``{NAME}`` in its help is a list of the module."""
    words, text = entries[one.name]
    for name in re.findall(r"\{(\w+)\}", text):
        several = scope[name] if isinstance(scope[name], str) else ", ".join(scope[name])
        text = text.replace(f"{{{name}}}", several)
    metavar = next((word for word in words if word.isupper()), None)
    if metavar is not None:
        own = None if metavar.lower() == one.name else metavar
        info: Any = typer.Argument(help=text, metavar=own, show_default=False)
    else:
        names = [word for word in words if word.startswith("-")]
        if not names and one.annotation is bool:
            names = [f"--{one.name.replace('_', '-')}"]
        low, _, high = next((word for word in words if ".." in word), "").partition("..")
        info = typer.Option(
            *names, help=text, min=int(low) if low else None, max=int(high) if high else None,
            show_default=one.default not in (None, ""),
        )  # fmt: skip
    return one.replace(kind=Parameter.KEYWORD_ONLY, annotation=Annotated[one.annotation, info])


@dataclass(frozen=True)
class WorkOptions:
    """Options that say which workers do the work, and which part of it.

    Options:
    shard: Do one part of many, as 3/200, or in an array of SLURM as slurm; 'report --gather' then
        makes what is made of all.
    """

    jobs: str = "1"
    shard: str | None = None

    def engine(self) -> AbstractContextManager[Engine | None]:
        """Return the engine for a ``with`` statement, which yields None for this process."""
        if "://" in self.jobs:
            return opened_engine(cluster=self.jobs)
        if not self.jobs.isdecimal():
            raise InputError(f"--jobs {self.jobs!r}", remedy="write a number, or tcp://HOST:PORT")
        return opened_engine(int(self.jobs) or cores())

    @property
    def part(self) -> Shard:
        """Part of the pads that is run; reading it raises InputError on an invalid --shard."""
        return Shard.from_text(self.shard) if self.shard else Shard()


@dataclass(frozen=True)
class InputOptions:
    """Options of every command that reads measurements.

    Options:
    files FILE: Measurements: tidy .csv or .csv.gz files, or as testing machines write them; files,
        or folders of them. Pads of several tidy files are named after their files; machines' files
        are tests of one pad.
    pads --pads --pad: Only these pads, as 'B,C'; of machines' files, which name none, the pads'
        names: one for all, one a file, or one a test.
    settings: A study.toml, as 'study' writes it: any of the settings below, files and pads.
    set: A setting, as 'sign=force', in place of --sign force; repeatable.
    """

    files: list[Path] | None = None
    pads: str = ""
    settings: Path | None = None
    set: list[str] | None = None

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
            self.paths, only=lambda known: among(self.pad_words, known), shard=part,
            convert=lambda files, pads: converted(files, settings, pads),
            stated=settings.states_reading, pad_names=settings["pad-from"] is None,
        )  # fmt: skip


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
                answers = settings.answers(pads)
                found = convert(files, answers, settings.formats, without_faulty=True)
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
