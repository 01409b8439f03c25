"""Forms hold their listed law inside, and are what a simulator's differential equations say."""

from dataclasses import dataclass, replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from blind import forms, guide
from blind.catalogue import KINDS
from numpy.polynomial.legendre import legval
from scipy.integrate import solve_ivp
from support.simulated import CLOSE, PROTOCOLS, START, grid_of, motion_of
from support.stepped import whole

from qlvbayes.effects.catalogue import EFFECTS, EVERY, FORMS, OUTSIDE, find, names
from qlvbayes.effects.conformance import EffectError, check_effect
from qlvbayes.effects.contacts import AdhesionAtAStretch, GradualContact
from qlvbayes.effects.drags import (
    Friction,
    GuideDrag,
    GuideFriction,
    GuidePowerLawDrag,
    Inertia,
    PressureFriction,
    SharpFriction,
)
from qlvbayes.effects.fluids import PowerLawDrainage
from qlvbayes.effects.frames import StiffeningFrame
from qlvbayes.effects.sensors import ChannelLag, LevellingDrift, OffsetsByTest, SpreadingLag
from qlvbayes.effects.softening import LevellingLeak, SlowChange
from qlvbayes.io.checks import InputError
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import infer_choices
from qlvbayes.simulate import (
    TABLE_1,
    HiddenPad,
    Hold,
    Move,
    Platen,
    draw_effect,
    paper_protocol,
    pull_off_protocol,
)
from qlvbayes.simulate.hidden import contact_effects, effect, sensor_effects

SIZE = 0.06  # of the peak force, the effect's largest contribution
STROKE = 1.6  # mm
PRESSED = 1.4  # N
STUDY = Scales(1.4, STROKE, 1e-3, 30.0, 0.01, 0.01, 1.0, speed=20.0, clock=900.0, stiffness=2.0)
ADDED = pytest.mark.parametrize("kind", [*FORMS, *OUTSIDE], ids=names([*FORMS, *OUTSIDE]))


def test_a_form_is_of_a_listed_family_one_is_enough_and_a_diagnosis_looks_for_the_list_alone():
    assert len(set(names(EVERY))) == len(EVERY)
    assert {kind.family() for kind in FORMS} <= set(names(EFFECTS))
    assert {kind.family() for kind in OUTSIDE}.isdisjoint(names(EFFECTS))
    assert all(kind.family() == kind.name and not kind.outside for kind in EFFECTS)
    assert find("spreading_lag") is SpreadingLag
    with pytest.raises(InputError, match="friction and pressure_friction are forms of one effect"):
        Choices(effects=("friction", "pressure_friction"))
    model, _ = Choices(effects=("pressure_friction", "fluid_leak")).build(STUDY)
    assert [added.name for added in model.effects] == ["fluid_leak", "pressure_friction"]
    assert Choices().candidates == EFFECTS
    assert set(Choices().kinds) == set(EVERY)


@pytest.mark.parametrize(
    ("of", "changes", "rule"),
    [
        (PressureFriction, {"reduces": {"share": 0.1}}, "is not friction at"),
        (PressureFriction, {"generalises": "rust"}, "'rust', which is no listed effect"),
        (PressureFriction, {"rank": 77}, "must nest where friction does"),
        (SharpFriction, {"off_pad": True}, "must nest outside the contact"),
        (Inertia, {"name": "silent", "rank": 77, "off_pad": False},
         "says off_pad = False, and where the platen is off the pad it adds"),
        (PressureFriction, {"reduces": {}}, "reduces must say where it is friction"),
        (PressureFriction, {"outside": True}, "names nothing"),
        (LevellingLeak, {"generalises": Friction.name},
         "must have the constants of friction, reach, strength"),
    ],
)  # fmt: skip
@pytest.mark.few(5)
def test_a_broken_rule_is_named(of, changes, rule):
    with pytest.raises(EffectError, match=rule):
        check_effect(type("Broken", (of,), changes))


