"""The bundled pad with a hidden effect, made ready once for all densities and forces."""

from pathlib import Path

import pytest

from qlvbayes import read_study
from qlvbayes.motion.experiment import prepare


@pytest.fixture(scope="package")
def experiment():
    return prepare(read_study(Path(__file__).parents[2] / "data" / "hidden.csv").pads[0])
