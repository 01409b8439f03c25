"""Checks for missed modes: evidences against Savage-Dickey, extra modes in the place of others."""

from dataclasses import replace

import numpy as np
import pytest
from support.hidden_pads import hidden_pad

from qlvbayes.diagnosis.crosschecks import (
    MissedModeChecks,
    exchanged_starts,
    nested_starts,
    savage_dickey,
)
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.effects.catalogue import find
from qlvbayes.inference.modes import Mode, find_mode

KINDS = [find(name) for name in ("force_offset", "viscous_drag", "extra_relaxation_mode")]


@pytest.fixture(scope="module")
def search():
    """A pad with nothing hidden: every effect's posterior reaches nothing."""
    found = build_search(hidden_pad(rates=(1.0, 20.0, 100.0)), kinds=KINDS)
    found.begin()
    for kind in KINDS:
        found.evaluate(found.baseline.plus(kind.name))
    return found


@pytest.mark.parametrize("effect", ["force_offset", "viscous_drag"])
def test_evidences_of_nested_hypotheses_keep_the_savage_dickey_ratio(search, effect):
    fuller = search.candidates[search.baseline.plus(effect)]
    expected = savage_dickey(fuller, effect, search.settings)
    found = fuller.log_evidence - search.candidates[search.baseline].log_evidence
    assert found == pytest.approx(expected, abs=1.0)
    assert (
        nested_starts(search.density, search.candidates, fuller.hypothesis, effect, search.settings)
        == []
    )


def test_a_hypothesis_left_at_a_lower_place_is_told_and_led_back(search):
    """The plain model a few sds away from its mode, as if the search had ended there."""
    best = search.modes[search.baseline]
    point = best[0].point
    sds = np.sqrt(np.diag(best[0].evidence.covariance))
    away = search.density.at(search.baseline, point.own.within(point.theta + 4.0 * sds))
    size = search.density.likeliest_size(away)
    low = Mode(away, size, search.density.terms(away, size).loss, False, 1)
    search.modes[search.baseline] = search.candidates_from(search.baseline, [low])
    try:
        fuller = search.baseline.plus("force_offset")
        wanted = nested_starts(
            search.density, search.candidates, fuller, "force_offset", search.settings
        )
        assert {start.hypothesis for start in wanted} == {search.baseline, fuller}
        assert MissedModeChecks(search).check_nested([fuller])
        assert search.checks["nested"].failed == 1
        assert search.checks["nested"].higher >= 1
        found = search.modes[search.baseline][0].mode.loss
        assert found == pytest.approx(best[0].mode.loss, abs=0.1)
    finally:
        search.modes[search.baseline] = best


def test_where_nothing_is_far_from_the_posterior_no_ratio_is_asked_for(search):
    fuller = search.candidates[search.baseline.plus("force_offset")]
    k = fuller.point.own.size - 1
    mean = fuller.evidence.mean.copy()
    mean[k] = 9.0 * np.sqrt(fuller.evidence.covariance[k, k])
    far = replace(fuller, evidence=replace(fuller.evidence, mean=mean))
    assert savage_dickey(far, "force_offset", search.settings) is None


def test_an_extra_mode_in_the_place_of_one_that_the_law_has_leads_back_to_the_law(search):
    """Its own slow mode given to the effect, and a needless one to the law."""
    space, hypothesis = search.density.space, search.baseline.plus("extra_relaxation_mode")
    plain, own = search.modes[search.baseline][0], space.parameters(hypothesis)
    fractions, rates = space.spectra(search.baseline, plain.point.constants[None])
    names = own.by_name
    theta = np.zeros(own.size)
    theta[own.positions_of(plain.point.own)] = plain.point.theta
    shares = fractions[0].copy()
    taken, shares[2] = shares[2], 1e-3
    shares /= shares.sum()
    for name, value in (("c[0]", shares), ("v[1]", np.array([rates[0, 0], 3.0 * rates[0, 1]]))):
        theta[list(names[name].theta)] = np.ravel(names[name].prior.unconstrain(value))
    for name, value in (("c", taken), ("v", rates[0, 1])):
        leaf = names[f"extra_relaxation_mode.{name}"]
        theta[list(leaf.theta)] = np.ravel(leaf.prior.unconstrain(np.asarray(value)))
    point = search.density.at(hypothesis, theta)
    moved = search.candidates_from(hypothesis, [Mode(point, 0.0, 0.0, False, 1)])
    candidate = (
        moved[0]
        if moved
        else replace(search.candidates[hypothesis], mode=Mode(point, 0.0, 0.0, False, 1))
    )
    found = list(exchanged_starts(space, candidate, ["extra_relaxation_mode"]))
    assert [start.hypothesis for start in found] == [search.baseline] * 3
    losses = [find_mode(search.density, search.baseline, start.theta).loss for start in found]
    assert min(losses) == pytest.approx(plain.mode.loss, abs=0.1)
