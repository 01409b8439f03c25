"""Effects in another form than the list's law, and the rival that no list holds."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_pads import hidden_pad

from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.forms.otherform import OtherForm
from qlvbayes.diagnosis.forms.ownforms import GradualContact, LevellingOff, WithForce
from qlvbayes.diagnosis.forms.search import Found, other_forms, resembles
from qlvbayes.diagnosis.forms.turns import _forms, turns
from qlvbayes.diagnosis.freeoffsets import FreeOffsets
from qlvbayes.diagnosis.freespring import FreeSpring, KinkedSpring
from qlvbayes.diagnosis.search import Path, plain_fits
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.inference.gaussnewton import climb, evaluate
from qlvbayes.synthetic import (
    FORMS,
    HIDDEN,
    NOISES,
    OUTSIDE,
    PAPER_RATES,
    TABLE_1,
    Constants,
)

pytestmark = pytest.mark.slow  # whole diagnoses

RATES = (0.1, 1.0, 20.0, 100.0)
ALARMS = Settings().false_alarms


def diagnosed(*effects, rates=RATES, pad="B") -> Diagnosis:
    return diagnose(hidden_pad(*effects, rates=rates, constants=TABLE_1[pad]))


@pytest.fixture(scope="module")
def levelling():
    """A drift that levels off within the study."""
    drift = FORMS["saturating_drift"](offset=0.15, time=400.0)
    return diagnosed(drift, rates=PAPER_RATES)


@pytest.fixture(scope="module")
def contact():
    """A second spring that is met at depth."""
    return diagnosed(OUTSIDE["second_contact"](stiffness=0.35, depth=0.9))


def named_in_form(diagnosis, effect, kind):
    """Alone, in a form of this kind, which leaves no structure and predicts left-out tests."""
    assert diagnosis.verdict == "missing_effect"
    assert diagnosis.effects == (effect,)
    assert isinstance(diagnosis.work.path.last.form, kind)
    first, last = diagnosis.stages[0], diagnosis.stages[-1]
    assert last.p_value > 0.003
    assert last.heldout_rmse < first.heldout_rmse


def form_of(diagnosis, effect="force_drift"):
    work = diagnosis.work
    return OtherForm(work.experiment, work.ensemble, work.path.last.point.subset, effect)


def test_a_drift_that_levels_off_is_named_with_its_form(levelling):
    assert levelling.verdict == "missing_effect"
    assert levelling.effects == ("force_drift",)
    last = levelling.stages[-1]
    assert last.shape is not None
    assert last.labels == ("force_drift (other form)",)
    assert last.p_value > 0.003
    assert levelling.stages[0].p_value < ALARMS
    noise = NOISES["correlated"]
    assert last.heldout_rmse < 1.2 * np.hypot(noise.white, noise.correlated)


def test_the_form_is_that_of_the_truth(levelling):
    """Drift over clock t: rate t f(t) against offset (1 - e^(-t/time)), in newtons."""
    rate = levelling.stages[-1].parameters["force_drift.rate"].mean
    clock, factor = np.transpose(levelling.stages[-1].shape.over_clock)
    truth = 0.15 * -np.expm1(-clock[1:] / 400.0)
    assert np.abs(rate * clock[1:] * factor[1:] - truth).max() < 3.0 * levelling.noise


def test_the_words_and_the_json_say_the_form(levelling):
    from qlvbayes import paragraphs

    assert "not by the list's law" in paragraphs(levelling)[0]
    steps = levelling.as_dict()["steps"]
    assert [step["other_form"] is None for step in steps] == [True] * (len(steps) - 1) + [False]
    factors = [entry["factor"] for entry in steps[-1]["other_form"]["over_clock"]]
    assert factors[0] > factors[-1] > 0.0


def test_an_effect_that_only_carries_the_factor_is_not_named(levelling):
    """The same model, had the list's form explained next to nothing."""
    work, settings = levelling.work, Settings()
    step, form = work.path.last, form_of(levelling)
    theta, _ = form.split(step.point.theta)
    with_it = evaluate(work.ensemble, step.point.subset, theta)
    listed = climb(work.ensemble, with_it.subset, theta)
    found = Found(form, step.effects, listed, form.fit(listed), work.adequacies[-1])
    assert resembles(found, settings)
    plain = work.path.steps[0].point
    faint = plain.theta.copy()
    drift = work.ensemble.names.index("force_drift.rate")
    constants = plain.constants.copy()
    constants[drift] = 1e-3 * listed.constants[drift]
    own = list(work.ensemble.fields("force_drift")[0].theta)
    faint[own] = work.ensemble.posterior.unconstrain(constants)[own]
    idle = evaluate(work.ensemble, with_it.subset, faint)
    assert not resembles(replace(found, before=idle), settings)


def test_an_offset_has_no_other_form(levelling):
    """One that changes with the clock is a drift."""
    work = levelling.work
    effects = ("force_drift", "force_offset")
    tried = _forms(work.experiment, work.ensemble, effects, work.path.last.point)
    assert {form.effect for form, *_ in tried} == {"force_drift"}


