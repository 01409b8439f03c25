"""The command line's entry: subcommands, and errors as one plain line."""

from __future__ import annotations

import errno
import os
import sys

import typer

from qlvbayes.cli.app import app_command
from qlvbayes.cli.benchmark import benchmark
from qlvbayes.cli.check import check
from qlvbayes.cli.compare import compare_command
from qlvbayes.cli.convert import convert_command
from qlvbayes.cli.design import design_command
from qlvbayes.cli.diagnose import diagnose_command
from qlvbayes.cli.effects import effects
from qlvbayes.cli.export import export_command
from qlvbayes.cli.fit import fit
from qlvbayes.cli.laws import laws
from qlvbayes.cli.predict import predict_command
from qlvbayes.cli.report import report
from qlvbayes.cli.simulate import simulate
from qlvbayes.cli.study import study_command
from qlvbayes.io.checks import InputError

INTERRUPTED = 130

app = typer.Typer(
    help="Viscoelastic constants of soft pads from force-displacement tests.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command("study")(study_command)
app.command()(fit)
app.command()(check)
app.command("diagnose")(diagnose_command)
app.command("app")(app_command)
app.command("compare")(compare_command)
app.command("predict")(predict_command)
app.command("design")(design_command)
app.command()(report)
app.command("export")(export_command)
app.command()(effects)
app.command()(laws)
app.command("convert")(convert_command)
app.command()(simulate)
app.command()(benchmark)


def run() -> None:
    """Run the command; status 2 and one line for what the user can mend, never a traceback."""
    if os.environ.get("QLVBAYES_DEBUG"):
        app()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()  # here, where a reader that has gone can still be noticed
    except InputError as error:
        _stop(str(error), 2)
    except SystemExit as stop:
        if stop.code == INTERRUPTED:  # what typer makes of Ctrl-C
            _stop("interrupted; the same command goes on where it stopped", INTERRUPTED)
        raise
    except BrokenPipeError:
        os._exit(1)  # the reader has gone: nobody is left to tell
    except OSError as error:
        _stop(_plain(error), 2)
    except MemoryError:
        _stop("not enough memory; read fewer pads with --pads", 2)
    except Exception as error:
        text = " ".join(str(error).split())[:300]
        _stop(
            f"internal error ({type(error).__name__}: {text}); "
            "set QLVBAYES_DEBUG=1 for the traceback and report it",
            1,
        )


def _plain(error: OSError) -> str:
    place = f"{error.filename}: " if error.filename else ""
    remedy = "free some space" if error.errno == errno.ENOSPC else "check the path and its rights"
    return f"{place}{error.strerror or error}; {remedy}"


def _stop(text: str, status: int) -> None:
    print(f"qlvbayes: {text}", file=sys.stderr)
    sys.exit(status)
