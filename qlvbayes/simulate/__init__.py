"""The paper's rig as a simulator that shares no code with the forward model.

The force comes from differential equations solved by a stiff integrator, so that a mistake
in the fast model cannot hide in its own data.
"""

import inspect

from .constants import (
    SPECIMENS,
    TABLE_1,
    Constants,
    draw_constants,
    specimens_of,
)
from .creep import Load, creep_protocol, creep_study, displacement_under, prescribed, record_creep
from .files import simulate_file, write_csv
from .hidden import _KINDS as _EFFECTS
from .hidden import (
    HIDDEN,
    Effect,
    HiddenPad,
    draw_effect,
    draw_effect_in,
    effect_class,
    parse_effect,
)
from .material import Material, Pad
from .platen import (
    PAPER_ACCELERATION,
    PAPER_RATES,
    PROTOCOLS,
    Hold,
    Move,
    Platen,
    Step,
    full_retraction_protocol,
    paper_protocol,
    pull_off_protocol,
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
from .sensors import ENCODER_STEP, NOISES, Noise, encode, thin

__all__ = [
    *(name for name, value in vars().items() if name[0] != "_" and not inspect.ismodule(value)),
    *_EFFECTS,
]


def __getattr__(name: str) -> type[Effect]:
    """Return a hidden effect's class by its name, which stands in the catalogue alone."""
    if name in _EFFECTS:
        return _EFFECTS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
