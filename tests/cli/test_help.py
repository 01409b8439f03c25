"""The help of a command: it comes at once, and lists what the catalogues have."""

import subprocess
import sys

import pytest

from qlvbayes.cli import options
from qlvbayes.diagnosis.diagnose import EVIDENCES
from qlvbayes.fitting.fit import METHODS
from qlvbayes.laws.catalogue import LAWS, names
from qlvbayes.laws.relaxation.prony import MOST, Prony
from qlvbayes.model.noise import NOISES

SHOWN = """import sys
from qlvbayes.cli.main import run
try:
    run()
finally:
    heavy = {"jax", "numpy", "scipy", "pandas", "matplotlib"}
    print("imported:", *sorted(heavy & set(sys.modules)))
"""


def test_the_names_in_the_help_are_those_of_the_catalogues():
    assert names(LAWS.elastic) == options.ELASTIC
    assert names(LAWS.relaxation) == options.RELAXATION
    assert tuple(NOISES) == options.NOISES
    assert (Prony.name, MOST) == (options.PRONY, options.MOST)
    assert METHODS == options.METHODS
    assert EVIDENCES == options.EVIDENCES


@pytest.mark.parametrize("command", ["fit", "diagnose", "study"])
def test_the_help_of_a_command_waits_for_no_library_of_numbers(command):
    done = subprocess.run(
        [sys.executable, "-c", SHOWN, command, "--help"], capture_output=True, text=True, check=True
    )
    assert "--elastic" in done.stdout
    assert done.stdout.splitlines()[-1].split() == ["imported:"]