@ADDED
def test_a_posterior_of_another_program_is_told_by_the_constants_names(kind):
    """As the model's own, fixed reference values among them."""
    names_of = [f"{kind.name}.{constant}" for constant in kind.units]
    choices = infer_choices(["m", "b", "c[0]", "c[1]", "v[1]", *names_of])
    assert choices.effects == (kind.name,)


@dataclass(frozen=True)
class GradualDepth(effect.Effect):
    """d -> max(d - gap (1 - e^{-d/over}), 0); mm."""

    name: ClassVar[str] = "gradual_depth"
    order: ClassVar[int] = 41
    signed: ClassVar[tuple[str, ...]] = ("gap",)

    gap: float
    over: float

    def on_depth(self, depth, velocity):
        pressed = np.maximum(depth, 0.0)
        remains = np.maximum(depth + self.gap * np.expm1(-pressed / self.over), 0.0)
        slope = 1.0 - self.gap / self.over * np.exp(-pressed / self.over)
        return remains, np.where(remains > 0, velocity * slope, 0.0)


@dataclass(frozen=True)
class PowerDrainage(effect.Effect):
    """F + k q, q' = v - (q/tau) |q/stroke|^(n-1) e^(-a d), by Newton's method on the whole test."""

    name: ClassVar[str] = "power_drainage"
    order: ClassVar[int] = 33
    positive: ClassVar[tuple[str, ...]] = ("tau", "n", "stroke")

    k: float
    tau: float
    a: float
    n: float
    stroke: float

    def on_force(self, force, path):
        q = path.depth.copy()
        for _ in range(60):
            rate = np.abs(q / self.stroke) ** (self.n - 1.0) / self.tau
            rate = self.n * rate * np.exp(-self.a * path.depth)
            drained = path.follow(rate, path.depth - q * (1.0 - 1.0 / self.n), start=0.0)
            change = path.depth - drained - q
            q = q + change
            if np.abs(change).max() < 1e-10 * self.stroke:
                return force + self.k * q
        raise AssertionError("the pressure finds no balance")


def quadratic(twin):
    return PowerLawDrainage(twin.k, 1.0 / (twin.drain * twin.k * STROKE), 0.0, 2.0, STROKE)


def saturating(twin):
    return LevellingLeak(twin.share / twin.time, (1.0 - twin.share) / twin.time)


TWINS = {
    "quadratic_pressure": quadratic,
    "saturating_leak": saturating,
    "saturating_drift": lambda twin: LevellingDrift(twin.offset / twin.time, 1.0 / twin.time),
    "coulomb_friction": lambda x: PressureFriction(x.mu * PRESSED, x.reach, 1.0, PRESSED),
    "bending_frame": lambda twin: StiffeningFrame(twin.compliance, twin.force),
    "channel_low_pass": lambda twin: SpreadingLag(twin.time, 1.0),
    "adhesion_at_a_stretch": lambda twin: AdhesionAtAStretch(twin.strength, twin.stretch),
    "guide_friction": lambda twin: GuideFriction(twin.strength, twin.reach, twin.sharp),
    "guide_drag": lambda twin: GuideDrag(twin.eta),
}


def disagreement(model, added, twins, platen):
    """Largest difference of the forces over the peak."""
    time = grid_of(platen)
    found = np.asarray((model + added).force(motion_of(platen, time)))[: time.size]
    true = HiddenPad(TABLE_1["B"], tuple(twins)).force(platen, time)
    plain = HiddenPad(TABLE_1["B"]).force(platen, time)
    assert np.max(np.abs(true - plain)) > 20.0 * CLOSE * np.max(true)  # there is something to miss
    return np.max(np.abs(found - true)) / np.max(true)


@pytest.mark.parametrize("speed", [1.0, 20.0])
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("name", TWINS)
@pytest.mark.few(2)
def test_a_form_is_its_twin(paper_model, name, protocol, speed):
    rng = np.random.default_rng([int(speed), list(TWINS).index(name)])
    twin = draw_effect(KINDS[name], rng, PRESSED, STROKE, 20.0, SIZE, TABLE_1["B"])
    platen = Platen(PROTOCOLS[protocol](speed), start_s=START, number=2)
    assert disagreement(paper_model("B"), TWINS[name](twin), [twin], platen) < CLOSE


