"""The forward model against closed forms, quadrature and differential equations."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from support.stepped import whole

from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.elastic.polynomial import HertzPower, Linear
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.model import Model
from qlvbayes.simulate import PAPER_RATES, TABLE_1, Pad, Platen, paper_protocol

NODES, WEIGHTS = leggauss(20)


def force_of(model, time, depth):
    time, depth = jnp.asarray(time, dtype=float), jnp.asarray(depth, dtype=float)
    return model.force(Motion(time, depth, jnp.zeros_like(time), jnp.zeros_like(time)))


force = eqx.filter_jit(force_of)


def bonded(elastic, relaxation):
    return Model(elastic, relaxation, bonded=True)


def with_constants(model, values):
    """The model with other constants: m, b, c[0..r], v[1..r]."""
    modes = model.relaxation.v.shape[0]
    elastic = Exponential(values[0], values[1])
    return bonded(elastic, Prony(values[2 : 3 + modes], values[3 + modes :]))


def constants_of(model):
    elastic, relaxation = model.elastic, model.relaxation
    return jnp.concatenate([jnp.array([elastic.m, elastic.b]), relaxation.c, relaxation.v])


def ramp_force(constants, speed, time):
    """The paper's F1, with v_0 = 0."""
    b, v = constants.b * speed, np.array([0.0, *constants.v])
    t = time[:, None]
    return np.sum(
        constants.m * speed * np.array(constants.c) * (np.exp(b * t) - np.exp(-v * t)) / (b + v), 1
    )


def hold_force(constants, speed, time, end):
    """The paper's F2, with v_0 = 0; ``end`` of the ramp at t0."""
    b, v = constants.b * speed, np.array([0.0, *constants.v])
    grown = np.exp(-v * time[:, None]) * (np.exp((b + v) * end) - 1.0) / (b + v)
    return np.sum(constants.m * speed * np.array(constants.c) * grown, 1)


@pytest.mark.parametrize("speed", PAPER_RATES)
@pytest.mark.parametrize("pad", TABLE_1)
@pytest.mark.few(6)
def test_ramp_and_hold_are_the_papers_closed_forms(paper_model, pad, speed):
    end = 1.6 / speed
    ramp, hold = np.linspace(0.0, end, 40), end + np.geomspace(1e-4, 30.0, 40)
    time = np.concatenate([ramp, hold])
    expected = np.concatenate(
        [ramp_force(TABLE_1[pad], speed, ramp), hold_force(TABLE_1[pad], speed, hold, end)]
    )
    found = force(paper_model(pad), time, np.minimum(speed * time, 1.6))
    assert np.max(np.abs(found - expected)) < 1e-12 * expected.max()


def corners(platen, steps):
    """A grid on which every accelerating piece has ``steps`` straight lines."""
    parts = [
        np.linspace(p.start, p.start + p.duration, (steps if p.acceleration else 20) + 1)
        for p in platen.pieces
    ]
    time = np.unique(np.concatenate(parts))
    return np.clip(time, 0.0, platen.duration)


def quadrature(model, time, depth):
    """Eq. 6 on straight lines between the points, Gauss-Legendre on each line."""
    c, v = np.asarray(model.relaxation.c), np.asarray(model.relaxation.v)
    width = np.diff(time)[:, None]
    travel = np.diff(depth, prepend=0.0)
    fraction = 0.5 * (1.0 + NODES)
    s = time[:-1, None] + width * fraction
    place = depth[:-1, None] + travel[1:, None] * fraction
    stiffness = np.asarray(model.elastic.stiffness(jnp.asarray(place)))
    inner = 0.5 * WEIGHTS * stiffness * travel[1:, None]
    jump = float(model.elastic.force(jnp.asarray(depth[0])))
    total = []
    for k, t in enumerate(time):
        age = t - s[:k]
        relaxed = c[0] + np.exp(-age[..., None] * v) @ c[1:]
        first = c[0] + np.exp(-(t - time[0]) * v) @ c[1:]
        total.append(np.sum(relaxed * inner[:k]) + jump * first)
    return np.array(total)


