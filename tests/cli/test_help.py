"""The help of a command: it comes at once, and lists what the catalogues have."""

import subprocess
import sys

import pytest

from qlvbayes.cli import design, export, options
from qlvbayes.cli.main import _COMMANDS
from qlvbayes.diagnosis.diagnose import EVIDENCES
from qlvbayes.diagnosis.nexttest import series
from qlvbayes.fitting.fit import METHODS
from qlvbayes.laws.catalogue import LAWS, names
from qlvbayes.laws.relaxation.prony import MOST, Prony
from qlvbayes.model.noise import NOISES
from qlvbayes.use.exports import catalogue, write

SHOWN = """import sys
from qlvbayes.cli.main import run
try:
    run()
finally:
    heavy = {"jax", "scipy", "pandas", "matplotlib"}
    print("imported:", *sorted(heavy & set(sys.modules)))
"""


def test_the_names_in_the_help_are_those_of_the_catalogues():
    assert names(LAWS.elastic) == options.ELASTIC
    assert names(LAWS.relaxation) == options.RELAXATION
    assert tuple(NOISES) == options.NOISES
    assert (Prony.name, MOST) == (options.PRONY, options.MOST)
    assert METHODS == options.METHODS
    assert EVIDENCES == options.EVIDENCES
    assert series.MOST == design.MOST
    assert tuple(target.name for target in catalogue.TARGETS) == export.TARGETS
    assert write.DRAWS == export.DRAWS


# those of the others read files alone, which takes numpy and scipy
@pytest.mark.parametrize("command", sorted({*_COMMANDS} - {"app", "convert", "look", "simulate"}))
def test_the_help_of_a_command_does_not_wait_for_jax(command):
    done = subprocess.run(
        [sys.executable, "-c", SHOWN, command, "--help"], capture_output=True, text=True, check=True
    )
    assert "Options" in done.stdout
    assert done.stdout.splitlines()[-1].split() == ["imported:"]