LAG = 0.02  # s
BETWEEN = {
    "a delay and a filter": (
        SpreadingLag(LAG, 0.4),
        [forms.ChannelLowPass(0.4 * LAG), sensor_effects.ChannelLag(0.6 * LAG)],
    ),
    "a long toe": (GradualContact(0.1, 0.3), [GradualDepth(0.1, 0.3)]),
    "early contact": (GradualContact(-0.05, 0.2), [GradualDepth(-0.05, 0.2)]),
    "drainage by 3": (
        PowerLawDrainage(0.1, 0.05, 0.3, 3.0, STROKE),
        [PowerDrainage(0.1, 0.05, 0.3, 3.0, STROKE)],
    ),
    "a soft frame that hardly stiffens": (
        StiffeningFrame(0.03, 1e9),
        [contact_effects.FrameCompliance(0.03)],
    ),
}


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("case", BETWEEN)
@pytest.mark.few(3)
def test_a_form_between_its_ends_solves_its_equation(paper_model, case, protocol):
    added, twins = BETWEEN[case]
    platen = Platen(PROTOCOLS[protocol](20.0), start_s=START, number=2)
    assert disagreement(paper_model("B"), added, twins, platen) < CLOSE


PART = Move(1.0, 1.0), Hold(5.0), Move(-0.07, 1.0), Move(-0.02, 1.0), Move(-0.09, 1.0)


@pytest.mark.parametrize(
    ("steps", "close"), [(PART, 0.1), *((pull_off_protocol(speed), 1e-3) for speed in (1.0, 20.0))]
)
@pytest.mark.few(1)
def test_ligaments_pull_beyond_contact_and_tear(paper_model, steps, close):
    """In tests that go off the surface: to part of a stretch, and to a quarter of the depth."""
    added, twin = AdhesionAtAStretch(0.08, 0.1), forms.AdhesionAtAStretch(0.08, 0.1)
    platen = Platen(steps, start_s=START, number=2)
    time = grid_of(platen)
    force = np.asarray(whole(paper_model("B") + added, motion_of(platen, time)))[: time.size]
    true, plain = (HiddenPad(TABLE_1["B"], x).force(platen, time) for x in ((twin,), ()))
    assert np.max(np.abs(force - true)) < CLOSE * np.max(true)
    assert np.max(np.abs(true - plain)) > 20.0 * CLOSE * np.max(true)
    assert np.min(force) == pytest.approx(-0.08, rel=close)


