"""Every effect keeps the rules; what breaks one is refused; and the physics they stand for."""

import inspect
from dataclasses import replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.stepped import whole

from qlvbayes.effects import conformance
from qlvbayes.effects.catalogue import EFFECTS, find, names, own_effects
from qlvbayes.effects.catalogue import EVERY as WITH_FORMS
from qlvbayes.effects.conformance import EffectError, check_effect, effect_checks
from qlvbayes.effects.drags import Friction, Inertia, ViscousDrag
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import largest, material_time
from qlvbayes.effects.sensors import ChannelLag
from qlvbayes.effects.softening import PermanentSet, StressSoftening
from qlvbayes.io.checks import InputError
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.model.model import Model
from qlvbayes.priors import HalfNormal, Uniform

EVERY = pytest.mark.parametrize("kind", EFFECTS, ids=names())
ALL = pytest.mark.parametrize("kind", WITH_FORMS, ids=names(WITH_FORMS))
STRAINED = Scales(
    250.0, 0.3, 1e-3, 60.0, 0.1, 0.1, 1.0, speed=7.0, acceleration=180.0, clock=900.0, stiffness=1e3
)


def press_and_return():
    """To 1.6 mm at 20 mm/s, 30 s, back to 0 at the same speed, 5 s."""
    speed, points = 20.0, 200
    way = np.linspace(0.0, 1.6, points)
    ramp, hold = 1.6 / speed, 30.0 * np.linspace(0.0, 1.0, points + 1)[1:] ** 3
    back = ramp + 30.0 + way[1:] / speed
    time = np.concatenate([way / speed, ramp + hold, back, [back[-1] + 5.0]])
    depth = np.concatenate([way, np.full(points, 1.6), 1.6 - way[1:], [0.0]])
    moving = np.concatenate(
        [np.full(points, speed), np.zeros(points), np.full(points - 1, -speed), [0.0]]
    )
    return Motion(*map(jnp.asarray, (time, depth, moving, 0.0 * time)))


PRESS = press_and_return()


def bonded(*effects):
    relaxation = Prony(jnp.array([0.3, 0.63, 0.07]), jnp.array([6.2, 0.14]))
    return sum(effects, Model(Exponential(0.34, 1.165), relaxation, True))


def force(model):
    return np.asarray(whole(model, PRESS))


@ALL
@pytest.mark.few(1)
def test_every_effect_keeps_the_rules(kind):
    check_effect(kind)


OF_MANY_UNITS = [
    "fluid_pressure",
    "squeeze_film",
    "friction",
    "power_law_drainage",
    "gradual_contact",
]


@pytest.mark.parametrize("name", OF_MANY_UNITS)
@pytest.mark.slow
def test_the_rules_hold_in_other_units_too(name):
    check_effect(find(name), STRAINED)


@ALL
def test_priors_are_proper_where_a_scale_is_unknown(kind):
    bare = Scales(1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, speed=0.0, acceleration=0.0, clock=0.0)
    for prior in vars(kind.default(bare)).values():
        drawn = prior if isinstance(prior, float) else prior.draw(np.random.default_rng(1))
        assert np.isfinite(drawn)


def test_names_are_told_apart_and_amplitudes_scaled_alike():
    assert len(set(names())) == len(EFFECTS) == 25
    with pytest.raises(
        InputError, match=r"no effect 'rust'; use one of viscous_drag, .*channel_lag"
    ):
        find("rust")
    scales = conformance._reference(1.6, 0.0).scales
    amplitude = ViscousDrag.default(scales).eta
    assert isinstance(amplitude, HalfNormal)
    assert np.isclose(float(amplitude.sd) * scales.speed, 0.05 * scales.force)


def test_the_order_of_adding_does_not_matter():
    scales, loose = conformance._reference(1.6, 0.0).scales, replace(bonded(), bonded=False)
    defaults = [kind.default(scales) for kind in EFFECTS]
    nested, other = (
        [effect.name for effect in sum(some, loose).effects] for some in (defaults, defaults[::-1])
    )
    assert nested == other
    listed = [nested.index(x) for x in ("extra_relaxation_mode", "stress_softening", "channel_lag")]
    assert listed == [0, 3, len(EFFECTS) - 1]


class Good(AbstractEffect):
    """F = F_below + amount d."""

    amount: Any
    name: ClassVar[str] = "good"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 50
    units: ClassVar[dict[str, str]] = {"amount": "stiffness"}
    null: ClassVar[dict[str, float]] = {"amount": 0.0}
    law: ClassVar[str] = "F += amount delta"
    seen: ClassVar[str] = "a stiffness that never relaxes"
    reference: ClassVar[str] = "Hooke 1678"

    @classmethod
    def default(cls, scales):
        return cls(scales.positive(scales.depth))

    def force(self, below, motion):
        return below.force(motion) + self.amount * motion.displacement


