"""Effects too small to matter: the closed form against quadrature, and what it is for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from qlvbayes.inference.amplitude_prior import log_noticeable
from qlvbayes.laws.scales import SHARE
from qlvbayes.priors import HalfNormal, Normal

SD = 0.03
LEAST = 0.01 / SHARE * SD  # the amplitude that contributes 1 % of the peak force


def bracket(a):
    return -np.expm1(-0.5 * (a / LEAST) ** 2)


def mean_of_bracket(density, low):
    ends = (max(low, -2.0), 2.0)
    points = np.array([-1e-2, -1e-3, 0.0, 1e-3, 1e-2, 0.1])
    weight, above = (
        quad(f, *ends, points=points[points > low], limit=500)[0]
        for f in (density, lambda a: density(a) * bracket(a))
    )
    return above / weight


@pytest.mark.parametrize("prior", [HalfNormal(SD), Normal(0.0, SD)])
@pytest.mark.parametrize(
    ("mean", "sd"),
    [(-0.004, 0.004), (0.0, 0.0005), (0.0, 0.03), (0.003, 0.004), (0.02, 0.0005), (0.1, 0.03)],
)
@pytest.mark.few(6)
def test_the_closed_form_is_the_ratio_of_two_integrals(prior, mean, sd):
    low = 0.0 if isinstance(prior, HalfNormal) else -2.0
    after = mean_of_bracket(norm(mean, sd).pdf, low)
    before = mean_of_bracket(norm(0.0, SD).pdf, low)
    assert log_noticeable(prior, mean, sd) == pytest.approx(np.log(after / before), abs=2e-6)


@given(
    mean=st.floats(-0.2, 0.2),
    sd=st.floats(0.0, 0.2),
    prior=st.sampled_from([HalfNormal(SD), Normal(0.0, SD)]),
)
def test_the_change_is_bounded_above(mean, sd, prior):
    change = log_noticeable(prior, mean, sd)
    assert np.isfinite(change)
    assert change <= -np.log1p(-1.0 / np.hypot(1.0, SD / LEAST)) + 1e-12


def test_only_what_rules_out_a_noticeable_effect_speaks_against_it():
    prior = HalfNormal(SD)
    assert log_noticeable(prior, 0.0, 0.05 * LEAST) < -6.0  # the tests leave room for nothing else
    assert abs(log_noticeable(prior, 0.0, SD)) < 1e-12  # the tests say nothing
    assert 0.0 < log_noticeable(prior, 3.0 * LEAST, 0.1 * LEAST) < 0.25  # clearly there