def test_torn_ligaments_obey_their_equation(paper_model):
    """dg/dX = -(X/s)^7 g/s from g = 1, X the farthest off the surface, by a general solver."""
    strength, stretch = 0.08, 0.1
    far = np.linspace(0.0, 0.16, 200)
    law = solve_ivp(
        lambda x, g: -((x / stretch) ** 7) * g / stretch, (0.0, 0.16), [1.0], "LSODA", far,
        rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    time, still = jnp.asarray(far), jnp.zeros(far.size)
    motion = Motion(time, -time, still - 1.0, still)  # from the surface on: the pad has no tension
    force = whole(paper_model("B") + AdhesionAtAStretch(strength, stretch), motion)
    expected = -strength * np.exp(1.0 / 8.0) * far / stretch * law.y[0]
    assert np.asarray(force) == pytest.approx(expected, abs=1e-9)


OFF = [
    (GuideFriction(0.1, 0.02, 1.0), guide.GuideFriction(0.1, 0.02, 1.0)),
    (GuideFriction(0.1, 0.2, 0.4), guide.GuideFriction(0.1, 0.2, 0.4)),
    (GuideDrag(0.004), guide.GuideDrag(0.004)),
    (GuidePowerLawDrag(0.004, 1.0), guide.GuideDrag(0.004)),
]


@pytest.mark.parametrize(("added", "twin"), OFF, ids=lambda x: type(x).__name__)
@pytest.mark.parametrize("speed", [1.0, 20.0])
@pytest.mark.few(2)
def test_a_guide_acts_off_the_pad_too(paper_model, added, twin, speed):
    """Pulled off, to and fro by less and by more than the reach, and pressed again."""
    moves = [Move(x, speed) for x in (1.0, -0.3, -0.285, -0.1, 0.4)]
    platen = Platen((*moves, Hold(5.0)), start_s=START, number=2)
    assert disagreement(paper_model("B"), added, [twin], platen) < CLOSE
    force = np.asarray((paper_model("B") + added).force(motion_of(platen, grid_of(platen))))
    pull = 0.1 if added.name == "guide_friction" else 0.004 * speed
    assert np.min(force) == pytest.approx(-pull, rel=0.2)


def test_pad_and_guide_rub_alike_until_contact_is_lost_and_in_part_with_the_force(paper_model):
    """On a specimen that is fixed to the platen always, on a loose one while it is pressed."""
    platen = Platen((Move(1.2, 5.0), Move(1.0, 5.0), Move(1.1, 5.0)))
    motion = motion_of(platen, grid_of(platen))
    for model in (replace(paper_model("B"), bonded=True), paper_model("B")):
        of_pad = (model + SharpFriction(0.02, 0.05, 0.6)).force(motion)
        of_guide = (model + GuideFriction(0.02, 0.05, 0.6)).force(motion)
        assert np.asarray(of_pad) == pytest.approx(np.asarray(of_guide), abs=1e-12)
    # half of it does: the mean of friction that does and of friction that does not
    platen = Platen(paper_protocol(20.0))
    motion = motion_of(platen, grid_of(platen))
    bonded = replace(paper_model("B"), bonded=True)
    none, half, all_of_it = (
        np.asarray((bonded + PressureFriction(0.1, 0.05, share, PRESSED)).force(motion))
        for share in (0.0, 0.5, 1.0)
    )
    assert np.allclose(half, 0.5 * (none + all_of_it), atol=1e-12)
    assert np.max(np.abs(none - all_of_it)) > 0.05


@pytest.mark.parametrize("kind", FORMS, ids=names(FORMS))
@pytest.mark.few(1)
def test_what_a_test_remembers_of_earlier_ones_is_the_lists(paper_model, kind):
    """With points of an earlier test before the test's own: at `reduces`, the family's force."""
    rng, listed = np.random.default_rng(5), find(kind.family())
    platen = Platen(paper_protocol(20.0), start_s=START, number=2)
    motion = motion_of(platen, grid_of(platen))
    earlier = jnp.array([-400.0, -399.0, -370.0, -369.0])
    carried = replace(
        motion,
        time=jnp.concatenate([earlier, motion.time]),
        displacement=jnp.concatenate([jnp.array([0.0, 1.2, 1.2, 0.0]), motion.displacement]),
        velocity=jnp.concatenate([jnp.zeros(4), motion.velocity]),
        acceleration=jnp.concatenate([jnp.zeros(4), motion.acceleration]),
        ago=jnp.concatenate([jnp.ones(4, int), jnp.zeros(motion.time.shape, int)]),
    )
    default = vars(kind.default(STUDY))
    values = {n: p if isinstance(p, float) else float(p.draw(rng)) for n, p in default.items()}
    # what acts in another place is the listed law where no contact lies between the two
    plain = replace(paper_model("B"), bonded=kind.off_pad and not listed.off_pad)
    general = plain + kind(**(values | kind.reduces))
    special = plain + listed(**{name: values[name] for name in listed.units})
    found, wanted = np.asarray(general.force(carried)), np.asarray(special.force(carried))
    assert np.allclose(found[4:], wanted[4:], atol=1e-12)
    assert np.max(np.abs(wanted - np.asarray(plain.force(carried)))[4:]) > 1e-4


def test_a_spreading_lag_has_its_slope_at_zero_and_a_levelling_leak_its_balance(paper_model):
    """However the delay is spread: its mean is the delay."""
    platen = Platen(paper_protocol(20.0))
    time = grid_of(platen)
    motion = motion_of(platen, time)
    small = 1e-6
    plain = np.asarray((paper_model("B") + ChannelLag(0.0)).force(motion))
    rising = (time > 0.02) & (time < 0.07)
    for spread in (0.0, 0.5, 1.0):
        late = np.asarray((paper_model("B") + SpreadingLag(small, spread)).force(motion))
        rate = (plain - late)[: time.size][rising] / small
        assert np.allclose(rate, np.gradient(plain[: time.size], time)[rising], rtol=0.02)
    platen = Platen(paper_protocol(1.0), start_s=1e5)
    motion = motion_of(platen, grid_of(platen))
    plain = np.asarray(paper_model("B").force(motion))
    leaked = np.asarray((paper_model("B") + LevellingLeak(2e-3, 6e-3)).force(motion))
    assert np.allclose(leaked, 0.75 * plain, atol=1e-12)


def test_what_names_nothing_follows_legendres_polynomials(paper_model):
    platen = Platen(paper_protocol(20.0), start_s=300.0)
    motion = motion_of(platen, grid_of(platen))
    plain = np.asarray(paper_model("B").force(motion))
    clock, coefficients = (
        2.0 * (300.0 + np.asarray(motion.time)) / 500.0 - 1.0,
        [0.0, 1.0, -0.7, 0.4],
    )
    changed = np.asarray((paper_model("B") + SlowChange(0.1, -0.7, 0.4, 500.0)).force(motion))
    assert np.allclose(changed, plain * (1.0 + 0.1 * legval(clock, coefficients)), atol=1e-12)
    shifted = np.asarray((paper_model("B") + OffsetsByTest(0.1, -0.7, 0.4, 500.0)).force(motion))
    assert np.allclose(shifted - plain, 0.1 * legval(0.2, coefficients), atol=1e-12)
    # three numbers and force_offset's: the offsets' matrix has full rank
    starts = np.array([0.0, 70.0, 300.0, 420.0])

    def offsets(constants):
        added = OffsetsByTest(*constants, 500.0)
        return [float(added.force(_Nothing(), _at(start))[0]) for start in starts]

    own = np.array([offsets(row) for row in ([1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 1.0])])
    assert np.linalg.matrix_rank(np.vstack([np.ones(4), own])) == 4


class _Nothing:
    def force(self, motion):
        return jnp.zeros_like(motion.time)


def _at(start):
    return motion_of(replace(Platen(paper_protocol(20.0)), start_s=start), np.zeros(1))


def test_ligaments_hold_on_to_a_surface_that_has_not_recovered(paper_model):
    """The pull begins where the pad's own force ends, and is largest a stretch farther back."""
    steps = Move(1.0, 5.0), Hold(20.0), Move(-1.3, 5.0)
    platen = Platen(steps, start_s=START, number=2)
    motion = motion_of(platen, grid_of(platen))

    @jax.jit
    def force(strength):
        return (paper_model("B") + AdhesionAtAStretch(strength, 0.05, 0.0)).force(motion)

    plain, sticky = (np.asarray(force(strength)) for strength in (0.0, 0.2))
    end = int(np.flatnonzero(plain > 0.0)[-1])
    surface = float(motion.displacement[end])
    assert surface > 0.1  # it relaxed under the press, and is not back at rest
    off = surface - np.asarray(motion.displacement)[end:]
    grid = float(off[1])  # mm: the force ends between two points
    pull = -sticky[end:]
    assert np.all(sticky[:end] == plain[:end])
    assert off[np.argmax(pull)] == pytest.approx(0.05, abs=2.0 * grid)
    assert 0.15 < pull.max() <= 0.2 + 1e-9  # the points may miss the top
    assert np.all(pull[off > 0.05 * 1.6 + grid] < 1e-3)
