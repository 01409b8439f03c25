"""Effects in other languages: the force of the whole model, and the way back, from the same steps."""

import re
import subprocess

import jax.numpy as jnp
import numpy as np
import pytest
from support.compiled_pad import STRICT, CompiledPad, needs_gcc
from support.endtoend import study
from support.exported_pad import EFFECTS, exported, reference
from support.lawmotions import retracting

from qlvbayes.effects.catalogue import find
from qlvbayes.laws.motion import Motion
from qlvbayes.model.choices import Choices
from qlvbayes.use.exports.c_header import CHeader

EXACT = 1e-12  # of the largest force
TOGETHER = ("viscous_drag", "fluid_pressure", "stress_softening", "friction", "force_offset")
CASES = [
    *((name,) for name in EFFECTS),
    TOGETHER,
    (*TOGETHER, "strain_dependent_rate", "permanent_set", "frame_compliance", "force_drift"),
    ("channel_lag", "friction", "extra_relaxation_mode", "adhesion"),
]


def six_tests():
    """Time and displacement of pad B's six bundled tests, as they were recorded."""
    return [
        (np.asarray(test.time), np.asarray(test.displacement)) for test in study().pad("B").tests
    ]


def whole(model, time, depth):
    """Force of the whole motion in JAX, its speed at a point that of the line which ends there."""
    step = np.diff(time)
    speed = np.where(step > 0.0, np.diff(depth) / np.where(step > 0.0, step, 1.0), 0.0)
    velocity = np.concatenate([[0.0], speed])
    motion = Motion(*map(jnp.asarray, (time, depth, velocity, np.zeros_like(time))))
    return np.asarray(model.force(motion))


def off(found, expected):
    return np.max(np.abs(found - expected)) / np.max(np.abs(expected))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Give a pad with these effects, its compiled header, and the model."""
    known = {}

    def build(*effects, **options):
        key = effects, *options.items()
        if key not in known:
            folder = tmp_path_factory.mktemp("c")
            choices = Choices(effects=effects, **options)
            pad = exported(folder, choices, spread=0.0)
            back = all(find(name, choices.kinds).inverts for name in effects)
            flags = {} if back else {"flags": (*STRICT, "-O1", "-DONE_WAY")}
            program = CompiledPad(folder / "c", CHeader().files(pad, None), **flags)
            known[key] = pad, program, reference(choices)
        return known[key]

    return build


@needs_gcc
@pytest.mark.parametrize("effects", CASES, ids="+".join)
def test_force_is_that_of_the_python_model_on_the_six_tests(compiled, effects):
    pad, program, model = compiled(*effects)
    assert pad.left_out == {}
    tests = six_tests()
    assert len(tests) == 6
    for time, depth in [*tests, retracting()]:
        force, _ = program.force(time, depth)
        assert off(force, whole(model, time, depth)) <= EXACT
