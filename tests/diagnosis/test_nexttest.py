"""Check what further tests would show, by closed forms, Monte Carlo and tests that a rig can do."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm
from support.savedfit import REACH, saved

from qlvbayes import InputError, predict_program
from qlvbayes.diagnosis.nexttest.belief import STEP, Belief, Explanation, Products, between, screen
from qlvbayes.diagnosis.nexttest.design import LEAST_WAIT, Design, Readings, Rig, draw_designs
from qlvbayes.diagnosis.nexttest.planning import Goal, plan_tests
from qlvbayes.diagnosis.prior import Families
from qlvbayes.effects.catalogue import EVERY
from qlvbayes.io.units import PAD
from qlvbayes.model.drawn import described_model
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.pipeline.designing import PAUSE, as_csv, set_points

RIG = Rig(depth=1.6, speed=40.0, acceleration=1000.0)
READINGS = Readings(RIG, NoiseFloor(white=0.006, ou=0.008, tau=0.5), peak=1.5)
PRESS = Design(1.5, 10.0, 1000.0, hold=5.0, share=1.0, rest=5.0, wait=40.0)
SLOW = structs.replace(PRESS, speed=1.0)
SPECTRUM = np.array([0.63, 0.07]), np.array([6.2, 0.14])


@pytest.fixture(scope="module")
def pad():
    """The belief in a fit whose constants are known to 3 %."""
    fit = saved()
    draws = dict(zip(fit.names, fit.draws.T, strict=True))
    model = described_model(fit.choices, REACH.depth)
    return Belief((Explanation.from_draws("a pad", model, draws, 1.0, "no effect"),))


def law(slopes, probability=1.0, force=0.0, cause=None):
    """An explanation whose force is ``force`` + slopes z at every block; rows of slopes."""
    rows = np.asarray(slopes)

    def run(constants, record):
        shape = np.asarray(record.blocks.first) / 10.0
        basis = np.stack([shape**k for k in range(len(rows))])
        return force + np.einsum("kf,ftb->ktb", constants * rows, basis)

    size, none = len(rows), np.zeros(len(rows), dtype=bool)
    names, kinds = tuple(f"a{k}" for k in range(size)), ("force",) * size
    known = names, kinds, np.zeros(size), np.eye(size), none, none, run, SPECTRUM
    return Explanation(str(force), probability, str(force) if cause is None else cause, *known)


def products(*parts, p=None, causes=None):
    """Return the products of whitened forces and slopes, one (1 + F, n) an explanation."""
    parts = [np.atleast_2d(part) for part in parts]
    rows, count = np.concatenate(parts), len(parts)
    p, causes = p if p is not None else [1.0 / count] * count, causes or [None] * count
    some = [
        law(np.ones(len(part) - 1), share, k, cause)
        for k, (part, share, cause) in enumerate(zip(parts, p, causes, strict=True))
    ]
    return Products(Belief(tuple(some)), (rows @ rows.T)[None])


def bits(belief, readings, names=("m", "b")):
    return screen(belief, [PRESS], readings).bits_for_constants(names)[0]


def test_an_amplitude_near_zero_keeps_its_moments_and_a_scale_those_of_its_logarithm():
    rng, fit = np.random.default_rng(0), saved(**{"viscous_drag.eta": 0.01})
    draws = dict(zip(fit.names, fit.draws.T, strict=True))
    draws["viscous_drag.eta"] = np.abs(rng.standard_normal(len(fit.draws)))
    draws["v[2]"] = np.exp(rng.standard_normal(len(fit.draws)))
    model = described_model(fit.choices, REACH.depth)
    one = Explanation.from_draws("a pad", model, draws, 1.0, "drag")
    found = dict(zip(one.names, zip(one.centre, np.linalg.norm(one.gradient, axis=1), strict=True),
                     strict=True))  # fmt: skip
    eta, logs = draws["viscous_drag.eta"], np.log(draws["v[2]"])
    assert found["viscous_drag.eta"] == pytest.approx((eta.mean(), eta.std(ddof=1)))
    middle = np.exp(logs.mean())
    assert found["v[2]"] == pytest.approx((middle, middle * logs.std(ddof=1)), rel=0.02)


def test_bits_are_those_of_the_textbook_and_what_one_may_take_is_not_known_of_another():
    """One constant of slopes 1 and 2 in units of the noise: half log2 of 1 + 5, s = 5."""
    found = products([[0.0, 0.0], [1.0, 2.0]])
    assert found.bits_for_constants(("a0",))[0] == pytest.approx(0.5 * np.log2(6.0))
    assert found.sds(0, np.array([[3.0]]))[0, 0] == pytest.approx(3.0 / np.sqrt(6.0))
    found = products([[0.0, 0.0], [1.0, 2.0], [1.0, 2.0]])
    assert found.bits_for(0, np.array([[1.0, 0.0]]))[0] == pytest.approx(-0.5 * np.log2(6.0 / 11.0))
    both = np.array([[1.0, 1.0]]) / np.sqrt(2.0)
    assert found.bits_for(0, both)[0] == pytest.approx(0.5 * np.log2(11.0))
    again = np.concatenate([both, both])  # a constant that others determine adds nothing
    assert found.bits_for(0, again)[0] == pytest.approx(0.5 * np.log2(11.0), abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_distances_are_those_between_normals(seed):
    rng = np.random.default_rng(seed)
    one, two = rng.normal(size=(3, 5)), rng.normal(size=(4, 5))
    found = products(one, two)
    S, T = (np.eye(5) + x[1:].T @ x[1:] for x in (one, two))
    d, half = one[0] - two[0], 0.5 * (S + T)
    logs = [np.linalg.slogdet(x)[1] for x in (half, S, T)]
    near = d @ np.linalg.solve(half, d) / 8.0 + 0.5 * (logs[0] - 0.5 * (logs[1] + logs[2]))
    assert found.distances[0][0, 1, 0] == pytest.approx(near)
    far = [
        0.5 * (np.trace(np.linalg.solve(b, a)) + d @ np.linalg.solve(b, d) - 5 + gap)
        for a, b, gap in ((S, T, logs[2] - logs[1]), (T, S, logs[1] - logs[2]))
    ]
    assert [found.distances[1][0, 1, 0], found.distances[1][1, 0, 0]] == pytest.approx(far)
    assert found.evidence()[0] == pytest.approx(2.0 * min(far))


@pytest.mark.parametrize("causes", ["abc", "aba"])
@pytest.mark.parametrize("seed", range(3))
def test_bits_for_the_cause_lie_between_their_bounds(seed, causes):
    """Against Monte Carlo over the exact mixture: explanations 0 and 2 may be of one cause."""
    rng = np.random.default_rng(seed)
    parts = [(4 - len(set(causes))) * rng.normal(size=(2, 3)) for _ in range(3)]
    p = rng.dirichlet(np.full(3, 3.0))
    low, high = (x[0] for x in products(*parts, p=p, causes=causes).bits_for_cause())
    normals = [multivariate_normal(x[0], np.eye(3) + np.outer(x[1], x[1])) for x in parts]
    exact = 0.0
    for own, share, cause in zip(normals, p, causes, strict=True):
        y = own.rvs(4000, random_state=rng)
        logs = np.stack([other.logpdf(y) for other in normals]) + np.log(p)[:, None]
        same = [k for k, other in enumerate(causes) if other == cause]
        within = logsumexp(logs[same], axis=0) - np.log(p[same].sum())
        exact += share * np.mean(within - logsumexp(logs, axis=0))
    assert low - 0.04 < exact / np.log(2.0) < high + 0.04  # of 12 000 draws


def test_of_causes_that_differ_little_a_third_of_the_way_between_the_bounds_is_exact():
    """Two equally probable normals, 0.1 sds apart, against the information by quadrature."""
    gap = 0.1
    y = np.linspace(-9.0, 9.0, 20_001)
    densities = np.stack([norm.pdf(y), norm.pdf(y, gap)])
    mixture = densities.mean(axis=0)
    exact = 0.5 * np.trapezoid(densities * np.log2(densities / mixture), y, axis=1).sum()
    low, high = products([[0.0], [0.0]], [[gap], [0.0]]).bits_for_cause()
    assert between(low, high)[0] == pytest.approx(exact, rel=0.01)


def test_laws_of_one_cause_are_one_answer_and_what_the_model_misses_makes_a_test_less_sure():
    """Two explanations far apart tell nothing of a cause that both have, all of another."""
    both = [law([0.001], 0.6, cause="drag"), law([0.001], 0.4, force=0.1, cause="drag")]
    one = Belief.from_explanations(both)
    found = screen(one, [PRESS], READINGS)
    assert one.causes == {"drag": pytest.approx(1.0)}
    assert one.entropy == found.evidence()[0] == 0.0
    assert [x[0] for x in found.bits_for_cause()] == [0.0, 0.0]
    two = Belief.from_explanations([*both, law([0.001], 1.0, force=0.2, cause="leak")])
    low, _ = screen(two, [PRESS], READINGS).bits_for_cause()
    assert low[0] == pytest.approx(two.entropy, abs=0.01)
    assert two.entropy == pytest.approx(1.0)
    # 0.1 N that the model misses leave two explanations 0.01 N apart as they were
    near = Belief.from_explanations([law([0.001]), law([0.001], force=0.01)])
    clear, doubtful = (
        screen(near, [PRESS], replace(READINGS, missed=missed)) for missed in (0.0, 0.1)
    )
    assert clear.bits_for_cause()[0][0] > 0.3
    assert doubtful.bits_for_cause()[1][0] < 0.5 * clear.bits_for_cause()[0][0]
    assert doubtful.evidence()[0] < 0.1 * clear.evidence()[0]


def test_a_cause_counts_by_all_its_laws_and_forms():
    """Four percent on each of two laws are a cause; so are the forms of one family together."""
    families = Families.from_kinds(EVERY)
    found = [
        ("viscous_drag", 0.5), ("viscous_drag", 0.1), ("friction viscous_drag", 0.06),
        ("pressure_friction viscous_drag", 0.1), ("friction", 0.04), ("friction", 0.04),
        ("force_drift", 0.04),
    ]  # fmt: skip
    some = [law([0.1], p, k, families.cause(own.split())) for k, (own, p) in enumerate(found)]
    belief = Belief.from_explanations(some)
    expected = {"viscous_drag": 0.6, "friction + viscous_drag": 0.16, "friction": 0.08}
    assert belief.causes == pytest.approx({name: p / 0.84 for name, p in expected.items()})
    assert len(belief.explanations) == 5
    assert families.cause(()) == "no effect"


def test_the_cause_is_asked_for_by_all_bits_and_not_by_bits_a_minute():
    """No design that fits tells clearly more than the proposed one."""
    belief = Belief.from_explanations([law([0.002]), law([0.002], force=0.004)])
    goal = Goal((), True, minutes=6.0, tests=1)
    (best,) = plan_tests("B", PAD, belief, READINGS, goal, count=64).tests
    designs = draw_designs(RIG, belief.recovery, 360.0, 64, 0)
    expected = between(*screen(belief, designs, READINGS).bits_for_cause())
    assert best.judged.cause > expected.max() - 0.011
    rates = expected / [one.wait + one.seconds for one in designs]
    assert best.judged.cause > expected[np.argmax(rates)]


def test_the_closed_form_is_that_of_nested_monte_carlo(pad):
    """Constants known to 3 % bend the forces little."""
    (one,), rng = pad.explanations, np.random.default_rng(0)
    record = READINGS.record([PRESS])
    blocks = type(record.blocks)(**{k: np.asarray(x)[0] for k, x in vars(record.blocks).items()})
    first = one.forces(np.zeros((1, one.size)), record)[0, 0]

    def white(z):
        return READINGS.whitened(PRESS, blocks, first, one.forces(z, record)[:, 0])

    centre = white(np.zeros((1, one.size)))[0]
    slopes = (white(STEP * np.eye(one.size)) - centre) / STEP
    precision = np.eye(one.size) + slopes @ slopes.T
    root = 1.2 * np.linalg.cholesky(np.linalg.inv(precision))  # wider, so that no weight is large
    z = rng.standard_normal((100, one.size))
    noise = rng.standard_normal((100, centre.size))
    gains = []
    for y, own in zip(white(z) + noise, noise, strict=True):
        normal = rng.standard_normal((200, one.size))
        draws = np.linalg.solve(precision, slopes @ (y - centre)) + normal @ root.T
        logs = -0.5 * np.sum((y - white(draws)) ** 2, axis=1) - 0.5 * np.sum(draws**2, axis=1)
        logs += 0.5 * np.sum(normal**2, axis=1) + np.linalg.slogdet(root)[1]
        gains.append(-0.5 * own @ own - logsumexp(logs) + np.log(200))
    found, error = np.mean(gains) / np.log(2.0), np.std(gains) / np.log(2.0) / 10.0
    expected = 0.5 * np.linalg.slogdet(precision)[1] / np.log(2.0)
    assert found == pytest.approx(expected, abs=4.0 * error)
    assert error < 0.05 * expected
    assert bits(pad, READINGS, one.names) == pytest.approx(expected, rel=1e-3)
    loud = replace(READINGS, floor=NoiseFloor(0.012, 0.016, 0.5))
    few = replace(READINGS, rig=structs.replace(RIG, rows=100))
    assert max(bits(pad, loud), bits(pad, few)) < bits(pad, READINGS)


def test_a_pad_has_recovered_when_its_modes_have():
    """One mode of half the force, pressed for long: e^-t of it is left, a hundredth in the end."""
    one = replace(law([1.0]), spectrum=(np.array([0.5]), np.array([1.0])))
    belief = Belief.from_explanations([one])
    assert belief.recovery(1000.0) == pytest.approx(np.log(50.0), rel=0.05)
    assert belief.recovery(0.001) < 0.2  # nothing was excited


@pytest.mark.parametrize(
    ("seed", "depth", "speed", "acceleration"), [(0, 0.1, 100.0, 50.0), (1, 5.0, 1.0, 5000.0)]
)
def test_set_points_stay_within_the_rig(seed, depth, speed, acceleration):
    rig, recovery = Rig(depth, speed, acceleration), Belief((law([1.0]),)).recovery
    designs = draw_designs(rig, recovery, 120.0, 16, seed)
    for one in designs:
        assert one.wait >= LEAST_WAIT
        assert one.wait + one.seconds <= 120.0
        record = replace(READINGS, rig=rig).record([one])
        assert np.all(np.diff(np.asarray(record.motion.time)) >= 0.0)
        assert np.all(np.asarray(record.blocks.first) <= np.asarray(record.blocks.last))
    time, place, tests = set_points(designs[:2])
    assert np.allclose(np.diff(time), 1e-3)
    assert place.min() >= 0.0
    assert place.max() <= depth * (1.0 + 1e-9)
    speeds = np.diff(place) * 1000.0
    assert np.max(np.abs(speeds)) <= speed * (1.0 + 1e-6)
    assert np.max(np.abs(np.diff(speeds))) * 1000.0 <= 2.0 * acceleration * (1.0 + 1e-3)
    assert place[0] == place[-1] == 0.0
    assert all(x == 0.0 for x, test in zip(place, tests, strict=True) if test == PAUSE)
    if len(designs) > 1:
        pauses = np.sum([test == PAUSE for test in tests]) / 1000.0
        assert pauses == pytest.approx(designs[1].wait, abs=0.003)


def test_a_record_is_the_motion_of_the_set_points_as_they_are_written(pad, tmp_path):
    """Block means of the reduced grid against a fine one; of a slow press braking is nothing."""
    path = tmp_path / "set_points.csv"
    path.write_text(as_csv([SLOW, structs.replace(SLOW, wait=60.0)], PAD))
    assert path.read_text().startswith("time_s,displacement_mm,test\n0.000,0,next-1\n")
    one, record = pad.explanations[0], READINGS.record([SLOW])
    force = one.forces(np.zeros((1, one.size)), record)[0, 0]
    model = {name: np.full(100, value) for name, value in zip(one.names, one.centre, strict=True)}
    by_words = predict_program(model, "ramp 1.5 mm at 1 mm/s, hold 5 s", draws=1)
    first, last, real = (
        np.asarray(getattr(record.blocks, x))[0] for x in ("first", "last", "real")
    )
    held = real & (last < 6.4) & (first > 0.3)
    expected = np.interp(0.5 * (first + last)[held], by_words.time, by_words.median)
    assert force[held] == pytest.approx(expected, rel=0.01)
    found = predict_program(model, path, draws=1)
    assert np.max(found.given) == pytest.approx(1.5)
    assert found.median.max() == pytest.approx(by_words.median.max(), rel=0.01)


def test_a_plan_repeats_with_its_seed_and_fits_its_time(pad):
    def plan(seed, minutes=4.0):
        goal = Goal(("m",), False, minutes, 3)
        return plan_tests("B", PAD, pad, READINGS, goal, seed=seed, count=64)

    first, again, other = plan(0), plan(0), plan(1)
    assert first == again
    assert first.tests != other.tests
    assert len(first.tests) == 3
    assert sum(one.minutes for one in first.tests) <= 4.0
    total = sum(one.constants for one in first.tests)
    assert first.together.constants == pytest.approx(total)
    # each test adds less than the ones before it, a minute
    rates = [one.per_minute for one in first.tests]
    assert rates == sorted(rates, reverse=True)
    with pytest.raises(InputError, match=r"no test fits into 0\.1 minutes"):
        plan(0, 0.1)
