"""Predictions of tests that were not fitted, and the cells in which a wrong model fails."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from support.endtoend import TRUTH, experiment, fitted, study

from qlvbayes.fitting.prediction import Prediction, predict
from qlvbayes.fitting.residuals import check, check_pad
from qlvbayes.fitting.results import Saved
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.hereditary import hereditary_force
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.choices import Choices
from qlvbayes.motion.phases import Phase

UNWEIGHTED = SimpleNamespace(force_sd=None)  # a test whose file states no sds

ETA = 0.003  # N s/mm, of the drag that some tests below suffer from


def saved(found, all_tests=False):
    names, constants = tuple(found.names), found.constants
    return Saved(
        found.pad, names, constants, found.choices, found.method, "pads.csv", "", all_tests,
        ("B-20",),
    )  # fmt: skip


@pytest.fixture(scope="module")
def right():
    """Pad B with the model that made it."""
    return check_pad(saved(fitted()), study().pad("B"))


def check_other(change, *names):
    """Return the check of a pad of which all tests but the fitted one were changed."""
    tests = tuple(
        trial.test if trial.role == "fit" else replace(trial.test, **change(trial))
        for trial in experiment().trials
        if not names or trial.name in names
    )
    return check_pad(saved(fitted()), replace(study().pad("B"), tests=tests))


@pytest.fixture(scope="module")
def dragged():
    """The same, with a drag in every test but the fitted one."""
    return check_other(lambda one: {"force": one.test.force + drag(one, one.test.time)})


def test_a_known_error_of_the_zeros_is_no_failure_of_the_model():
    for contact_sd in (None, 0.08):
        off = {"contact_sd": contact_sd}
        found = check_other(
            lambda one, off=off: off | {"displacement": one.test.displacement + 0.08},
            *("B-1", "B-20", "B-100"),
        )
        failing = len(found.check.failing)
        assert failing >= 5 if contact_sd is None else failing == 0


def drag(trial, time):
    return ETA * trial.trajectory.velocity(time)


def cell(checked, test, phase):
    return next(c for c in checked.check.cells if (c.test, c.phase) == (test, phase))


def at_truth():
    """One draw (many times) of the constants that made pad B."""
    values = {"m": TRUTH.m, "b": TRUTH.b}
    values |= {f"c[{k}]": c for k, c in enumerate(TRUTH.c)}
    values |= {f"v[{k + 1}]": v for k, v in enumerate(TRUTH.v)}
    values |= {"noise.white": 0.006, "noise.ou": 0.008, "noise.tau": 0.5}
    values |= {"noise.factor": 1.0, "noise.remainder": 0.0}
    return {name: np.full(4, value) for name, value in values.items()}


def test_a_right_model_fails_nowhere_leaves_the_noise_floor_and_bands_cover_what_they_say(right):
    assert right.check.failing == []
    squares = [c.rmse**2 * c.n for c in right.check.cells]
    rms = np.sqrt(np.sum(squares) / np.sum([c.n for c in right.check.cells]))
    assert rms == pytest.approx(right.check.noise, rel=0.25)
    n = np.array([c.n for c in right.check.cells])
    covered = np.array([c.coverage90 for c in right.check.cells])
    assert 0.85 < np.average(covered, weights=n) < 0.97


def test_cells_hold_every_sample_and_say_what_predictions_and_trials_say(right):
    for prediction in right.predictions:
        cells = [c for c in right.check.cells if c.test == prediction.trial.name]
        assert sum(c.n for c in cells) == prediction.time.size
        # each phase has fewer samples than the most that are looked at: none is left out
        assert prediction.time.size == prediction.trial.test.time.size
        np.testing.assert_array_equal(prediction.observed, prediction.trial.test.force)
    prediction = right.predictions[0]
    here = prediction.phase == "ramp"
    ramp = cell(right, prediction.trial.name, "ramp")
    residual = prediction.observed[here] - prediction.mean[here]
    assert ramp.rmse == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert ramp.bias == pytest.approx(residual.mean())
    inside = (prediction.low <= prediction.observed) & (prediction.observed <= prediction.high)
    assert ramp.coverage90 == inside[here].mean()
    for trial in experiment().trials:
        ramp = cell(right, trial.name, "ramp")
        assert (ramp.role, ramp.rate) == (trial.role, trial.rate)


def test_drag_fails_the_fast_ramps_the_fastest_worst_and_not_the_slow_tests(dragged):
    failing = {(c.test, c.phase) for c in dragged.check.failing}
    assert {("B-30", "ramp"), ("B-100", "ramp")} <= failing
    assert not {name for name, _ in failing} & {"B-0.1", "B-1", "B-20"}
    assert not {phase for _, phase in failing} & {"unload", "recovery"}
    worst = max(dragged.check.cells, key=lambda c: c.rmse)
    assert (worst.test, worst.phase) == ("B-100", "ramp")
    assert worst.coverage90 < 0.3


def test_bias_is_the_drag(right, dragged):
    """Observed minus predicted: a force that the model lacks counts positive, and whole."""
    for trial in experiment().trials:
        if trial.role == "fit":
            continue
        for phase in {p.kind for p in trial.phases}:
            time = trial.test.time[trial.phase_of(trial.test.time) == phase]
            added = drag(trial, time).mean()
            before, after = cell(right, trial.name, phase), cell(dragged, trial.name, phase)
            assert after.bias - before.bias == pytest.approx(added, abs=1e-9)
    assert cell(dragged, "B-100", "ramp").bias > 0.05


@pytest.mark.parametrize("name", ["B-0.1", "B-100"])
@pytest.mark.few(1)
def test_a_prediction_is_the_forward_model_at_the_samples(name):
    """Against the hereditary integral on a grid of its own, a hundred times finer."""
    trial = next(t for t in experiment().trials if t.name == name)
    (prediction,) = predict(experiment(), Choices(), at_truth(), [trial])
    time = trial.test.time
    knots = trial.trajectory.knots
    inside = knots[(knots >= time[0]) & (knots <= time[-1])]
    fine = [np.linspace(a, b, 101) for a, b in pairwise(time)]
    grid = np.unique(np.concatenate([*fine, inside]))
    force = hereditary_force(
        Exponential(TRUTH.m, TRUTH.b),
        Prony(jnp.array(TRUTH.c), jnp.array(TRUTH.v)),
        jnp.asarray(grid),
        jnp.maximum(jnp.asarray(trial.trajectory.displacement(grid)), 0.0),
    )
    direct = np.maximum(np.interp(time, grid, np.asarray(force)), 0.0)
    np.testing.assert_array_equal(prediction.time, time)
    np.testing.assert_allclose(prediction.mean, direct, atol=2e-4 * direct.max())


def test_what_is_missed_is_in_the_band_and_not_in_the_test_of_a_cell_and_seeds_repeat():
    """A remainder of 0.1 N: the band is as wide in tests that were not fitted, the noise is not."""
    trials = experiment().trials[::3]
    missed = at_truth() | {"noise.remainder": np.full(4, 0.1)}
    before, after, again = (
        predict(experiment(), Choices(), c, trials) for c in (at_truth(), missed, at_truth())
    )
    other = predict(experiment(), Choices(), at_truth(), trials, seed=4)
    for one, two, same, drawn in zip(before, after, again, other, strict=True):
        np.testing.assert_array_equal(one.low, same.low)
        assert not np.array_equal(one.low, drawn.low)
        np.testing.assert_array_equal(one.mean, two.mean)
        np.testing.assert_array_equal(one.forces, two.forces)
        if one.trial.role == "validate":
            half = 0.5 * np.median((two.high - two.low)[two.phase == "ramp"])
            assert 0.3 < half / (1.645 * 0.1) < 1.2  # of 1.645 sds at most, half that at no force
    cells = [check("B", 0.01, p).cells for p in (before, after)]
    for one, two in zip(*cells, strict=True):
        assert one.rmse == two.rmse
        assert two.p_value == pytest.approx(one.p_value, abs=0.2)  # other draws of the floor


def test_long_phases_are_looked_at_in_part():
    """Ten times as many samples in a hold: at most 300 of each phase, its ends among them."""
    trial = experiment().with_role("fit")[0]
    own = trial.test
    time = np.linspace(own.time[0], own.time[-1], 5000)
    way, force = (np.interp(time, own.time, x) for x in (own.displacement, own.force))
    test = replace(own, time=time, displacement=way, force=force)
    (prediction,) = predict(experiment(), Choices(), at_truth(), [replace(trial, test=test)])
    for phase in ("hold", "recovery"):
        rows = prediction.time[prediction.phase == phase]
        there = time[trial.phase_of(time) == phase]
        assert rows.size <= 300
        assert rows[[0, -1]] == pytest.approx(there[[0, -1]])


# drawn residuals: a right model is accused as rarely as promised, a wrong one is found

WHITE, OU, TAU = 0.006, 0.008, 0.5
DRAWS, REPEATS, SAMPLES = 200, 1000, 50

TIMES = {
    "short ramp": np.arange(SAMPLES) * 1e-3,
    "slow ramp": np.linspace(0.0, 16.0, SAMPLES),
    "hold": 0.02 * np.expm1(np.linspace(0.0, np.log1p(30.0 / 0.02), SAMPLES)),
}


def noise(times, count, rng):
    lag = np.abs(times[:, None] - times)
    covariance = OU**2 * np.exp(-lag / TAU) + WHITE**2 * np.eye(times.size)
    return rng.standard_normal((count, times.size)) @ np.linalg.cholesky(covariance).T


def prediction(times, observed, rng, floor=None):
    """Predict zero force with a posterior sd of 2 mN in its level."""
    forces = 0.002 * rng.standard_normal((DRAWS, 1)) + np.zeros(times.size)
    floor = noise(times, DRAWS, rng) if floor is None else floor
    phase = np.full(times.size, "hold")
    trial = SimpleNamespace(name="test", role="validate", rate=20.0, phases=(), test=UNWEIGHTED)
    mean = forces.mean(axis=0)
    wide = np.full(times.size, 0.02)
    return Prediction(trial, times, phase, observed, mean, -wide, wide, forces, floor)


def p_value(given):
    (cell,) = check("pad", 0.01, [given]).cells
    return cell.p_value


@pytest.mark.parametrize("name", TIMES)
@pytest.mark.few(1)
def test_p_values_of_a_right_model_are_uniform_in_the_tail_and_five_sds_fail(name):
    rng = np.random.default_rng(11)
    times = TIMES[name]
    floor = noise(times, DRAWS, rng)
    seen = noise(times, REPEATS, rng) + 0.002 * rng.standard_normal((REPEATS, 1))
    found = np.array([p_value(prediction(times, force, rng, floor)) for force in seen])
    for level in (0.1, 0.01):
        # four binomial sds, and a quarter for the floor known from few draws only
        slack = 4.0 * np.sqrt(level * (1.0 - level) / REPEATS) + 0.25 * level
        assert abs(np.mean(found < level) - level) < slack
    off = prediction(times, seen[0] + 5.0 * np.hypot(WHITE, OU), rng)
    assert check("pad", 0.01, [off]).cells[0].fails


def test_an_error_of_nothing_but_rounding_does_not_divide_by_zero():
    times = TIMES["slow ramp"]
    nothing = np.zeros((DRAWS, times.size))
    trial = SimpleNamespace(name="test", role="fit", rate=20.0, phases=(), test=UNWEIGHTED)
    phase = np.full(times.size, "ramp")
    zero = np.zeros(times.size)
    given = Prediction(trial, times, phase, zero, zero, zero, zero, nothing, nothing)
    assert p_value(given) == 1.0


def test_cycles_are_told_one_by_one():
    rng = np.random.default_rng(13)
    times = np.linspace(0.0, 4.0, 401)[:-1]
    observed = np.where(times < 2.0, 0.0, 0.01)
    given = prediction(times, observed, rng)
    kinds = ("ramp", "unload", "ramp", "unload")
    phases = tuple(Phase(kind, float(k), k + 1.0) for k, kind in enumerate(kinds))
    given.trial.phases = phases
    given = replace(given, mean=np.zeros_like(times), phase=np.repeat(kinds, 100))
    found = {(c.phase, c.number): (c.n, c.bias) for c in check("pad", 0.01, [given]).cycles}
    assert found == {
        ("ramp", 1): (100, 0.0),
        ("ramp", 2): (100, pytest.approx(0.01)),
        ("unload", 1): (100, 0.0),
        ("unload", 2): (100, pytest.approx(0.01)),
    }
    once = replace(given, trial=SimpleNamespace(**vars(given.trial) | {"phases": phases[:2]}))
    assert not check("pad", 0.01, [once]).cycles
