"""Starts: an extra mode of the relaxation in the place of one that the law has."""

from dataclasses import replace

import numpy as np
import pytest
from support.hidden_pads import hidden_pad

from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.effects.catalogue import find
from qlvbayes.inference.modes import Mode, find_mode
from qlvbayes.inference.starts import exchanged_starts

KINDS = [find(name) for name in ("viscous_drag", "extra_relaxation_mode")]


@pytest.fixture(scope="module")
def search():
    """A pad with nothing hidden."""
    found = build_search(hidden_pad(rates=(1.0, 20.0, 100.0)), kinds=KINDS)
    found.begin()
    for kind in KINDS:
        found.evaluate(found.baseline.plus(kind.name))
    return found


def test_an_extra_mode_in_the_place_of_one_that_the_law_has_leads_back_to_the_law(
    search, monkeypatch
):
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
    starts = exchanged_starts(space, point, search.baseline)
    assert len(starts) == 3
    losses = [find_mode(search.density, search.baseline, start).loss for start in starts]
    assert min(losses) == pytest.approx(plain.mode.loss, abs=0.1)
    # a search that was left at a lower mode of the law is led back from there
    away = plain.point.own.within(
        plain.point.theta + 4.0 * np.sqrt(np.diag(plain.evidence.covariance))
    )
    low = search.density.at(search.baseline, away)
    terms = search.density.terms(low, 0.0)
    known = replace(plain, mode=Mode(low, 0.0, terms.loss, False, 1, terms.curvature))
    exchanged = replace(
        search.candidates[hypothesis], mode=Mode(point, 0.0, 0.0, False, 1, terms.curvature)
    )
    some = {search.baseline: [replace(known, log_evidence=-1e9)], hypothesis: [exchanged]}
    monkeypatch.setattr(search, "modes", some)
    search.evaluate(search.baseline, hypothesis)
    found = search.modes[search.baseline][0].mode.loss
    assert found == pytest.approx(plain.mode.loss, abs=0.1)


def test_other_neighbours_have_no_exchanged_starts(search):
    drag = search.baseline.plus("viscous_drag")
    point, space = search.modes[drag][0].point, search.density.space
    assert exchanged_starts(space, point, search.baseline) == []
    assert exchanged_starts(space, point, drag.plus("extra_relaxation_mode")) == []
