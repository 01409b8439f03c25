"""Relaxations: the spectrum that each hands over is its law, over twelve decades of time."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import exp1

from qlvbayes.inference.forward.fixedrates import FixedRates
from qlvbayes.laws.catalogue import LAWS
from qlvbayes.laws.conformance import LawError, check_law
from qlvbayes.laws.relaxation.continuous import (
    Fung,
    LogNormalSpectrum,
    PowerLaw,
    StretchedExponential,
)
from qlvbayes.laws.relaxation.law import MOST_TERMS
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales

ERROR = 1e-6  # of g(0)
TIME = np.concatenate([[0.0], np.geomspace(1e-6, 1e6, 400)])  # s


def fung(c, first, last, t=TIME):
    with np.errstate(invalid="ignore"):
        inside = np.where(t > 0.0, exp1(t / last) - exp1(t / first), np.log(last / first))
    return (1.0 + c * inside) / (1.0 + c * np.log(last / first))


def log_normal(c0, tau, sigma, t=TIME):
    z = np.linspace(-7.5, 7.5, 6001)
    normal = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    decays = np.exp(-t[:, None] / tau * np.exp(-sigma * z))
    return c0 + (1.0 - c0) * np.trapezoid(decays * normal, z, axis=1)


@pytest.mark.parametrize(
    ("decades", "nodes", "c"), [(3, 14, 0.02), (4, 18, 5.0), (6, 26, 0.3), (8, 34, 5.0)]
)
def test_the_box_spectrum_is_fungs_function(decades, nodes, c):
    """Four nodes a decade and two more, against exponential integrals."""
    first = 10.0 ** (-0.5 * decades)
    for ends in ((first, 1.0 / first), (1.0 / first, first)):  # in any order
        curve = Fung(c, *ends, nodes).curve(jnp.asarray(TIME))
        assert np.max(np.abs(curve - fung(c, first, 1.0 / first))) < ERROR


@pytest.mark.parametrize(
    ("alpha", "error"),
    [*((a, ERROR) for a in (0.02, 0.1, 0.3, 0.5, 1.0)), (2.0, 3e-5), (3.0, 2e-4)],
)
def test_the_gamma_spectrum_is_the_power_law(alpha, error):
    law = PowerLaw(0.2, alpha, 1.0)
    exact = 0.2 + 0.8 * (1.0 + TIME) ** -alpha
    assert np.max(np.abs(law.curve(jnp.asarray(TIME)) - exact)) < error


@pytest.mark.parametrize("beta", [0.15, 0.3, 0.5, 0.7, 0.9, 0.95])
def test_the_stable_spectrum_is_the_stretched_exponential(beta):
    time = np.concatenate([[0.0], np.geomspace(1e-9, 1e4, 400)])
    law = StretchedExponential(0.2, beta, 1.0)
    exact = 0.2 + 0.8 * np.exp(-(time**beta))
    assert np.max(np.abs(law.curve(jnp.asarray(time)) - exact)) < ERROR


@pytest.mark.parametrize("sigma", [0.0, 0.1, 1.0, 2.0, 3.0])
def test_the_normal_spectrum_is_its_integral(sigma):
    law = LogNormalSpectrum(0.2, 2.0, sigma)
    assert np.max(np.abs(law.curve(jnp.asarray(TIME)) - log_normal(0.2, 2.0, sigma))) < ERROR


EXACT = [
    (Fung, (0.2, 0.01, 10.0), fung),
    (PowerLaw, (0.2, 0.3, 0.7), lambda c, a, tau, t: c + (1.0 - c) * (1.0 + t / tau) ** -a),
    (
        StretchedExponential,
        (0.2, 0.4, 0.7),
        lambda c, b, tau, t: c + (1.0 - c) * np.exp(-((t / tau) ** b)),
    ),
    (LogNormalSpectrum, (0.2, 0.7, 1.5), log_normal),
]


@pytest.mark.parametrize(
    ("kind", "constants", "exact"), EXACT, ids=[kind.name for kind, *_ in EXACT]
)
@pytest.mark.few(1)
def test_slopes_are_those_of_the_law(kind, constants, exact):
    """Slopes of the spectrum's curve against central differences of the closed form."""
    time = np.geomspace(1e-3, 1e3, 40)
    found = jax.jacfwd(lambda x: kind(*x).curve(jnp.asarray(time)))(jnp.asarray(constants))
    for k, value in enumerate(constants):
        step = 1e-4 * value
        more, less = (
            exact(*constants[:k], value + x, *constants[k + 1 :], time) for x in (step, -step)
        )
        slope = (more - less) / (2.0 * step)
        np.testing.assert_allclose(found[:, k] * value, slope * value, atol=2e-5)


@pytest.mark.parametrize("kind", LAWS.relaxation, ids=lambda kind: kind.name)
@pytest.mark.few(1)
def test_every_relaxation_keeps_the_rules(kind):
    check_law(kind)
    check_law(kind, Scales(100.0, 5.0, 0.2, 2000.0, 1.0, 1.0, 1.0))


def test_prony_hands_over_its_own_constants_and_too_many_terms_break_a_rule():
    class Long(PowerLaw):
        name = "long"

        def spectrum(self):
            rates = jnp.geomspace(1e-3, 1e3, MOST_TERMS + 1)
            return jnp.full(MOST_TERMS + 2, 1.0 / (MOST_TERMS + 2)), rates

    with pytest.raises(LawError, match="61 rates, more than 60"):
        check_law(Long)
    law = Prony(jnp.array([0.3, 0.7]), jnp.array([2.0]))
    assert law.spectrum()[0] is law.c
    assert law.spectrum()[1] is law.v
    assert law.times() == {"1/v[1]": 0.5}


SHORTEST, LONGEST = 1e-3, 60.0  # s


@pytest.fixture(scope="module")
def fixed():
    dense = np.geomspace(SHORTEST, LONGEST, 400)
    time = np.concatenate([np.arange(0.0, 0.05, SHORTEST), dense[dense > 0.06]])
    return FixedRates.over(time[None])


@pytest.mark.parametrize(
    "law",
    [Fung(0.8, 0.01, 30.0), LogNormalSpectrum(0.3, 1.0, 2.0), PowerLaw(0.1, 0.4, 0.5)],
    ids=lambda law: law.name,
)
def test_few_modes_relax_as_many_do(fixed, law):
    fractions, rates = (np.asarray(x)[None] for x in law.spectrum())
    few = fixed.fractions(fractions, rates)[0]
    assert fixed.rates.size < rates.size
    time = np.append(0.0, np.geomspace(SHORTEST, LONGEST, 500))
    whole = fractions[0, 0] + fractions[0, 1:] @ np.exp(-np.outer(rates[0], time))
    reduced = few[0] + few[1:] @ np.exp(-np.outer(fixed.rates, time))
    np.testing.assert_allclose(reduced, whole, atol=5e-5)
    assert few.sum() == pytest.approx(1.0, abs=1e-5)  # the step of a sudden start


def test_records_of_like_times_share_their_rates(fixed):
    alike = FixedRates.over(np.linspace(0.0, 1.05 * LONGEST, 60_000)[None])
    np.testing.assert_array_equal(alike.rates, fixed.rates)