def with_force(added):
    """A force that is added to that below: of the effect and the motion."""
    return {"force": lambda self, below, motion: below.force(motion) + added(self, motion)}


def root_drag(self, motion):
    """Infinite slope at rest."""
    return jnp.sign(motion.velocity) * jnp.sqrt(jnp.abs(motion.velocity) * self.amount)


def undefined(self, motion):
    """0/0 at zero depth, away from the null."""
    extra = self.amount / jnp.maximum(motion.displacement, 0.0)
    return jnp.where(self.amount > 0.0, extra, 0.0)


def counting(self, motion):
    """Another force when it is compiled."""
    compiled = isinstance(motion.time, jax.core.Tracer)
    return (1.0 + compiled) * self.amount * motion.displacement


def striding(self, below, state, line):
    """Steps to another force than that of the whole motion."""
    state, force = below.step(state, line)
    return state, force + 1.1 * self.amount * line.displacement


def prior(of_scales):
    return {"default": classmethod(lambda cls, scales: cls(of_scales(scales)))}


BROKEN = [
    (with_force(lambda self, motion: self.amount * motion.displacement[-2]), "not causal"),
    (with_force(lambda self, motion: (self.amount + 1e-6) * motion.displacement),
     "does not vanish at its null"),
    (with_force(root_drag), "slope along amount is not finite"),
    (with_force(undefined), "force is not finite"),
    (prior(lambda scales: scales.positive(0.01 * scales.depth)), "median"),
    (prior(lambda scales: Uniform(0.0, 1.0)), r"scales\.positive or scales\.signed"),
    ({"rank": Friction.rank}, "nests where friction does"),
    ({"units": {"amount": "furlong"}}, "'furlong' is no kind of unit"),
    ({"units": {}}, "units must name exactly its constants amount"),
    ({"seen": ""}, "seen must be one line"),
    ({"null": {"size": 0.0}}, "null must name"),
    ({"name": "My effect"}, "'My effect' is not lower case"),
    (with_force(counting), "compiled and plain"),
    ({"step": striding}, "steps and the force of a whole motion differ"),
]  # fmt: skip


def test_a_user_made_effect_may_keep_the_rules():
    check_effect(Good)
    check_effect(Good, STRAINED)


@pytest.mark.parametrize(("changes", "rule"), BROKEN, ids=[rule for _, rule in BROKEN])
@pytest.mark.few(3)
def test_a_broken_rule_is_named(changes, rule):
    with pytest.raises(EffectError, match=rule):
        check_effect(type("Broken", (Good,), changes))


def test_all_broken_rules_are_named_and_each_check_is_its_own():
    nests_where_friction_does = {"level": Friction.level, "rank": Friction.rank}
    twice = type("Twice", (Good,), {**nests_where_friction_does, "step": striding})
    with pytest.raises(EffectError) as raised:
        check_effect(twice)
    assert len(str(raised.value).splitlines()) == 2
    broken = {}
    for name, check in effect_checks(twice):
        try:
            check()
        except EffectError as error:
            broken[name] = str(error)
    assert list(broken) == ["nesting", "steps"]
    assert "\n".join(broken.values()) == str(raised.value)


def test_largest_depth_and_material_time():
    depth = jnp.array([0.0, 0.3, 0.2, 0.3, 0.5, 0.1])
    assert np.array_equal(largest(depth), [0.0, 0.3, 0.3, 0.3, 0.5, 0.5])
    slopes = jax.jacobian(largest)(depth)
    assert np.array_equal(np.argmax(slopes, axis=1), [0, 1, 1, 3, 4, 4])
    time, depth = jnp.array([0.0, 1.0, 1.5]), jnp.array([0.0, 0.8, 0.8])
    expected = [0.0, np.expm1(0.8 * 2.0) / 1.6, np.expm1(1.6) / 1.6 + 0.5 * np.exp(1.6)]
    assert np.allclose(material_time(time, depth, 2.0), expected, rtol=1e-14)


