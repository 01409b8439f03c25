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
from qlvbayes.cli.command import Command
from qlvbayes.io.files import bundled
from qlvbayes.io.wording import as_typed, joined, visible
from qlvbayes.parallel.running import FailedError, fault_of
from qlvbayes.plots.catalogue import figures_of

INTERRUPTED = 130

_COMMANDS = {
    "look": "look.look_command",
    "study": "study.study_command",
    "fit": "fit.fit",
    "check": "check.check",
    "diagnose": "diagnose.diagnose_command",
    "app": "app.app_command",
    "compare": "compare.compare_command",
    "design": "design.design_command",
    "report": "report.report",
    "export": "export.export_command",
    "effects": "effects.effects",
    "simulate": "simulate.simulate",
    "benchmark": "benchmark.benchmark",
}
_HIDDEN = {"convert": "look.convert_command", "predict": "predict.predict_command"}
"""Names that scripts use, of what other commands do too: 'look -o FILE.csv', 'check --program'."""
"""Module and function of each command: importing all takes longer than many commands run."""


def application(names: Iterable[str] = tuple(_COMMANDS)) -> typer.Typer:
    """Return the application with some commands by name, by default all."""
    app = _empty_application()
    for name in names:
        module, _, function = (_COMMANDS | _HIDDEN)[name].partition(".")
        command = getattr(import_module(f"qlvbayes.cli.{module}"), function)
        text = _help(name, inspect.getdoc(command) or "")
        app.command(name, cls=Command, help=text, hidden=name in _HIDDEN)(command)
    return app


def _help(name: str, text: str) -> str:
    """Return a docstring as the help of a command: each paragraph in one line, for any terminal.

    FIGURES stands for the names of the figures that the command leaves in the folder of each pad.
    """
    text = text.replace("FIGURES", joined([one.name for one in figures_of(name)]))
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


def overview() -> typer.Typer:
    """Return every command by its name and description alone, read from the source.

    For the list of commands, and for a word that is none of them: nothing else is imported.
    """
    app = _empty_application()
    for name, location in _COMMANDS.items():
        app.command(name, help=_description(*location.split(".")))(lambda: None)
    return app


def _description(module: str, function: str) -> str:
    """Return a command's docstring."""
    tree = ast.parse(Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8"))
    functions = (
        one for one in tree.body if isinstance(one, ast.FunctionDef) and one.name == function
    )
    return ast.get_docstring(next(functions)) or ""


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
    if sys.argv[1:] == ["study"]:
        file, hint = bundled("hidden.csv"), ""
        if file.exists():
            command = as_typed("qlvbayes", "study", str(file), "-o", "hidden")
            hint = f", or try a simulated pad: {command}"
        _stop(2, f"no file given; type qlvbayes study FILE.csv -o OUT{hint}")
    names = [word for word in _arguments()[:1] if word in _COMMANDS | _HIDDEN]
    app = application(names) if names else overview()
    if os.environ.get("QLVBAYES_DEBUG"):
        app()
    try:
        try:
            app()
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


def _arguments() -> list[str]:
    """Return the arguments; of a line to be completed by a shell only if it ends in an option.

    A command's options take a second or more to import, and file names the shell completes alone.
    """
    if "_QLVBAYES_COMPLETE" not in os.environ:
        return sys.argv[1:]
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
    words = line.split()[1:]
    return words if words and words[-1].startswith("-") else []


def _stop(status: int, *lines: str) -> None:
    for line in lines:
        print(f"qlvbayes: {visible(line)}", file=sys.stderr)
    sys.exit(status)
