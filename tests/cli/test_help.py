"""The help of a command comes at once."""

import subprocess
import sys

import pytest

from qlvbayes.cli.main import _COMMANDS

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