def test_unconfirmed_contenders_are_weighed_side_by_side(levelling):
    """No step on the way: a drift levels off, whatever stands first in the first round."""
    work = levelling.work
    first = work.path.rounds[0]
    refitted = [c for c in first.contenders if c.point is not None]
    assert len(refitted) > 1
    for contenders in (refitted[:2], refitted[1::-1]):
        path = Path(work.path.steps[:1], [replace(first, contenders=tuple(contenders))])
        _, found = other_forms(
            work.experiment, work.ensemble, work.samples, path, False, Settings()
        )
        assert {one.form.effect for one in found} == {"force_drift"}


def test_without_coefficients_it_is_the_lists_own_form(levelling):
    form = form_of(levelling)
    theta, _ = form.split(levelling.work.path.last.point.theta)
    point = form._evaluate(np.append(theta, np.zeros(form.sds.size)), None)
    own = evaluate(form.ensemble, form.subset, theta)
    np.testing.assert_allclose(point.losses, own.losses, rtol=1e-10)
    count = own.gradient.size
    np.testing.assert_allclose(point.gradient[:count], own.gradient, rtol=1e-6, atol=1e-6)


UNLISTED = [FreeSpring, KinkedSpring, FreeOffsets]


@pytest.mark.parametrize("kind", [OtherForm, GradualContact, LevellingOff, WithForce, *UNLISTED])
def test_gradients_are_those_of_the_loss(levelling, kind):
    work = levelling.work
    if kind in UNLISTED:
        form = kind(work.experiment, work.ensemble, work.ensemble.subset())
        start = work.path.steps[0].point.theta
    else:
        form = kind(work.experiment, work.ensemble, form_of(levelling).subset, "force_drift")
        start, _ = form.split(work.path.last.point.theta)
    rng = np.random.default_rng(0)
    place = np.append(start, 0.3 * form.sds * rng.standard_normal(form.sds.size))
    point = form._evaluate(place, None)
    for k in [*range(3), *range(form.free.size - 3, form.free.size)]:
        step = np.zeros(place.size)
        step[form.free[k]] = 1e-5
        slope = form._evaluate(place + step, None).loss - form._evaluate(place - step, None).loss
        np.testing.assert_allclose(point.gradient[k], slope / 2e-5, rtol=1e-4, atol=1e-3)


def test_a_second_contact_is_not_taken_for_an_effect_of_the_list(contact):
    assert contact.verdict == "unexplained"
    assert contact.effects == ()


def test_the_free_spring_finds_the_second_contact(contact):
    work = contact.work
    spring = FreeSpring(work.experiment, work.ensemble, work.ensemble.subset())
    plain = plain_fits(work.ensemble)[0]
    point = spring.fit(plain)
    assert point.log_evidence > plain.log_evidence + 5.0
    _, coefficients = spring.split(point.theta)
    depth = np.linspace(0.0, 1.0, 33)
    force = work.experiment.scales.force * coefficients @ spring.curves(depth, depth)
    truth = 0.35 * np.maximum(depth * work.experiment.scales.depth - 0.9, 0.0)
    # up to a part that the pad's own law can take
    law = np.expm1(TABLE_1["B"].b * depth * work.experiment.scales.depth)
    basis = np.stack([law, depth * np.exp(law)], axis=1)
    left = [x - basis @ np.linalg.lstsq(basis, x, rcond=None)[0] for x in (force, truth)]
    assert np.corrcoef(*left)[0, 1] > 0.9


def test_a_listed_effect_beats_the_free_spring():
    found = diagnosed(HIDDEN["contact_offset"](gap=0.12))
    assert found.verdict == "missing_effect"
    assert found.effects == ("contact_offset",)
    assert max(found.unlisted.values()) < 0.0


def test_a_gradual_contact_is_a_contact_of_another_form():
    found = diagnosed(FORMS["toe"](depth=0.6))
    assert found.effects == ("contact_offset",)
    assert found.stages[-1].shape is not None
    depths, factors = np.transpose(found.stages[-1].shape.over_depth)
    assert factors[0] < 0.5 < factors[-1]
    assert np.all(np.diff(depths) > 0.0)


def test_a_gradual_contact_is_found_where_the_constants_of_a_gap_lead_away():
    stiff = Constants(0.917, 1.409, (0.469, 0.488, 0.043), (4.996, 0.3286))
    toe = FORMS["toe"](depth=0.584)
    found = diagnose(hidden_pad(toe, rates=PAPER_RATES, constants=stiff))
    named_in_form(found, "contact_offset", GradualContact)


def test_where_nothing_is_named_the_best_contenders_are_tried_in_other_forms():
    work = diagnosed(rates=(1.0, 20.0)).work
    assert not work.path.last.effects
    found = [one for some in turns(work.experiment, work.ensemble, work.path, True) for one in some]
    tried = {form.effect for form, _, _ in found if not form.distant}
    best = {c.effect for c in work.path.rounds[0].contenders[:3] if c.point is not None}
    assert tried
    assert tried == {effect for effect in best if work.ensemble.effect(effect).reshapes}


def test_a_leak_that_levels_off_early_is_found_though_a_steady_one_shows_little():
    soft = Constants(0.4, 1.0, (0.35, 0.55, 0.1), (8.0, 0.15))
    found = diagnose(
        hidden_pad(
            FORMS["saturating_leak"](share=0.05, time=100.0), rates=PAPER_RATES, constants=soft
        )
    )
    listed = next(r for r in found.ranking if r.effect == "fluid_leak")
    assert found.effects == ("fluid_leak",)
    assert found.own_form.log_bayes_factor > listed.log_bayes_factor + Settings().form
