"""The help of a command comes at once, and names what the command takes."""

import subprocess
import sys

import pytest
from support.endtoend import environment
from typer.testing import CliRunner

from qlvbayes import __version__
from qlvbayes.cli.main import COMMANDS, application
from qlvbayes.plots.catalogue import figures_of

SHOWN = """import sys
from contextlib import suppress
from qlvbayes.cli.main import run
for command in sys.argv[1:]:
    sys.argv = ["qlvbayes", command, "--help"]
    with suppress(SystemExit):
        run()
    heavy = {"jax", "scipy", "pandas", "matplotlib"}
    print("imported by", command, *sorted(heavy & set(sys.modules)))
"""


def test_the_help_of_a_command_does_not_wait_for_jax():
    # that of the other reads files alone, which takes numpy and scipy
    commands = sorted({*COMMANDS} - {"simulate"})
    line = [sys.executable, "-c", SHOWN, *commands]
    done = subprocess.run(line, capture_output=True, text=True, check=True)
    assert done.stdout.count(" Options ") >= len(commands)
    imported = [x for x in done.stdout.splitlines() if x.startswith("imported by")]
    assert imported == [f"imported by {command}" for command in commands]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_a_command_is_wrapped_for_the_terminal_alone(command):
    """Lines of the source's own width would break in the middle on a narrower terminal."""
    (entry,) = application([command]).registered_commands
    assert all("\n" not in paragraph for paragraph in entry.help.split("\n\n"))
    assert all(one.name in entry.help for one in figures_of(command))
    assert "FIGURES" not in entry.help


def test_the_version_is_printed():
    done = CliRunner().invoke(application(), ["--version"])
    assert (done.exit_code, done.output) == (0, f"qlvbayes {__version__}\n")


def test_the_list_of_commands_imports_none_of_them():
    """The list read from the sources equals the one that running the commands shows."""
    line = [sys.executable, "-X", "importtime", "-m", "qlvbayes", "--help"]
    shown = subprocess.run(line, capture_output=True, text=True, timeout=60, env=environment())
    full = CliRunner().invoke(application(), ["--help"], prog_name="python -m qlvbayes")
    assert shown.stdout.split() == full.output.split()
    assert "qlvbayes.io" in shown.stderr
    assert "qlvbayes.diagnosis" not in shown.stderr
    assert all(f"│ {name} " in shown.stdout for name in COMMANDS)
    assert "convert" not in shown.stdout