def test_whole_protocol_is_the_integral_on_the_same_straight_lines(paper_model):
    """The only error left is rounding: the recursion is exact for piecewise-linear motion."""
    platen = Platen(paper_protocol(100.0))
    time = corners(platen, 30)
    depth = platen.displacement(time)
    model = paper_model("B", bonded=True)
    expected = quadrature(model, time, depth)
    found = force(model, time, depth)
    assert np.max(np.abs(found - expected)) < 1e-10 * expected.max()


@pytest.mark.parametrize("glued", [True, False])
@pytest.mark.parametrize("speed", PAPER_RATES)
@pytest.mark.few(2)
def test_whole_protocol_solves_the_differential_equations(paper_model, speed, glued):
    """Against a stiff solver on the true motion, with chords too short to matter."""
    platen = Platen(paper_protocol(speed))
    time = corners(platen, 2000)
    expected = Pad(TABLE_1["B"], bonded=glued).force(platen, time)
    found = force(paper_model("B", bonded=glued), time, platen.displacement(time))
    assert np.max(np.abs(found - expected)) < 2e-7 * expected.max()


def protocol_points(points=64):
    platen = Platen(paper_protocol(20.0))
    places = np.sort(np.concatenate([platen.kinks, np.linspace(0.0, 1.0, points // 2)]))
    time = np.unique(np.concatenate([places, np.linspace(1.0, platen.duration, points // 2)]))
    return time, platen.displacement(time)


def test_slopes_in_constants_and_displacement_are_central_differences(paper_model):
    time, depth = protocol_points()
    model = paper_model("B", bonded=True)
    weights = np.random.default_rng(0).standard_normal(time.size)

    @jax.jit
    def projected(values, places):
        return weights @ force_of(with_constants(model, values), time, places)

    point = (constants_of(model), jnp.asarray(depth))
    reverse = jax.grad(projected, argnums=(0, 1))(*point)
    for which in (0, 1):
        forward = jax.jacfwd(projected, argnums=which)(*point)
        assert np.allclose(reverse[which], forward, rtol=1e-10, atol=1e-12)
        for k in range(point[which].size):
            size = 1e-5 * max(abs(float(point[which][k])), 0.1)
            ends = []
            for sign in (1.0, -1.0):
                moved = list(point)
                moved[which] = moved[which].at[k].add(sign * size)
                ends.append(projected(*moved))
            difference = (ends[0] - ends[1]) / (2.0 * size)
            scale = np.max(np.abs(forward))
            assert abs(difference - forward[k]) < 1e-8 * scale


def retraction(low):
    """Press, hold, retract to ``low``, wait, press again."""
    time = np.array([0.0, 0.1, 2.0, 2.1, 2.2, 4.0, 4.4, 5.0])
    return time, np.array([0.0, 1.6, 1.6, 0.8, low, low, 0.5, 0.5])


def test_a_loose_pad_never_pulls_and_slopes_are_finite_where_contact_is_lost(paper_model):
    time, depth = retraction(0.05)
    loose, glued = (force(paper_model("B", bonded=g), time, depth) for g in (False, True))
    assert np.min(glued) < -0.1
    assert np.min(loose) == 0.0
    assert np.array_equal(loose, np.maximum(glued, 0.0))
    model = paper_model("B")
    near, far = (force(model, *retraction(low)) for low in (0.0, -3.0))
    time, _ = retraction(0.0)
    assert np.array_equal(near, far)
    assert np.all(force(model, time, -np.linspace(0.1, 2.0, time.size)) == 0.0)
    assert np.all(force(paper_model("B", bonded=True), time, -0.1 * time)[1:] < 0.0)
    time, depth = retraction(0.05)
    model = paper_model("B")

    def total(values, places):
        glued = with_constants(model, values)
        return jnp.sum(force_of(Model(glued.elastic, glued.relaxation), time, places))

    slopes = jax.grad(total, argnums=(0, 1))(constants_of(model), jnp.asarray(depth))
    assert all(np.all(np.isfinite(x)) for x in slopes)


RELAXATION = Prony(jnp.array([0.3, 0.6, 0.1]), jnp.array([6.0, 0.5]))
STEPS, CURVE = np.arange(4.0), np.array([0.0, 1.6, 1.1, 0.6])


def hostile(b=1.0, time=STEPS, depth=CURVE, rates=(6.0, 0.5)):
    """Law, relaxation, times and depths."""
    relaxation = Prony(RELAXATION.c, jnp.array(rates))
    return Exponential(0.4, b), relaxation, np.array(time), np.array(depth)


HOSTILE = {
    "growth cancels decay": hostile(),
    "one mode never relaxes": hostile(rates=(6.0, 0.0)),
    "a mode barely relaxes": hostile(rates=(1e-12, 1e-300)),
    "no stiffening": hostile(0.0),
    "almost no stiffening": hostile(1e-14),
    "softening": hostile(-1.0),
    "no motion": hostile(depth=np.zeros(4)),
    "standing at depth": hostile(depth=np.full(4, 0.7)),
    "jump at the first sample": hostile(depth=CURVE + 0.5),
    "late start": hostile(time=1e3 + STEPS),
    "repeated points": hostile(
        time=[0.0, 0.0, 1.0, 1.0, 2.0, 2.0], depth=[0.0, 0.0, 1.6, 1.6, 0.8, 0.8]
    ),
    "a jump within the record": hostile(time=[0.0, 1.0, 1.0, 2.0], depth=[0.0, 0.2, 1.6, 0.8]),
    "very stiff mode": hostile(rates=(1e4, 0.5)),
    "one point": hostile(time=[0.0], depth=[0.7]),
    "two points": hostile(time=STEPS[:2], depth=CURVE[:2]),
    "three points": hostile(time=STEPS[:3], depth=CURVE[:3]),
    "five points": hostile(time=np.arange(5.0), depth=np.append(CURVE, 0.6)),
}


def fine_quadrature(model, time, depth):
    """Lines cut finely toward both ends, for modes as stiff as 1e4/s."""
    cut = np.geomspace(1e-7, 0.5, 80)
    cut = np.concatenate([[0.0], cut, 1.0 - cut[-2::-1], [1.0]])
    places = np.unique(np.concatenate([k + cut for k in range(time.size - 1)] + [[0.0]]))
    index = np.arange(float(time.size))
    finer = np.interp(places, index, time), np.interp(places, index, depth)
    return quadrature(model, *finer)[np.isin(places, index)]


@pytest.mark.parametrize("case", HOSTILE)
@pytest.mark.few(2)
def test_hostile_motions_and_constants_give_exact_forces_and_finite_slopes(case):
    elastic, relaxation, time, depth = HOSTILE[case]
    model = bonded(elastic, relaxation)
    found = force(model, time, depth)
    expected = fine_quadrature(model, time, depth)
    assert np.allclose(found, expected, rtol=1e-10, atol=1e-10 * np.max(np.abs(expected)))

    def total(values, places, clock):
        return jnp.sum(jnp.sin(force_of(with_constants(model, values), clock, places)))

    arguments = (constants_of(model), jnp.asarray(depth), jnp.asarray(time))
    for slopes in (jax.grad, jax.jacfwd):
        for slope in jax.jit(slopes(total, argnums=(0, 1, 2)))(*arguments):
            assert np.all(np.isfinite(slope))


def test_slopes_where_growth_cancels_decay_are_those_beside_it():
    """B gamma = -v_2 exactly: 0/0 in the closed form, ordinary in the pad."""
    elastic, relaxation, time, depth = HOSTILE["growth cancels decay"]
    model = bonded(elastic, relaxation)
    assert elastic.b * (depth[2] - depth[1]) + relaxation.v[1] * (time[2] - time[1]) == 0.0
    slopes = jax.jit(
        jax.jacfwd(lambda values: force_of(with_constants(model, values), time, depth))
    )
    point = constants_of(model)
    size = 1e-5
    for k in (1, 6):
        near = [
            force(with_constants(model, point.at[k].add(sign * size)), time, depth)
            for sign in (1, -1)
        ]
        assert np.allclose(slopes(point)[:, k], (near[0] - near[1]) / (2 * size), atol=1e-9)


@pytest.mark.parametrize("points", [3, 17, 100])
def test_every_length_is_the_beginning_of_a_longer_one(paper_model, points):
    rng = np.random.default_rng(points)
    time, depth = np.cumsum(rng.exponential(0.2, 130)), rng.uniform(0.0, 1.6, 130)
    model = paper_model("A", bonded=True)
    whole = force(model, time, depth)
    part = force(model, time[:points], depth[:points])
    assert np.allclose(part, whole[:points], rtol=1e-12, atol=1e-13)


def test_hertz_converges_at_second_order_or_better():
    """From first touch, where the force is least smooth, and back, against the finest grid."""
    model = bonded(HertzPower(0.5, 1.5), RELAXATION)
    exact = fine_quadrature(model, np.arange(4.0), np.array([0.0, 1.6, 1.6, 0.4]))
    errors = []
    for pieces in (20, 40, 80):
        time = np.linspace(0.0, 3.0, 3 * pieces + 1)
        depth = np.interp(time, [0.0, 1.0, 2.0, 3.0], [0.0, 1.6, 1.6, 0.4])
        errors.append(np.abs(force(model, time, depth)[::pieces] - exact)[1:])
    errors = np.array(errors)
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 2.0)
    assert errors[-1].max() < 1e-6


@pytest.mark.parametrize("points", [3, 60])
def test_a_parabola_told_by_its_sagitta_is_exact_for_a_linear_law(points):
    """d = t^2 makes k (c_0 t^2 + sum_i 2 c_i (t/v_i - (1 - e^{-v_i t})/v_i^2)), on any grid."""
    relaxation = Prony(jnp.array([0.2, 0.5, 0.3]), jnp.array([40.0, 0.3]))
    time = np.sort(np.random.default_rng(points).uniform(0.0, 3.0, points))
    time[0] = 0.0
    sagitta = np.append(0.0, -(np.diff(time) ** 2) / 4.0)
    still = jnp.zeros(points)
    motion = Motion(
        jnp.asarray(time), jnp.asarray(time**2), still, still, sagitta=jnp.asarray(sagitta)
    )
    found = bonded(Linear(2.0), relaxation).force(motion)
    c, v = np.asarray(relaxation.c), np.asarray(relaxation.v)
    grown = time[:, None] / v + np.expm1(-v * time[:, None]) / v**2
    expected = 2.0 * (c[0] * time**2 + 2.0 * grown @ c[1:])
    assert np.allclose(found, expected, rtol=0.0, atol=1e-10 * expected.max())


def test_sagittas_make_a_sine_a_hundred_times_as_exact(paper_model):
    """At sixteen steps a cycle, against the force on a very fine grid."""

    def sine(steps, curved):
        time = np.linspace(0.0, 3.0, 3 * steps + 1)
        depth = lambda t: 0.8 * (1.0 - np.cos(2.0 * np.pi * t))  # noqa: E731
        middle = depth(0.5 * (time[1:] + time[:-1]))
        sagitta = np.append(0.0, middle - 0.5 * (depth(time)[1:] + depth(time)[:-1]))
        still = jnp.zeros(time.shape)
        own = jnp.asarray(sagitta) if curved else None
        motion = Motion(jnp.asarray(time), jnp.asarray(depth(time)), still, still, sagitta=own)
        return np.asarray(whole(paper_model("B", bonded=True), motion))

    exact = sine(1600, True)[::100]
    straight, curved = sine(16, False) - exact, sine(16, True) - exact
    assert np.max(np.abs(curved)) < 0.01 * np.max(np.abs(straight))
