"""Check what further tests would show, by closed forms, Monte Carlo and tests that a rig can do."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm
from support.endtoend import PADS, call, one_line
from support.nested_bits import WhitenedTests, nested_bits
from support.savedfit import REACH, saved

from qlvbayes import InputError, predict_program
from qlvbayes.diagnosis.nexttest.belief import Belief, Explanation
from qlvbayes.diagnosis.nexttest.design import (
    FORGOTTEN,
    LEAST_WAIT,
    PAUSE,
    Design,
    RecoveryTime,
    Rig,
    as_csv,
    draw_designs,
    set_points,
)
from qlvbayes.diagnosis.nexttest.explanations import explanation_of_draws
from qlvbayes.diagnosis.nexttest.information import Products, evidence, screen
from qlvbayes.diagnosis.nexttest.knowledge import probable_alternatives
from qlvbayes.diagnosis.nexttest.records import ReadingErrors, record_of
from qlvbayes.diagnosis.nexttest.series import Goal, between, bits_for_constants, plan_series
from qlvbayes.diagnosis.nexttest.suggest import cause_of
from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.result import Alternative, LawPair
from qlvbayes.effects.catalogue import EVERY
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.pipeline.derived import design_into

RIG = Rig(depth=1.6, speed=40.0, acceleration=1000.0)
ERRORS = ReadingErrors(NoiseFloor(white=0.006, ou=0.008, tau=0.5), peak=1.5)
PRESS = Design(1.5, 10.0, 1000.0, hold=5.0, share=1.0, rest=5.0, wait=40.0)
SLOW = replace(PRESS, speed=1.0)
RECOVERY = RecoveryTime(((np.array([0.63, 0.07]), np.array([6.2, 0.14])),))


@pytest.fixture(scope="module")
def pad():
    """The belief in a fit whose constants are known to 3 %."""
    fit = saved()
    one = explanation_of_draws(fit.choices, fit.names, fit.draws, REACH.depth)
    return Belief.from_explanations([one])


def bits(belief, errors, names=("m", "b"), designs=(PRESS,)):
    products, _ = screen(belief, designs, RIG, errors, 0.0)
    return bits_for_constants(belief, products, names)


def products(*parts):
    """Return the products of whitened forces and slopes, one (1 + F, n) an explanation."""
    rows = np.concatenate([np.atleast_2d(part) for part in parts])
    return Products((rows @ rows.T)[None], tuple(len(np.atleast_2d(p)) - 1 for p in parts))


def law(slopes, probability=1.0, force=0.0, power=1.0):
    """An explanation whose force is ``force`` + slopes z^power at every block; rows of slopes."""
    rows = np.asarray(slopes)

    def run(constants, record):
        shape = np.asarray(record.blocks.first) / 10.0
        basis = np.stack([shape**k for k in range(len(rows))])
        return force + np.einsum("kf,ftb->ktb", np.sign(constants) * abs(constants) ** power * rows,
                                 basis)  # fmt: skip

    names = tuple(f"a{k}" for k in range(len(rows)))
    kinds = ("force",) * len(rows)
    spectrum = np.array([0.5]), np.array([1.0])
    return Explanation(
        str(force), probability, len(rows), names, kinds, lambda z: z, run, *spectrum
    )


def test_bits_are_those_of_the_textbook():
    """One constant with slopes 1 and 2 in units of the noise: half log2 of 1 + 5."""
    found = products([[0.0, 0.0], [1.0, 2.0]])
    assert found.bits_for(0, np.eye(1))[0] == pytest.approx(0.5 * np.log2(6.0))
    assert found.sds(0, np.array([[3.0]]))[0, 0] == pytest.approx(3.0 / np.sqrt(6.0))


def test_what_one_constant_may_take_is_not_known_of_another():
    """Two constants with the same slope: their sum is known, each of them half in doubt.

    M = [[1 + s, s], [s, 1 + s]] has the inverse's corner (1 + s)/(1 + 2 s).
    """
    found = products([[0.0, 0.0], [1.0, 2.0], [1.0, 2.0]])
    one = np.array([[1.0, 0.0]])
    assert found.bits_for(0, one)[0] == pytest.approx(-0.5 * np.log2(6.0 / 11.0))
    both = np.array([[1.0, 1.0]]) / np.sqrt(2.0)
    assert found.bits_for(0, both)[0] == pytest.approx(0.5 * np.log2(11.0))


def test_distances_of_two_forces_that_nothing_can_bend():
    """Forces 3 and 4 apart in units of the noise: d^2/8 and d^2/2."""
    none = [0.0, 0.0]
    found = products([[0.0, 0.0], none], [[3.0, 4.0], none])
    assert found.bhattacharyya(0, 1)[0] == pytest.approx(25.0 / 8.0)
    assert found.kullback(0, 1)[0] == pytest.approx(25.0 / 2.0)
    assert evidence(found)[0] == pytest.approx(25.0)


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_distances_are_those_between_normals(seed):
    rng = np.random.default_rng(seed)
    one, two = rng.normal(size=(3, 5)), rng.normal(size=(4, 5))
    found = products(one, two)
    S, T = (np.eye(5) + x[1:].T @ x[1:] for x in (one, two))
    d, half = one[0] - two[0], 0.5 * (S + T)
    logs = [np.linalg.slogdet(x)[1] for x in (half, S, T)]
    near = d @ np.linalg.solve(half, d) / 8.0 + 0.5 * (logs[0] - 0.5 * (logs[1] + logs[2]))
    far = 0.5 * (
        np.trace(np.linalg.solve(T, S)) + d @ np.linalg.solve(T, d) - 5 + logs[2] - logs[1]
    )
    assert found.bhattacharyya(0, 1)[0] == pytest.approx(near)
    assert found.kullback(0, 1)[0] == pytest.approx(far)
    assert found.evidence(0, 1)[0] == pytest.approx(d @ np.linalg.solve(T, d))


@given(st.integers(0, 10_000), st.integers(1, 4))
@settings(max_examples=30, deadline=None)
def test_a_part_is_never_told_more_of_than_the_whole(seed, rank):
    rng = np.random.default_rng(seed)
    found = products(rng.normal(size=(5, 9)))
    part = np.linalg.qr(rng.normal(size=(4, rank)))[0].T
    whole = found.bits_for(0, np.eye(4))[0]
    assert -1e-12 <= found.bits_for(0, part)[0] <= whole + 1e-12
    assert (found + found).bits_for(0, part)[0] >= found.bits_for(0, part)[0]


@given(st.integers(0, 10_000), st.sampled_from([[[0], [1], [2]], [[0, 2], [1]]]))
@settings(max_examples=25, deadline=None)
def test_bits_for_the_cause_lie_between_their_bounds(seed, groups):
    """Against Monte Carlo over the exact mixture: explanations 0 and 2 may be of one cause."""
    rng = np.random.default_rng(seed)
    parts = [(4 - len(groups)) * rng.normal(size=(2, 3)) for _ in range(3)]
    p = rng.dirichlet(np.full(3, 3.0))
    low, high = (x[0] for x in products(*parts).bits_for_cause(p, groups))
    normals = [multivariate_normal(x[0], np.eye(3) + np.outer(x[1], x[1])) for x in parts]
    exact = 0.0
    for k, (own, share) in enumerate(zip(normals, p, strict=True)):
        y = own.rvs(4000, random_state=rng)
        logs = np.stack([other.logpdf(y) for other in normals]) + np.log(p)[:, None]
        same = next(group for group in groups if k in group)
        within = logsumexp(logs[same], axis=0) - np.log(p[same].sum())
        exact += share * np.mean(within - logsumexp(logs, axis=0))
    assert low - 0.04 < exact / np.log(2.0) < high + 0.04  # of 12 000 draws
    whole = products(*parts).bits_for_cause(p)
    assert low <= whole[1][0] + 1e-9


def test_of_causes_that_differ_little_a_third_of_the_way_between_the_bounds_is_exact():
    """Two equally probable normals, 0.1 sds apart, against the information by quadrature."""
    gap, none = 0.1, [0.0]
    found = products([[0.0], none], [[gap], none])
    y = np.linspace(-9.0, 9.0, 20_001)
    densities = np.stack([norm.pdf(y), norm.pdf(y, gap)])
    mixture = densities.mean(axis=0)
    exact = 0.5 * np.trapezoid(densities * np.log2(densities / mixture), y, axis=1).sum()
    low, high = found.bits_for_cause(np.array([0.5, 0.5]))
    assert between(low, high)[0] == pytest.approx(exact, rel=0.01)


def test_laws_of_one_cause_are_one_answer():
    """Two explanations far apart tell nothing of a cause that both have."""
    far = replace(law([0.001], 0.4, force=0.1), cause="drag")
    one = Belief.from_explanations([replace(law([0.001], 0.6), cause="drag"), far])
    found, _ = screen(one, [PRESS], RIG, ERRORS, 0.0)
    assert one.causes == {"drag": pytest.approx(1.0)}
    assert one.entropy == 0.0
    assert found.bits_for_cause(one.probabilities)[0][0] > 0.9
    assert [x[0] for x in found.bits_for_cause(one.probabilities, one.groups)] == [0.0, 0.0]
    assert evidence(found, one.groups)[0] == 0.0
    assert nested_bits(one, [PRESS], RIG, ERRORS, ()).cause == pytest.approx(0.0, abs=1e-12)
    two = Belief.from_explanations(
        [*one.explanations, replace(law([0.001], 1.0, force=0.2), cause="leak")]
    )
    nested = nested_bits(two, [PRESS], RIG, ERRORS, ())
    assert nested.cause == pytest.approx(two.entropy, abs=0.01)
    assert two.entropy == pytest.approx(1.0)


def test_a_cause_counts_by_all_its_laws_and_forms():
    """Four percent on each of two laws are a cause; so are the forms of one family together."""
    baseline, other = LawPair("exponential", "prony:2"), LawPair("hertz", "prony:2")
    families = Families.from_kinds(EVERY)
    found = probable_alternatives(
        [
            Alternative(baseline, ("viscous_drag",), 0.5),
            Alternative(other, ("viscous_drag",), 0.1),
            Alternative(baseline, ("friction", "viscous_drag"), 0.06),
            Alternative(baseline, ("pressure_friction", "viscous_drag"), 0.1),
            Alternative(baseline, ("friction",), 0.04),
            Alternative(other, ("friction",), 0.04),
            Alternative(baseline, ("force_drift",), 0.04),
        ],
        families,
    )
    causes = {}
    for one in found:
        cause = cause_of(one.effects, families)
        causes[cause] = causes.get(cause, 0.0) + one.probability
    expected = {"viscous_drag": 0.6, "friction + viscous_drag": 0.16, "friction": 0.08}
    assert causes == pytest.approx(expected)
    assert cause_of((), families) == "no effect"


def test_the_cause_is_asked_for_by_all_bits_and_not_by_bits_a_minute():
    """No design that fits tells clearly more than the proposed one."""
    belief = Belief.from_explanations([law([0.002]), law([0.002], force=0.004)])
    plan = plan_series(belief, RIG, ERRORS, Goal((), True), minutes=6.0, tests=1, count=64)
    designs = draw_designs(RIG, belief.recovery, 360.0, 64, 0)
    found, _ = screen(belief, designs, RIG, ERRORS, 0.0)
    expected = between(*found.bits_for_cause(belief.probabilities, belief.groups))
    (best,) = plan.tests
    assert best.expected_cause > expected.max() - 0.011
    rates = expected / [one.minutes for one in designs]
    assert best.expected_cause > expected[np.argmax(rates)]


def test_marginals_of_a_linear_law_are_exact():
    """Nested Monte Carlo gives the closed form, for one of two constants and for the cause."""
    belief = Belief.from_explanations([law([0.02, 0.01], 0.6), law([0.02], 0.4, force=0.01)])
    found, _ = screen(belief, [PRESS], RIG, ERRORS, 0.0)
    expected = bits_for_constants(belief, found, ("a0",))[0]
    nested = nested_bits(belief, [PRESS], RIG, ERRORS, ("a0",))
    assert nested.constants == pytest.approx(expected, abs=1e-6)
    low, high = (x[0] for x in found.bits_for_cause(belief.probabilities))
    assert low - 0.02 < nested.cause < high + 0.02


def test_bits_of_a_bent_law_are_those_of_plain_nested_monte_carlo():
    """One constant, force as z^3: the inner average over 20 000 draws of the prior."""
    belief = Belief.from_explanations([law([0.01], power=3.0)])
    nested = nested_bits(belief, [PRESS], RIG, ERRORS, ("a0",), outer=200, inner=40)
    trial = WhitenedTests(belief, [PRESS], RIG, ERRORS, 0.0)
    rng = np.random.default_rng(1)
    one = belief.explanations[0]
    z, prior = rng.standard_normal((400, 1)), rng.standard_normal((20_000, 1))
    shape = trial.forces(one, np.ones((1, 1)))[0]
    noise = rng.standard_normal((400, shape.size))
    # all forces are multiples of one shape: the rest of the noise cancels
    axis = shape / np.linalg.norm(shape)
    y = z[:, 0] ** 3 * np.linalg.norm(shape) + noise @ axis
    logs = -0.5 * (y[:, None] - prior[:, 0] ** 3 * np.linalg.norm(shape)) ** 2
    gains = -0.5 * (noise @ axis) ** 2 - logsumexp(logs, axis=1) + np.log(20_000)
    error = np.hypot(gains.std() / np.sqrt(400) / np.log(2.0), nested.constants_error)
    assert nested.constants == pytest.approx(gains.mean() / np.log(2.0), abs=4.0 * error)


def test_the_closed_form_is_that_of_nested_monte_carlo(pad):
    """Constants known to 3 % bend the forces little."""
    nested = nested_bits(pad, [PRESS], RIG, ERRORS, ("m", "b"))
    assert nested.constants == pytest.approx(bits(pad, ERRORS)[0], rel=0.2)
    assert nested.cause == 0.0


def test_more_noise_tells_less(pad):
    loud = replace(ERRORS, floor=NoiseFloor(0.012, 0.016, 0.5))
    assert np.all(bits(pad, loud) < bits(pad, ERRORS))
    few = screen(pad, [PRESS], structs.replace(RIG, rows=100), ERRORS, 0.0)[0]
    assert bits_for_constants(pad, few, ("m", "b"))[0] < bits(pad, ERRORS)[0]


def test_what_the_model_misses_makes_a_test_less_sure():
    """0.1 N of noise and two explanations 0.01 N apart leave them as they were."""
    belief = Belief.from_explanations([law([0.001]), law([0.001], force=0.01)])
    clear, _ = screen(belief, [PRESS], RIG, ERRORS, 0.0)
    doubtful, _ = screen(belief, [PRESS], RIG, replace(ERRORS, missed=0.1), 0.0)
    half = np.array([0.5, 0.5])
    assert clear.bits_for_cause(half)[0][0] > 0.3
    assert doubtful.bits_for_cause(half)[1][0] < 0.5 * clear.bits_for_cause(half)[0][0]
    assert evidence(doubtful)[0] < 0.1 * evidence(clear)[0]


def test_a_pad_has_recovered_when_its_modes_have():
    """One mode of half the force, pressed for long: e^-t of it is left."""
    one = RecoveryTime(((np.array([0.5]), np.array([1.0])),))
    assert one.time(1000.0) == pytest.approx(np.log(0.5 / FORGOTTEN), rel=0.05)
    assert one.time(0.001) < 0.2  # nothing was excited


@given(st.integers(0, 1000), st.floats(0.1, 5.0), st.floats(1.0, 100.0), st.floats(50.0, 5000.0))
@settings(max_examples=20, deadline=None)
def test_set_points_stay_within_the_rig(seed, depth, speed, acceleration):
    rig = Rig(depth, speed, acceleration)
    designs = draw_designs(rig, RECOVERY, 120.0, 16, seed)
    for one in designs:
        assert one.wait >= LEAST_WAIT
        assert one.wait + one.duration <= 120.0
        record = record_of([one], rig, 0.0)
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


def test_a_record_is_the_motion_that_is_run(pad):
    """Block means of the reduced grid against a fine one; of a slow press braking is nothing."""
    time, place, _ = set_points([SLOW])
    one = pad.explanations[0]
    record = record_of([SLOW], RIG, 0.0)
    force = one.forces(np.zeros((1, one.size)), record)[0, 0]
    model = {name: np.full(100, value) for name, value in zip(one.names, one.centre, strict=True)}
    found = predict_program(model, "ramp 1.5 mm at 1 mm/s, hold 5 s", draws=1)
    blocks = record.blocks
    held = np.asarray(blocks.real)[0] & (np.asarray(blocks.last)[0] < 6.4)
    held &= np.asarray(blocks.first)[0] > 0.3
    middle = 0.5 * (blocks.first + blocks.last)[0]
    expected = np.interp(np.asarray(middle)[held], found.time, found.median)
    assert force[held] == pytest.approx(expected, rel=0.01)
    assert place.max() == pytest.approx(1.5)
    assert time[-1] == pytest.approx(SLOW.duration, abs=1e-3)


def test_a_plan_repeats_with_its_seed_and_fits_its_time(pad):
    wish = Goal(("m",), False)

    def plan(seed):
        return plan_series(pad, RIG, ERRORS, wish, minutes=4.0, tests=3, seed=seed, count=64)

    first, again, other = plan(0), plan(0), plan(1)
    assert [one.design for one in first.tests] == [one.design for one in again.tests]
    assert first.after.values == pytest.approx(again.after.values, rel=1e-12)
    assert [one.design for one in first.tests] != [one.design for one in other.tests]
    assert len(first.tests) == 3
    assert first.minutes <= 4.0
    total = bits_for_constants(pad, first.after, ("m",))[0]
    assert total == pytest.approx(sum(one.constants for one in first.tests))
    # each test adds less than the ones before it, a minute
    rates = [one.constants / one.design.minutes for one in first.tests]
    assert rates == sorted(rates, reverse=True)
    with pytest.raises(InputError, match=r"no test fits into 0\.1 minutes"):
        plan_series(pad, RIG, ERRORS, wish, minutes=0.1, tests=1, count=64)


def test_set_points_go_through_predict(tmp_path):
    path = tmp_path / "set_points.csv"
    path.write_text(as_csv([SLOW, replace(SLOW, wait=60.0)], PAD))
    assert path.read_text().startswith("time_s,displacement_mm,test\n0.000,0,next-1\n")
    found = predict_program(saved(), path, draws=5)
    assert np.max(found.given) == pytest.approx(1.5)
    words = "ramp 1.5 mm at 1 mm/s, hold 5 s"
    assert found.median.max() == pytest.approx(
        predict_program(saved(), words, draws=5).median.max(), rel=0.01
    )


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fitted")
    call("fit", PADS, "-o", folder, "--pads", "B", "--method", "least-squares")
    return folder


@pytest.mark.slow
def test_the_command_leaves_a_plan_that_can_be_run(fitted):
    status, out, _ = call(
        "design", fitted, "--pad", "B", "--for", "m,b", "--minutes", 3, "--tests", 1, "--json",
        drawn=True,
    )  # fmt: skip
    assert status == 0
    (found,) = json.loads(out)
    assert found == json.loads((fitted / "B" / "design.json").read_text())
    assert found["constants"] == ["m", "b"]
    assert not found["cause"]
    assert found["widths"]["m"]["after"] < found["widths"]["m"]["now"]
    assert found["tests"][0]["depth_mm"] <= found["limits"]["depth_mm"]
    for name in ("set_points.csv", "design.png", "design.pdf"):
        assert (fitted / "B" / name).stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--pad", "Z"), "no results of pad 'Z'; name of B"),
        (("--for", "q"), "no constant 'q'; use cause, m, b"),
        (("--for", "cause"), "no diagnosis of this pad; run qlvbayes diagnose"),
        (("--minutes", "0.2"), "no test fits into 0.2 minutes"),
        (("--minutes", "-1"), "--minutes is -1; give it above 0"),
        (("--limits", "depth=0"), "--limits depth '0' are not numbers above 0"),
        (("--data", "nowhere.csv"), "nowhere.csv: no such file"),
    ],
)
def test_bad_input_is_one_line(fitted, words, says):
    status, out, err = call("design", fitted, *words)
    assert (status, out) == (2, "")
    assert says in one_line(err)


def test_a_folder_without_results_is_named(tmp_path):
    with pytest.raises(InputError, match="neither a fit nor a diagnosis"):
        design_into(tmp_path, "B", (), minutes=1.0, tests=1)


@pytest.mark.slow
def test_a_posterior_made_elsewhere_says_what_it_lacks(tmp_path):
    """Its draws, its noise, and what its tests cover must be known."""
    from qlvbayes.diagnosis.nexttest.knowledge import knowledge_from_fit

    with pytest.raises(InputError, match="does not say what its tests cover"):
        knowledge_from_fit(replace(saved(), covered=None))
    with pytest.raises(InputError, match="no noise"):
        knowledge_from_fit(saved())
    quiet = saved(**{"noise.white": 0.01})
    found = knowledge_from_fit(replace(quiet, choices=Choices(noise="white")))
    assert found.floor.white == pytest.approx(0.01, rel=0.02)
    assert found.rig.depth == REACH.depth


@pytest.mark.slow
def test_the_cause_of_an_ambiguous_pad_is_asked_for(tmp_path):
    """A drag nearly as the speed: what is proposed promises to tell it from one just so."""
    data, folder = tmp_path / "pad.csv", tmp_path / "out"
    hidden = "power_law_drag:k=0.003,n=0.9"
    call("simulate", "-o", data, "--pads", "B", "--rates", "0.1,1,20,100", "--max-rows", 300,
         "--hide", hidden)  # fmt: skip
    assert call("diagnose", data, "-o", folder)[0] == 0
    status, out, _ = call("design", folder, "--for", "cause", "--tests", 1, "--json")
    assert status == 0
    (found,) = json.loads(out)
    assert found["cause"]
    assert found["constants"] == []
    assert found["entropy"] > 0.3
    assert {"power_law_drag", "viscous_drag"} <= set(found["causes"])
    assert sum(found["causes"].values()) == pytest.approx(1.0)
    assert {one["cause"] for one in found["hypotheses"]} == set(found["causes"])
    (best,) = found["tests"]
    assert 0.0 <= best["cause"] <= best["cause_most"] <= found["entropy"] + 1e-9
    judged = best["judged"]
    assert best["cause"] < judged["cause"] == best["total"] < best["cause_most"]
    assert judged["cause"] > judged["cause_error"] > 0.0
    assert found["together"] == pytest.approx(judged)
    assert best["per_minute"] == pytest.approx(best["total"] / best["minutes"])
    moved = tmp_path / "elsewhere.csv"
    data.rename(moved)
    status, _, err = call("design", folder, "--for", "cause")
    assert status == 2
    assert "say where they are with --data FILE" in one_line(err)
