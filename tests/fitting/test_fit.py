"""Fits of pad B: what the data say, what the user says, and the paper's own routes."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.endtoend import CONSTANTS, SHORT, TRUTH, experiment, fitted, study, true_value

from qlvbayes.fitting.fit import fit_pad
from qlvbayes.fitting.least_squares import least_squares, part_notice
from qlvbayes.fitting.optimum import find_start, predictor_of
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad
from qlvbayes.io.data import Test as Measured
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.phases import Phase


def _least_squares(prior):
    e = experiment()
    predictor = predictor_of(e, Choices(priors=(prior,)), e.with_role("fit"))
    scale = np.ones(predictor.record.blocks.force.shape)
    return least_squares(predictor, scale, np.random.default_rng(0))


def test_draws_beyond_all_numbers_are_passed_over_and_priors_of_no_finite_force_refused():
    """exp(b d) overflows for some of these draws, its square for more."""
    found = _least_squares("b=lognormal(4,1.5)")
    assert found.costs[0] == pytest.approx(_least_squares("b=lognormal(0,1)").costs[0], rel=1e-4)
    with pytest.raises(InputError, match="narrow the priors"):
        _least_squares("b=lognormal(9,0.1)")
    with pytest.raises(InputError, match="narrow the priors"):
        fitted(Choices(priors=("b=lognormal(9,0.1)",)))
    with pytest.raises(InputError, match="no method 'guess'"):
        fit_pad(experiment(), Choices(), method="guess")


def test_draws_obey_the_model_and_the_constants_that_made_the_data_are_found():
    found = fitted()
    constants = dict(zip(found.names, np.moveaxis(found.every, -1, 0), strict=True))
    total = constants["c[0]"] + constants["c[1]"] + constants["c[2]"]
    np.testing.assert_allclose(total, 1.0, atol=1e-12)
    assert np.all(constants["v[1]"] > constants["v[2]"])
    assert np.all(constants.pop("noise.remainder") >= 0.0)  # nothing may be missed
    assert all(np.all(values > 0.0) for values in constants.values())
    summary = fitted().summary()
    assert summary.converged
    for name in CONSTANTS:
        assert abs(summary[name].mean - true_value(name)) < 4.0 * summary[name].sd, name


def test_the_noise_is_the_measured_floor_and_nothing_is_missed():
    summary, floor = fitted().summary(), experiment().floor.expected()
    for name in ("white", "ou", "tau"):
        assert summary[f"noise.{name}"].fixed
        assert summary[f"noise.{name}"].mean == getattr(floor, name)
    factors = [one.total / floor.total for one in experiment().floor.draws(5)]
    low, high = summary["noise.factor"].hdi90
    assert min(factors) <= low < high <= max(factors)  # no swelling beyond what the rests allow
    remainder = summary["noise.remainder"]
    assert remainder.hdi90[0] == 0.0
    assert remainder.median < 0.5 * floor.total


def test_kept_draws_stand_for_the_chain():
    found = fitted()
    assert 1000 <= found.constants[..., 0].size <= 2000
    sd = found.every.std(axis=(0, 1))
    shift = found.constants.mean(axis=(0, 1)) - found.every.mean(axis=(0, 1))
    varies = sd > 1e-9 * np.abs(found.every[0, 0])  # the measured noise does not
    assert varies.sum() == len(CONSTANTS) + 2
    assert np.all(np.abs(shift)[varies] < 0.1 * sd[varies])


def test_the_chain_starts_from_a_normal_that_agrees_with_it():
    found = fitted()
    normal = find_start(experiment(), Choices(), experiment().with_role("fit")).normal
    theta = found.theta.reshape(-1, normal.mean.size)
    sd = theta.std(axis=0)
    assert theta.shape[1] == len(CONSTANTS) - 1  # the noise is not sampled
    assert np.all(np.abs(normal.mean - theta.mean(axis=0)) < 0.35 * sd)
    ratio = np.sqrt(np.diag(normal.covariance)) / sd
    assert np.all((ratio > 0.7) & (ratio < 1.4))
    (highest,) = found.posterior.log_density(normal.mean[None])
    assert highest > np.max(found.posterior.log_density(theta)) - 0.05


def test_too_few_steps_do_not_converge_and_say_why():
    summary = fitted(settings=SHORT).summary()
    assert not summary.converged
    assert any("autocorrelation times" in t or "effective" in t for t in summary.troubles)


@pytest.mark.slow
def test_fixed_constants_are_exactly_that():
    values = {"v[2]": 0.14, "m": 0.34, "c[0]": 0.3, "noise.white": 0.006, "noise.remainder": 0.001}
    choices = Choices(fixed=tuple(f"{name}={value}" for name, value in values.items()))
    summary = fitted(choices, settings=SHORT).summary()
    for name, value in values.items():
        constant = summary[name]
        assert (constant.mean, constant.sd, constant.median) == (value, 0.0, value)
        assert constant.hdi90 == (value, value)
        assert constant.r_hat is None
        assert constant.fixed
    assert not summary["v[1]"].fixed


def test_a_narrow_prior_wins_over_the_data():
    choices = Choices(priors=("b=lognormal(0.2,0.0001)",))
    constant = fitted(choices, settings=SHORT).summary()["b"]
    assert constant.mean == pytest.approx(np.exp(0.2), rel=1e-3)


@pytest.mark.parametrize("method", ["least-squares", "two-step"])
def test_least_squares_finds_the_constants_and_two_steps_underestimate_the_force(method):
    """Eq. 9 on ramp and hold: the model's curve to 2 %, as correlated noise allows."""
    found = fitted(method=method)
    summary = found.summary()
    assert (summary.sampler, summary.converged) == (method, True)
    assert found.names[-1] == "noise.white"
    assert summary["noise.white"].fixed
    assert all(summary[name].r_hat is None for name in found.names)
    assert all(summary[name].sd > 0.0 for name in CONSTANTS)
    m, b, *c, fast, slow = (summary[name].mean for name in CONSTANTS)
    if method == "two-step":
        elastic, exact = (m / b * np.expm1(b * 1.6) for m, b in ((m, b), (TRUTH.m, TRUTH.b)))
        assert 0.75 < elastic / exact < 0.97
        return
    assert m == pytest.approx(TRUTH.m, rel=0.05)
    assert b == pytest.approx(TRUTH.b, rel=0.05)
    times = np.geomspace(0.01, 30.0, 20)
    curve, true = (
        shares[0] + np.exp(-np.outer(times, rates)) @ shares[1:]
        for shares, rates in ((np.array(c), (fast, slow)), (np.array(TRUTH.c), TRUTH.v))
    )
    np.testing.assert_allclose(curve, true, atol=0.02)