def test_a_lag_takes_all_forces_below_it_of_an_earlier_time():
    """By a whole number of grid steps: exactly."""
    extras = Inertia(1e-3), ViscousDrag(0.01), PermanentSet(0.05), Friction(0.1, 0.05)
    step = float(PRESS.time[10])
    plain, lagged = force(bonded(*extras)), force(bonded(*extras, ChannelLag(step)))
    assert np.allclose(lagged[10:200], plain[:190], atol=1e-12)

    def delayed(delay):
        return whole(bonded(ChannelLag(delay)), PRESS)

    small = 1e-7
    difference = (delayed(small) - delayed(0.0)) / small
    slope = jax.jvp(delayed, (0.0,), (1.0,))[1]
    scale = float(jnp.max(jnp.abs(difference)))
    assert np.max(np.abs(slope - difference)[1:]) < 1e-4 * scale


@EVERY
@pytest.mark.few(2)
def test_slopes_are_those_of_differences(kind):
    """Along every constant, in all tests, at a draw of the prior."""
    reference = conformance._reference(1.6, 0.0)
    trial = conformance._Trial(kind.default(reference.scales), reference)
    at, slopes = trial.draws[1], trial.at_draws[1][1]
    for k, slope in enumerate(slopes):
        step = 1e-6 * abs(at[k]) * np.eye(at.size)[k]
        difference = (trial.both(at + step)[0] - trial.both(at - step)[0]) / (2.0 * step[k])
        wrong = np.abs(difference - slope) > 1e-4 * np.max(np.abs(slope))
        assert np.mean(wrong) < 0.02  # a kink, as where contact is lost, may lie between


def test_what_protocols_and_records_cannot_show():
    full = Protocol(unloads=True, returns=True, tests=6, bonded=False, curved=True)
    assert [kind.name for kind in EFFECTS if kind.blind(full)] == ["interface_slip"]
    assert find("interface_slip").blind(replace(full, bonded=True)) is None
    poor = Protocol(
        unloads=False, returns=False, tests=1, bonded=True, curved=False, one_depth=True
    )
    blind = {kind.name for kind in EFFECTS if kind.blind(poor)}
    turning = {"stress_softening", "permanent_set", "backlash", "interface_slip"}
    assert blind == {*turning, "adhesion", "inertia", "conditioning", "strain_dependent_strength"}
    assert Inertia.blind(poor) == "no acceleration is resolved"
    slow = replace(full, interval=0.2)
    assert find("frame_ringing").blind(slow) == "fewer than 4 readings fall in a period of 2 Hz"
    assert find("frame_ringing").unmeasured(replace(full, interval=0.1)) is None
    assert StressSoftening.blind(poor) == "no test unloads"
    untimed = Protocol(unloads=True, returns=True, tests=6, bonded=False, curved=False, timed=False)
    blind = {kind.name for kind in EFFECTS if kind.unmeasured(replace(untimed, bonded=True))}
    assert blind == {"viscous_drag", "power_law_drag", "squeeze_film", "frame_ringing", "inertia"}


# files of users

SOURCE = """
from typing import Any, ClassVar
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.drags import Friction

""" + inspect.getsource(Good)


def written(folder, text, name="mine.py"):
    path = folder / name
    path.write_text(text)
    return path


def test_a_file_gives_the_effects_that_it_defines_if_it_is_there(tmp_path):
    (spring,) = own_effects(written(tmp_path, SOURCE))
    assert spring.name == "good"
    check_effect(spring)
    assert find("good", (*EFFECTS, spring)) is spring
    assert names() == tuple(kind.name for kind in EFFECTS)
    extra = force(bonded(spring(0.1))) - force(bonded())
    assert np.allclose(extra, 0.1 * PRESS.displacement)
    with pytest.raises(InputError, match=r"absent\.py: no such Python file"):
        own_effects(tmp_path / "absent.py")
    with pytest.raises(InputError, match="no such Python file"):
        own_effects(written(tmp_path, SOURCE, "mine.txt"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import qlvbayes\n", r"mine\.py: defines no effect; write a class"),
        ("x = 1\n\ny = x / 0\n", r"mine\.py, line 3: ZeroDivisionError: division by zero; run"),
        ("x = 1\ndef (:\n", r"mine\.py, line 2: SyntaxError"),
        ("import json\njson.loads('{')\n", r"mine\.py, line 2: JSONDecodeError"),
        (SOURCE.replace('"good"', '"friction"'), r"line 6: the effect friction comes with"),
        (SOURCE + SOURCE.replace("Good", "Coil"), r"line 30: the effect good is in"),
        (SOURCE.replace("def force", "def strength"), r"line 6: the effect Good lacks force;"),
        (SOURCE.replace("units:", "unit:"), r"line 6: the effect Good lacks units;"),
    ],
)
def test_a_file_that_cannot_be_used_says_where(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        own_effects(written(tmp_path, text))
