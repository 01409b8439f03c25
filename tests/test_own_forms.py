"""Changes that an effect is known for: leaks and drifts that level off, friction under pressure."""

from dataclasses import replace

import numpy as np
import pytest
from test_other_forms import ALARMS, diagnosed, named_in_form

from qlvbayes.cli.diagnosis_tables import ranking_table
from qlvbayes.diagnosis.forms.otherform import OtherForm
from qlvbayes.diagnosis.forms.ownforms import LevellingOff, StiffeningFrame, WithForce
from qlvbayes.diagnosis.forms.search import other_forms
from qlvbayes.diagnosis.search import Path
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.words import paragraphs
from qlvbayes.plots.evidence import plot_evidence
from qlvbayes.report.boxes import verdict_line
from qlvbayes.synthetic import FORMS, PAPER_RATES

pytestmark = pytest.mark.slow  # whole diagnoses

CLOCK = np.linspace(0.0, 1.0, 400)


@pytest.fixture(scope="module")
def leak():
    """A leak that comes to rest after two of the six tests."""
    return diagnosed(FORMS["saturating_leak"](share=0.07, time=140.0), rates=PAPER_RATES)


@pytest.fixture(scope="module")
def coulomb():
    """Friction in proportion to the pressing force."""
    return diagnosed(FORMS["coulomb_friction"](mu=0.12, reach=0.03))


@pytest.fixture(scope="module")
def frame():
    """A frame of which every newton more takes less."""
    bending = FORMS["bending_frame"](compliance=0.5, force=0.3)
    return diagnosed(bending, rates=PAPER_RATES, pad="C")


def with_sum(diagnosis, kind, target):
    """A form whose contribution over the clock is the target's, by least squares, and its error."""
    work = diagnosis.work
    step = work.path.last
    form = kind(work.experiment, work.ensemble, step.point.subset, "fluid_leak")
    curves = CLOCK * form.curves(CLOCK, CLOCK)
    coefficients, *_ = np.linalg.lstsq(curves.T, target - CLOCK)
    theta, _ = form.split(step.point.theta)
    point = replace(step.point, theta=np.append(theta, coefficients))
    return form, point, np.abs(CLOCK + coefficients @ curves - target).max()


def test_a_leak_that_levels_off_is_named(leak):
    assert leak.verdict == "missing_effect"
    assert leak.effects == ("fluid_leak",)
    last = leak.stages[-1]
    assert last.p_value > 0.003
    assert leak.stages[0].p_value < ALARMS
    assert last.rmse < 1.2 * leak.noise


def test_its_form_is_that_of_the_truth(leak):
    """Share lost over clock t: rate t f(t) against share (1 - e^(-t/time))."""
    last = leak.stages[-1]
    rate = last.parameters["fluid_leak.rate"].mean
    clock, factor = np.transpose(last.shape.over_clock)
    lost = rate * clock[1:] * factor[1:]
    truth = 0.07 * -np.expm1(-clock[1:] / 140.0)
    np.testing.assert_allclose(lost, truth, atol=0.01)


@pytest.mark.parametrize("time", [0.05, 0.1, 0.2, 0.4])
def test_what_levels_off_is_typical_whatever_its_time(leak, time):
    target = -np.expm1(-CLOCK / time)
    form, point, error = with_sum(leak, LevellingOff, target)
    assert error < 0.01
    assert form.is_typical(point)


@pytest.mark.parametrize(
    "target",
    [
        pytest.param(1.0 / (1.0 + np.exp((0.5 - CLOCK) / 0.05)), id="begins in the middle"),
        pytest.param(np.sin(4.0 * CLOCK), id="turns back"),
        pytest.param(CLOCK**3, id="quickens"),
    ],
)
def test_what_does_otherwise_is_not(leak, target):
    form, point, _ = with_sum(leak, LevellingOff, target)
    assert not form.is_typical(point)


def test_left_out_tests_confirm_what_does_not_change_with_the_clock(leak, coulomb, monkeypatch):
    """A leak that levels off is not known in a test left out; friction under pressure is."""
    monkeypatch.setattr("qlvbayes.diagnosis.forms.search.confirms", lambda step, before: False)
    found = []
    for diagnosis in (leak, coulomb):
        work = diagnosis.work
        path = Path(work.path.steps[:1], work.path.rounds[:1])
        step, _ = other_forms(work.experiment, work.ensemble, work.samples, path, False, Settings())
        found.append(step and type(step.form))
    assert found[0] is LevellingOff
    assert found[1] in (None, OtherForm)


def test_friction_under_pressure_is_named(coulomb):
    assert coulomb.verdict == "missing_effect"
    assert coulomb.effects == ("friction",)
    form = coulomb.work.path.last.form
    assert isinstance(form, WithForce)
    _, factor = np.transpose(coulomb.stages[-1].shape.over_force)
    assert np.all(np.diff(factor) > 0.0)
    assert abs(factor[0]) < 0.15 * factor[-1]
    assert "at no force" in paragraphs(coulomb)[0]


def test_its_slope_over_force_is_the_coefficient(coulomb):
    """Factor times strength is mu F, mu known no better than the strength."""
    last = coulomb.stages[-1]
    strength = last.parameters["friction.strength"]
    force, factor = np.transpose(last.shape.over_force)
    slope = np.polyfit(force, strength.mean * factor, 1)[0]
    assert abs(slope - 0.12) < 3.0 * slope * strength.sd / strength.mean


def test_a_factor_that_falls_with_force_is_not_typical(coulomb):
    step = coulomb.work.path.last
    theta, coefficients = step.form.split(step.point.theta)
    assert step.form.is_typical(step.point)
    falling = replace(step.point, theta=np.append(theta, [-1.0, *np.zeros(coefficients.size - 1)]))
    assert not step.form.is_typical(falling)


def test_a_frame_that_stiffens_is_named_though_the_constants_hide_it(frame):
    listed = {ranked.effect: ranked.log_bayes_factor for ranked in frame.ranking}
    assert listed["frame_compliance"] < 3.0
    named_in_form(frame, "frame_compliance", StiffeningFrame)
    assert "at no force" in paragraphs(frame)[0]


def test_its_factor_falls_with_the_force(frame):
    _, factor = np.transpose(frame.stages[-1].shape.over_force)
    assert np.all(np.diff(factor) < 0.0)
    assert factor[-1] > 0.0


def test_a_frame_that_softens_is_not_typical(frame):
    step = frame.work.path.last
    theta, coefficients = step.form.split(step.point.theta)
    assert step.form.is_typical(step.point)
    for first in (0.5, -1.1):  # grows with the force; below 0 at the peak
        values = [first, *np.zeros(coefficients.size - 1)]
        assert not step.form.is_typical(replace(step.point, theta=np.append(theta, values)))


def test_the_form_stands_above_the_lists_laws(frame):
    """In the figure and on the terminal: with its Bayes factor, without a probability."""
    axis = plot_evidence(frame)
    assert axis.get_yticklabels()[0].get_text() == "frame_compliance\n(other form)"
    assert axis.patches[0].get_width() == pytest.approx(frame.own_form.log_bayes_factor)
    labels = [tick.get_text() for tick in axis.get_yticklabels() if tick.get_fontweight() == "bold"]
    assert labels == ["frame_compliance\n(other form)"]
    columns = ranking_table(frame, "N").columns
    first, probability = (next(iter(column.cells)) for column in columns[:2])
    assert (first, probability) == ("frame_compliance (other form)", "")


def test_the_report_says_that_the_law_is_another(frame):
    said = verdict_line(frame.as_dict())
    assert said == "The plain model lacks one effect, not by its usual law:"
