"""The help of a command comes at once."""

import subprocess
import sys

import pytest

from qlvbayes.cli.main import _COMMANDS, application
from qlvbayes.plots.catalogue import figures_of

SHOWN = """import sys
from qlvbayes.cli.main import run
try:
    run()
finally:
    heavy = {"jax", "scipy", "pandas", "matplotlib"}
    print("imported:", *sorted(heavy & set(sys.modules)))
"""


# those of the others read files alone, which takes numpy and scipy
@pytest.mark.parametrize("command", sorted({*_COMMANDS} - {"app", "convert", "look", "simulate"}))
def test_the_help_of_a_command_does_not_wait_for_jax(command):
    done = subprocess.run(
        [sys.executable, "-c", SHOWN, command, "--help"], capture_output=True, text=True, check=True
    )
    assert "Options" in done.stdout
    assert done.stdout.splitlines()[-1].split() == ["imported:"]


@pytest.mark.parametrize("command", sorted(_COMMANDS))
def test_the_help_of_a_command_is_wrapped_for_the_terminal_alone(command):
    """Lines of the source's own width would break in the middle on a narrower terminal."""
    (entry,) = application([command]).registered_commands
    assert all("\n" not in paragraph for paragraph in entry.help.split("\n\n"))
    assert all(one.name in entry.help for one in figures_of(command))
    assert "FIGURES" not in entry.help
