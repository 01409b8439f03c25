"""A channel that averages over the past: its average, its slopes, and pads recorded by one."""

import numpy as np
import pytest
from test_other_forms import diagnosed, named_in_form

from qlvbayes.diagnosis.forms.lag import _NODES, _WEIGHTS, SpreadLag, _factors
from qlvbayes.diagnosis.words import paragraphs
from qlvbayes.inference.gaussnewton import predict_along
from qlvbayes.synthetic import FORMS, PAPER_RATES

TIME = 0.008  # s


@pytest.fixture(scope="module")
def filtered():
    """An analogue filter of first order."""
    return diagnosed(FORMS["channel_low_pass"](time=TIME), rates=PAPER_RATES)


@pytest.fixture(scope="module")
def form(filtered):
    """Its form, and constants with a lag."""
    work = filtered.work
    subset = work.ensemble.subset(("channel_lag",))
    form = SpreadLag(work.experiment, work.ensemble, subset, "channel_lag")
    return form, work.path.last.point.constants


def test_at_one_its_delays_are_those_of_a_first_order_filter():
    """Moments 1 to 4 of an exponential density of mean 1: k!."""
    factors, _ = _factors(1.0)
    np.testing.assert_allclose(factors, _NODES)
    for k, moment in enumerate((1.0, 2.0, 6.0, 24.0), start=1):
        assert _WEIGHTS @ factors**k == pytest.approx(moment)


@pytest.mark.parametrize("a", [0.0, 0.5, 1.0])
def test_its_mean_delay_is_the_constant(a):
    assert _WEIGHTS @ _factors(a)[0] == pytest.approx(1.0)


@pytest.mark.slow
def test_without_spread_it_is_the_lists_law(form):
    form, constants = form
    still = np.zeros((1, constants.size))
    force, _ = form.combine(constants, still, np.zeros(1))
    expected, _ = predict_along(form.ensemble, constants, still)
    np.testing.assert_allclose(force, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_its_slopes_are_those_of_its_force(form):
    """Central differences along m, the delay and a; medians, as kinks pass samples."""
    form, constants = form
    spread = np.array([0.6])
    names = ("m", "channel_lag.delay")
    places = [form.ensemble.names.index(name) for name in names]
    directions = np.zeros((2, constants.size))
    directions[[0, 1], places] = constants[places]
    _, slopes = form.combine(constants, directions, spread)
    still, step = np.zeros((1, constants.size)), 1e-5
    moves = [(directions[0], 0.0), (directions[1], 0.0), (still[0], 1.0)]
    for found, (direction, change) in zip(slopes, moves, strict=True):
        ahead, behind = (
            form.combine(constants + sign * direction, still, spread + sign * change)[0]
            for sign in (step, -step)
        )
        differences = (ahead - behind) / (2.0 * step)
        off = np.abs(found - differences)
        assert np.quantile(off, 0.9) < 1e-4 * np.abs(differences).max()


@pytest.mark.slow
def test_a_filtered_channel_is_named_a_lag(filtered):
    named_in_form(filtered, "channel_lag", SpreadLag)


@pytest.mark.slow
def test_its_time_and_its_order_are_those_of_the_truth(filtered):
    point = filtered.work.path.last.point
    sd = np.sqrt(point.covariance[-1, -1])
    assert abs(point.theta[-1] - 1.0) < 3.0 * sd + 0.1  # five nodes stand for all delays
    delay = filtered.stages[-1].parameters["channel_lag.delay"]
    assert delay.mean == pytest.approx(TIME, abs=3.0 * delay.sd + 0.05 * TIME)


@pytest.mark.slow
def test_the_words_and_the_json_say_so(filtered):
    assert "averaged over the past" in paragraphs(filtered)[0]
    entries = filtered.as_dict()["steps"][-1]["other_form"]["over_delay"]
    delays, weights = np.transpose([[e["delay_s"], e["weight"]] for e in entries])
    assert weights.sum() == pytest.approx(1.0)
    assert np.all(delays >= 0.0)
