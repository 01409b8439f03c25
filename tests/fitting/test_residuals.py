"""Failing cells: a right model is accused as rarely as promised, a wrong one is found."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.fitting.residuals import check
from qlvbayes.motion.phases import Phase

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
    trial = SimpleNamespace(name="test", role="validate", rate=20.0, phases=())
    mean = forces.mean(axis=0)
    wide = np.full(times.size, 0.02)
    return Prediction(trial, times, phase, observed, mean, -wide, wide, forces, floor)


def p_value(given):
    (cell,) = check("pad", 0.01, [given]).cells
    return cell.p_value


@pytest.mark.parametrize("name", TIMES)
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
    trial = SimpleNamespace(name="test", role="fit", rate=20.0, phases=())
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
