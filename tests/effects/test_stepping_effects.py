"""Effects go on step by step: the batch answer, and there and back through them all."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.exported_pad import EFFECTS
from support.stepped import DEPTH, DT, SHALLOW, TIME, batch, relative, solved, stepped

from qlvbayes import InputError, Stepper, displacement_from_force
from qlvbayes.effects.catalogue import EVERY, find
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.model.stepping import _ROUNDING, begin, step, without_steps

INVERTED = [name for name in EFFECTS if find(name).inverts]
# forms nest where their listed effect does
TOGETHER = [name for name in INVERTED if find(name).family() == name and name != "slow_change"]
ONE_WAY = [name for name in EFFECTS if not find(name).inverts]
POWERS = ("power_law_drag", "guide_power_law_drag")
REFUSED = ["conditioning", "frame_ringing", "inertia", "offsets_by_test", "spreading_lag"]


def effect(name, *constants):
    return find(name)(*map(jnp.asarray, constants or EFFECTS[name]))


def unresolved(name):
    """Force (N) of what steps leave open of two neighbouring places (1e-15 of each, `_ROUNDING`).

    k |v|^n has no slope at rest, so that it tells what is rounding, another on each processor.
    """
    if name not in POWERS:
        return 0.0
    k, n = EFFECTS[name]
    return k * (2.0 * _ROUNDING * np.max(SHALLOW) / DT) ** n


def test_every_effect_steps_or_is_refused():
    assert sorted([*EFFECTS, *REFUSED]) == sorted(kind.name for kind in EVERY)


@pytest.mark.parametrize("name", INVERTED)
@pytest.mark.few(1)
def test_there_and_back(name, paper_model):
    model = paper_model("B") + effect(name)
    force = stepped(model, SHALLOW, DT)
    places = solved(model, force, DT)
    close = 1e-8 + unresolved(name) / float(np.max(force))
    assert relative(stepped(model, places, DT), force) < close
    if name in POWERS:  # what its force leaves open its place does not
        carried = np.asarray(force) > 0.0
        assert relative(places[carried], SHALLOW[carried]) < 1e-8


@pytest.mark.parametrize("gap", [0.2, -0.2])
@pytest.mark.few(1)
def test_a_rest_before_contact_came_first(gap, paper_model):
    model = paper_model("B") + effect("contact_offset", gap) + effect("friction")
    force = stepped(model, DEPTH, DT)
    assert relative(force, batch(model, DEPTH)) < 1e-12
    assert (float(force[0]) > 0.01) == (gap < 0.0)
    found = solved(model, force, DT)
    assert relative(stepped(model, found, DT), force) < 1e-8


@pytest.mark.slow
def test_all_together(paper_model):
    model = paper_model("B")
    for name in TOGETHER:
        if name != "contact_offset":  # its rest of 1e5 s rounds a material's own time to 1e-11 s
            model = model + effect(name)
    force = stepped(model, DEPTH, DT)
    assert relative(force, batch(model, DEPTH)) < 1e-12
    close = 1e-8 + unresolved("power_law_drag") / float(np.max(force))
    assert relative(stepped(model, solved(model, force, DT), DT), force) < close
    assert without_steps(model) == {}


@pytest.mark.slow
def test_a_load_below_the_readings_zero_lifts_the_platen(paper_model):
    """With an offset of 0.03 N no displacement reads less; the platen just leaves the pad."""
    model = paper_model("B") + effect("force_offset") + effect("contact_offset")
    load = np.where(TIME < 1.0, 1.0, 0.0)
    place = solved(model, load, DT)
    late = np.asarray(stepped(model, place, DT))[TIME >= 1.0]
    assert np.allclose(late, 0.03, rtol=0.0, atol=1e-12)
    assert np.all(np.asarray(place) >= 0.1)


@pytest.mark.parametrize("name", REFUSED)
def test_the_others_are_refused_by_name(name, paper_model):
    kind = find(name)
    model = paper_model("B") + kind(*[jnp.asarray(0.01)] * len(kind.units))
    assert without_steps(model) == {name: kind.not_stepped}
    assert kind.not_stepped != AbstractEffect.not_stepped
    with pytest.raises(InputError, match=f"{name} does not go step by step: {kind.not_stepped}"):
        step(model, begin(model), 0.1, 0.01)


@pytest.mark.slow
def test_slopes_along_all_constants_are_those_of_differences(paper_model):
    model = paper_model("B")
    for name in TOGETHER:
        model = model + effect(name)
    model = jax.tree.map(lambda x: jnp.asarray(x, float), model)
    load = np.clip(np.sin(TIME), 0.1, None)

    def moved(share):
        return solved(jax.tree.map(lambda x: x * (1.0 + share), model), load, DT)

    slope = jax.jit(lambda x: jax.jvp(moved, (x,), (1.0,))[1])(0.0)
    near = 1e-6
    assert relative(slope, np.asarray(moved(near) - moved(-near)) / (2.0 * near)) < 1e-5


def late(model, delay=0.037):
    return model + effect("channel_lag", delay)


@pytest.mark.parametrize("delay", [0.037, 0.0, 0.004, 0.01, 1.3])
@pytest.mark.few(1)
def test_a_late_channel_reads_what_was_there_before(delay, paper_model):
    """Between steps, at a step, over many of them; beneath it effects that remember."""
    model = paper_model("B") + effect("friction") + effect("extra_relaxation_mode")
    model = model + effect("force_offset")
    force = batch(late(model, delay), DEPTH)
    assert relative(stepped(late(model, delay), DEPTH, DT), force) < 1e-12
    before = np.interp(TIME - delay, TIME, np.asarray(batch(model, DEPTH)))
    if delay in (0.0, 0.01):  # a whole number of steps: what was read then, and the start's force
        assert np.allclose(force, before, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ONE_WAY)
def test_where_a_force_has_no_one_displacement_it_is_said(name, paper_model):
    why = f"no displacement is found from a force: {name}: {find(name).not_inverted}"
    with pytest.raises(InputError, match=why):
        displacement_from_force(paper_model("B") + effect(name), TIME, np.ones_like(TIME))


def test_a_stepper_keeps_what_is_on_its_way(paper_model):
    model = late(paper_model("B"))
    stepper = Stepper(model, DT)
    for depth in DEPTH[1:60]:
        stepper.force(depth)
    kept = stepper.state
    first = [stepper.force(depth)[0] for depth in DEPTH[60:120]]
    stepper.restore(kept)
    again = [stepper.force(depth)[0] for depth in DEPTH[60:120]]
    assert first == again
    assert relative(np.array(first), np.asarray(batch(model, DEPTH))[60:120]) < 1e-12
    with pytest.raises(InputError, match="no displacement is found"):
        stepper.displacement(1.0)
    with pytest.raises(InputError, match=r"a delay of 0\.037 s is more than 256 steps"):
        Stepper(model, 1e-4)
