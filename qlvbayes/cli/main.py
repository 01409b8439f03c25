"""Run the command line: choose the subcommand, and report an error in one line."""

from __future__ import annotations

import ast
import inspect
import os
import sys
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes import __version__
from qlvbayes.cli.options import OPTIONS, Command, with_options
from qlvbayes.io.files import bundled
from qlvbayes.io.wording import as_typed, joined, visible
from qlvbayes.parallel.running import FailedError, fault_of
from qlvbayes.plots.catalogue import figures_of

INTERRUPTED = 130

COMMANDS = {
    "look": "look",
    "study": "study",
    "fit": "study",
    "check": "study",
    "diagnose": "study",
    "app": "app",
    "compare": "compare",
    "design": "design",
    "report": "study",
    "export": "export",
    "effects": "effects",
    "simulate": "simulate",
    "benchmark": "benchmark",
}
"""Module of each command's function: importing all takes longer than many commands run."""
_ALSO = {"convert": "look", "predict": "check"}
"""Names that scripts use, of what other commands do: 'look -o FILE.csv', 'check --program'."""


def application(names: Iterable[str] = tuple(COMMANDS)) -> typer.Typer:
    """Return the application with some commands by name, by default all."""
    app = _empty_application()
    for name in names:
        command = getattr(import_module(f"qlvbayes.cli.{COMMANDS[name]}"), name)
        text = _help(name, inspect.getdoc(command) or "")
        app.command(name, cls=Command, help=text)(with_options(command))
    return app


def _help(name: str, text: str) -> str:
    """Return a docstring as the help of a command: each paragraph in one line, for any terminal.

    FIGURES stands for the names of the figures that the command leaves in the folder of each pad.
    """
    text = text.partition(OPTIONS)[0].strip()
    text = text.replace("FIGURES", joined([one.name for one in figures_of(name)]))
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


def overview() -> typer.Typer:
    """Return every command by its name and description alone, read from the source.

    For the list of commands, and for a word that is none of them: nothing else is imported.
    """
    app = _empty_application()
    for name, module in COMMANDS.items():
        tree = ast.parse(Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8"))
        functions = (one for one in tree.body if isinstance(one, ast.FunctionDef))
        text = next(ast.get_docstring(one) for one in functions if one.name == name) or ""
        app.command(name, help=text.partition(OPTIONS)[0].strip())(lambda: None)
    return app


def _empty_application() -> typer.Typer:
    """Return the application without commands."""
    app = typer.Typer(
        help="Viscoelastic constants of soft pads from force-displacement tests.\n\n"
        "Begin with: qlvbayes study FILE.csv -o OUT",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
    )
    app.callback()(_general)  # without a callback, typer takes no name for a single command
    return app


def _print_version(asked: bool) -> None:
    if asked:
        print(f"qlvbayes {__version__}")
        raise typer.Exit


def _general(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Take the options of no command."""


def run() -> None:
    """Run the command; exit with status 2 and one line on invalid input, never a traceback."""
    typed = [_ALSO.get(word, word) if k == 0 else word for k, word in enumerate(sys.argv[1:])]
    if typed == ["study"]:
        file, hint = bundled("hidden.csv"), ""
        if file.exists():
            command = as_typed("qlvbayes", "study", str(file), "-o", "hidden")
            hint = f", or try a simulated pad: {command}"
        _stop(2, f"no file given; type qlvbayes study FILE.csv -o OUT{hint}")
    names = [word for word in (_completed() or typed)[:1] if word in COMMANDS]
    app = application(names) if names else overview()
    if os.environ.get("QLVBAYES_DEBUG"):
        app(typed)
    try:
        try:
            app(typed)
        finally:
            sys.stdout.flush()  # here, where a closed pipe is still caught
    except SystemExit as stop:
        if stop.code == INTERRUPTED:  # typer's status for Ctrl-C
            _stop(INTERRUPTED, "interrupted; the same command goes on where it stopped")
        raise
    except BrokenPipeError:
        os._exit(1)  # the pipe is closed: no message can be read
    except FailedError as error:
        _stop(error.status, *error.lines)
    except Exception as error:
        fault = fault_of(error)
        _stop(fault.status, fault.text)


def _completed() -> list[str]:
    """Return the words of a line to be completed by a shell, if it ends in an option.

    A command's options take a second or more to import, and file names the shell completes alone.
    """
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
    words = line.split()[1:] if "_QLVBAYES_COMPLETE" in os.environ else []
    return words if words and words[-1].startswith("-") else []


def _stop(status: int, *lines: str) -> None:
    for line in lines:
        print(f"qlvbayes: {visible(line)}", file=sys.stderr)
    sys.exit(status)
