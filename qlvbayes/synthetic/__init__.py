"""The paper's rig as a simulator that shares no code with the forward model.

The force comes from differential equations solved by a stiff integrator, so that a mistake
in the fast model cannot hide in its own data.
"""

from .constants import TABLE_1, Constants, draw_constants, pads_of_table_1
from .files import simulate_file, write_csv
from .logger import thin
from .material import Material, Pad, elastic_force
from .platen import (
    PAPER_ACCELERATION,
    PAPER_RATES,
    Hold,
    Move,
    Platen,
    Step,
    paper_protocol,
)
from .rig import (
    SAMPLE_RATE,
    Record,
    SimulatedTest,
    record_study,
    record_test,
    simulate_study,
    simulate_test,
)
from .sensors import ENCODER_STEP, NOISES, Noise, encode

__all__ = [
    "ENCODER_STEP",
    "NOISES",
    "PAPER_ACCELERATION",
    "PAPER_RATES",
    "SAMPLE_RATE",
    "TABLE_1",
    "Constants",
    "Hold",
    "Material",
    "Move",
    "Noise",
    "Pad",
    "Platen",
    "Record",
    "SimulatedTest",
    "Step",
    "draw_constants",
    "elastic_force",
    "encode",
    "pads_of_table_1",
    "paper_protocol",
    "record_study",
    "record_test",
    "simulate_file",
    "simulate_study",
    "simulate_test",
    "thin",
    "write_csv",
]
