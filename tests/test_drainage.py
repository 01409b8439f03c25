"""Pressure that drains by a power of itself: its law, its slopes, and pads that do so."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_other_forms import diagnosed, named_in_form

from qlvbayes.diagnosis.forms.drainage import PowerDrainage, drained_pressure
from qlvbayes.diagnosis.words import paragraphs
from qlvbayes.inference.gaussnewton import climb, predict_along
from qlvbayes.motion import Motion
from qlvbayes.synthetic import FORMS, PAPER_RATES

REFERENCE = 0.1  # N
TIME = np.concatenate([np.linspace(0.0, 1.5, 61), np.geomspace(1.52, 4.0, 60)])
DEPTH = np.interp(TIME, [0.0, 1.0, 1.5], [0.0, 1.0, 0.4])


@pytest.fixture(scope="module")
def quadratic():
    """Pressure that drains with its square, beside the paper's pad."""
    return diagnosed(FORMS["quadratic_pressure"](k=0.06, drain=15.0), rates=PAPER_RATES)


@pytest.fixture(scope="module")
def form(quadratic):
    """Its form, and the best point of the list's law from the same start."""
    work = quadratic.work
    subset = work.ensemble.subset(("fluid_pressure",))
    theta, _ = work.path.last.form.split(work.path.last.point.theta)
    listed = climb(work.ensemble, subset, theta)
    return PowerDrainage(work.experiment, work.ensemble, subset, "fluid_pressure"), listed


def along_ramp_and_hold(k, tau, a, n):
    still = np.zeros_like(TIME)
    motion = Motion(*map(jnp.asarray, (TIME, DEPTH, still, still)))
    return np.asarray(drained_pressure(motion, jnp.array([k, tau, a, n]), REFERENCE))


@pytest.mark.parametrize("n", [-0.5, 0.0, 1.0, 1.5])
@pytest.mark.parametrize("a", [0.0, 1.2])
def test_the_pressure_solves_its_equation(n, a):
    k, tau = 0.5, 0.3

    def slope(t, p):
        depth = np.interp(t, TIME, DEPTH)
        speed = np.interp(t, [0.0, 1.0, 1.0, 1.5, 1.5, 4.0], [1.0, 1.0, -1.2, -1.2, 0.0, 0.0])
        drained = np.sign(p) * REFERENCE * np.abs(p / REFERENCE) ** (1.0 + n)
        return k * speed - drained * np.exp(-a * depth) / tau

    span = (0.0, TIME[-1])
    solved = solve_ivp(slope, span, [0.0], "LSODA", TIME, rtol=1e-9, atol=1e-9, max_step=0.05)
    found = along_ramp_and_hold(k, tau, a, n)
    assert np.abs(found - solved.y[0]).max() < 1e-3 * np.abs(found).max()


@pytest.mark.slow
def test_without_a_power_it_is_the_lists_law(form):
    form, listed = form
    still = np.zeros((1, listed.constants.size))
    force, _ = form.combine(listed.constants, still, np.zeros(1))
    expected, _ = predict_along(form.ensemble, listed.constants, still)
    np.testing.assert_array_equal(force, expected)


@pytest.mark.slow
def test_its_slopes_are_those_of_its_force(form):
    """Central differences along k, tau, a and n, away from where contact is lost."""
    form, listed = form
    power = np.array([0.6])
    directions = np.zeros((3, listed.constants.size))
    for row, field in enumerate(("k", "tau", "a")):
        place = form.ensemble.names.index(f"fluid_pressure.{field}")
        directions[row, place] = listed.constants[place]
    still = np.zeros_like(directions[:1])
    force, slopes = form.combine(listed.constants, directions, power)
    step = 1e-5

    def at(direction, change):
        return form.combine(listed.constants + direction, still, power + change)[0]

    for found, direction, change in zip(
        slopes, [*directions, still[0]], [0.0, 0.0, 0.0, 1.0], strict=True
    ):
        ahead, behind = at(step * direction, step * change), at(-step * direction, -step * change)
        held = (force > 0.0) & (ahead > 0.0) & (behind > 0.0)
        differences = (ahead - behind)[held] / (2.0 * step)
        np.testing.assert_allclose(
            found[held], differences, atol=1e-4 * np.abs(differences).max(), rtol=1e-3
        )


@pytest.mark.slow
def test_pressure_that_drains_with_its_square_is_named(quadratic):
    named_in_form(quadratic, "fluid_pressure", PowerDrainage)


@pytest.mark.slow
def test_its_power_is_that_of_the_truth(quadratic):
    """n = 1, within three standard deviations; k too."""
    point = quadratic.work.path.last.point
    sd = np.sqrt(point.covariance[-1, -1])
    assert abs(point.theta[-1] - 1.0) < 3.0 * sd
    assert sd < 0.5
    stiffness = quadratic.stages[-1].parameters["fluid_pressure.k"]
    assert abs(stiffness.mean - 0.06) < 3.0 * stiffness.sd


@pytest.mark.slow
def test_the_words_and_the_json_say_how_it_drains(quadratic):
    text = paragraphs(quadratic)[0]
    assert "the rate at which the pressure drains must be taken times" in text
    assert "So changed its log Bayes factor" in text
    entries = quadratic.as_dict()["steps"][-1]["other_form"]["over_pressure"]
    pressure, factor = np.transpose([[e["pressure_N"], e["factor"]] for e in entries])
    assert np.all(np.diff(pressure) > 0.0)
    power = np.polyfit(np.log(pressure), np.log(factor), 1)[0]
    assert power == pytest.approx(quadratic.work.path.last.point.theta[-1])


@pytest.mark.slow
def test_sample_by_sample_it_predicts_what_it_fitted(quadratic):
    """Forces at the samples: the fitted model's residual is the noise."""
    assert quadratic.stages[-1].rmse < 1.2 * quadratic.noise


@pytest.mark.slow
def test_a_flow_that_falls_with_pressure_is_not_typical(quadratic):
    step = quadratic.work.path.last
    assert step.form.is_typical(step.point)
    theta, _ = step.form.split(step.point.theta)
    assert not step.form.is_typical(replace(step.point, theta=np.append(theta, -1.1)))