@pytest.mark.parametrize(("end", "little"), [(60.0, False), (130.0, True)])
def test_least_squares_says_that_it_uses_a_small_part_of_a_test(end, little):
    phases = (Phase("hold", 0.0, 3.0), Phase("ramp", 3.0, 4.0), Phase("hold", 4.0, 40.0))
    back = (*phases, Phase("unload", 40.0, 41.0), Phase("recovery", 41.0, end))
    (fast,) = experiment().with_role("fit")
    for cut, noticed in ((phases, False), (back, little)):
        some = replace(experiment(), trials=(replace(fast, phases=cut),))
        notices = part_notice(some, "least-squares")
        assert bool(notices) == noticed
        assert all(f"3 to 40 s of test {fast.name}, which ends at 130 s" in one for one in notices)


@pytest.mark.slow
def test_white_noise_in_the_likelihood_makes_sds_too_small():
    """Noise is correlated over 0.5 s: who takes it for white believes too much."""
    white, honest = fitted(Choices(noise="white")).summary(), fitted().summary()
    assert white.converged
    assert white["c[0]"].sd < 0.7 * honest["c[0]"].sd
    assert abs(white["c[0]"].mean - honest["c[0]"].mean) < 5.0 * honest["c[0]"].sd


@pytest.mark.slow
def test_fitted_tests_are_those_whose_role_says_so():
    assert [trial.name for trial in fitted().trials] == ["B-20"]
    pad, roles = study().pad("B"), ["fit", "validate", "fit", None, None, None]
    tests = tuple(replace(t, role=r) for t, r in zip(pad.tests, roles, strict=True))
    found = fit_pad(prepare(replace(pad, tests=tests)), Choices(), method="least-squares")
    assert [trial.name for trial in found.trials] == ["B-0.1", "B-10"]


def test_a_bonded_specimen_may_pull():
    """On unloading the loose pad's force ends at zero; the glued one's goes on below."""
    values = [0.34, 1.165, 0.001, 0.9245, 0.0745, 6.215, 0.14, 0.006, 0.008, 0.5, 1.0, 0.0]
    lowest = {}
    for bonded in (False, True):
        trials = experiment().with_role("fit")
        predictor = predictor_of(experiment(), Choices(bonded=bonded), trials)
        lowest[bonded] = float(np.min(predictor.forces(np.array([values]))))
    assert lowest[False] == 0.0
    assert lowest[True] < -0.1


def test_nothing_is_compiled():
    jax.clear_caches()  # what was compiled before would not be compiled again
    compiled = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, seconds, **_: compiled.append(event) if "compile" in event else None
    )
    pad = study().pad("B")
    some = replace(pad, tests=tuple(test for test in pad.tests if test.name == "B-20"))
    fit_pad(prepare(some), Choices(), settings=SHORT)
    assert compiled == []
    jax.jit(lambda x: x + 1.0)(np.ones(2))
    assert compiled != []  # what is counted is counted


# the error of a measured contact is part of the intervals of least squares

SD = 0.04  # mm
TIME = np.arange(0.0, 6.0, 0.01)
DEPTH = np.minimum(2.0 * TIME, 1.5)


def force_of_a_sphere():
    """Force of 0.9 d^1.5 with one relaxation time of 0.5 s, and a noise of 2 mN."""
    steps, part = np.diff(0.9 * DEPTH**1.5, prepend=0.0), np.zeros_like(TIME)
    for k in range(1, TIME.size):
        part[k] = np.exp(-0.02) * part[k - 1] + np.exp(-0.01) * steps[k]
    noise = np.random.default_rng(0).normal(0.0, 0.002, TIME.size)
    return 0.6 * np.cumsum(steps) + 0.4 * part + noise


def of_sphere(off=0.0, **more):
    test = Measured("t", "P", TIME, DEPTH + off * (DEPTH > 0), force_of_a_sphere(), **more)
    choices = Choices(modes=1, elastic="hertz")
    return fit_pad(prepare(Pad("P", (test,), PAD)), choices, method="least-squares").summary()


def test_an_interval_is_as_wide_as_refits_with_another_contact_say():
    exact, further, nearer = of_sphere(), of_sphere(SD), of_sphere(-SD)
    for stage in ("", "12.4"):
        found = of_sphere(contact_sd=SD, contact_stage=stage)
        for name in ("m", "n"):
            moved = 0.5 * (further[name].mean - nearer[name].mean)
            expected = np.hypot(moved, exact[name].sd)
            assert found[name].sd == pytest.approx(expected, rel=0.2), name
            assert found[name].sd > 5.0 * exact[name].sd
        assert any("contact point is uncertain" in text for text in found.notices)
