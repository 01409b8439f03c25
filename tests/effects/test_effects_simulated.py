"""Each effect's force against a simulator that solves its differential equations."""

from dataclasses import fields, replace

import numpy as np
import pytest
from support.simulated import CLOSE, PROTOCOLS, START, grid_of, motion_of
from support.stepped import whole

from qlvbayes.effects.catalogue import EFFECTS, find, names
from qlvbayes.simulate import (
    HIDDEN,
    TABLE_1,
    HiddenPad,
    Platen,
    draw_effect,
    full_retraction_protocol,
    paper_protocol,
)

SIZE = 0.06  # of the peak force, the effect's largest contribution
SIMULATED = [name for name in names() if name in HIDDEN]
# drags through a frame that gives way differ where contact begins: its speed is neglected; play
# puts the end of contact between two points of the grid, where adhesion lets go steeply
TOGETHER = tuple(name for name in SIMULATED if name not in {"frame_compliance", "backlash"})
SETS = [
    ("frame_compliance", "strain_dependent_rate", "contact_offset", "stress_softening"),
    ("viscous_drag", "friction", "force_offset"),
    ("permanent_set", "contact_offset", "squeeze_film", "channel_lag"),
    ("adhesion", "friction", "fluid_pressure", "stress_softening"),
    ("backlash", "permanent_set", "contact_offset", "friction", "load_cell_creep"),
    ("interface_slip", "contact_offset", "backlash", "extra_relaxation_mode"),
    ("thixotropy", "conditioning", "second_contact", "stress_softening", "force_drift"),
    ("extra_relaxation_mode", "fluid_pressure", "friction", "inertia", "channel_lag"),
    TOGETHER,
]


def drawn(name, seed, protocol=None):
    rng = np.random.default_rng([seed, list(HIDDEN).index(name)])
    return draw_effect(name, rng, 1.4, 1.6, 20.0, SIZE, TABLE_1["B"], protocol)


def as_model(effect):
    kind = find(effect.name)
    return kind(**{field.name: getattr(effect, field.name) for field in fields(kind)})


def disagreement(model, effects, platen):
    """Largest difference of the forces over the peak, kinks apart where the force jumps."""
    time = grid_of(platen)
    for effect in effects:
        model = model + as_model(effect)
    found = np.asarray(whole(model, motion_of(platen, time)))[: time.size]
    true = HiddenPad(TABLE_1["B"], tuple(effects)).force(platen, time)
    return np.abs(found - true) / np.max(np.abs(true)), time


def test_every_effect_has_its_counterpart():
    assert set(names()) == set(HIDDEN)
    for kind in EFFECTS:
        parameters = {field.name for field in fields(HIDDEN[kind.name])}
        assert parameters == {field.name for field in fields(kind)}


@pytest.mark.parametrize("speed", [1.0, 20.0])
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("name", SIMULATED)
@pytest.mark.few(1)
def test_the_force_is_the_simulators(paper_model, name, protocol, speed):
    effect = drawn(name, int(speed))
    platen = Platen(PROTOCOLS[protocol](speed), start_s=START, number=2)
    error, _ = disagreement(paper_model("B"), [effect], platen)
    assert error.max() < CLOSE


@pytest.mark.parametrize(
    "together", SETS, ids=lambda names: "+".join(names) if len(names) < 9 else "all"
)
@pytest.mark.few(2)  # the last has nearly every effect's own law
def test_effects_nest_as_in_the_simulator(paper_model, together):
    effects = [drawn(name, 7) for name in together]
    platen = Platen(full_retraction_protocol(20.0), start_s=START, number=2)
    error, _ = disagreement(paper_model("B"), effects, platen)
    assert error.max() < CLOSE


def test_the_order_of_nesting_matters_and_is_the_models(paper_model):
    """An offset seen through a lag is not changed; a drag seen through a set pad is."""
    effects = [drawn(name, 3) for name in ("permanent_set", "viscous_drag", "channel_lag")]
    platen = Platen(paper_protocol(20.0))
    error, _ = disagreement(paper_model("B"), effects, platen)
    assert error.max() < CLOSE
    swapped = replace(paper_model("B"), effects=tuple(map(as_model, reversed(effects))))
    time = grid_of(platen)
    wrong = np.asarray(whole(swapped, motion_of(platen, time)))[: time.size]
    true = HiddenPad(TABLE_1["B"], tuple(effects)).force(platen, time)
    assert np.max(np.abs(wrong - true)) > CLOSE * np.max(np.abs(true))
