"""In how many readings the evidence for an effect lies."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.hidden_pads import hidden_pad

from qlvbayes.diagnosis.checks.decisive import decisive, fewest, log_densities
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.effects.catalogue import find
from qlvbayes.inference.modes import find_modes
from qlvbayes.simulate.hidden import ViscousDrag


@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=8))
def test_no_smaller_set_carries_half(values):
    gains = np.array(values)
    if gains.sum() <= 0.0:
        return
    count, half = fewest(gains), 0.5 * gains.sum()
    ordered = np.sort(gains)[::-1]
    assert ordered[:count].sum() >= half - 1e-12
    assert count == 1 or ordered[: count - 1].sum() < half


@pytest.fixture(scope="module")
def searched():
    """A pad with drag, seen without it and with it, and a lag of next to nothing."""
    experiment = hidden_pad(ViscousDrag(eta=0.004), rates=(1.0, 20.0))
    search = build_search(experiment, kinds=[find("viscous_drag")])
    search.begin()
    with_drag = search.baseline.plus("viscous_drag")
    theta = search.density.space.parameters(with_drag)
    start = np.zeros(theta.size)
    point = search.modes[search.baseline][0].point
    start[theta.positions_of(point.own)] = point.theta
    start[-1] = 0.1
    found = find_modes(search.density, with_drag, start)
    search.keep(with_drag, search.candidates_from(with_drag, found))
    return experiment, search, with_drag


@pytest.mark.parametrize("effects", [frozenset(), frozenset({"viscous_drag"})], ids=len)
def test_the_block_means_log_densities_add_up_to_the_likelihood(searched, effects):
    _, search, _ = searched
    density = search.density
    found = search.modes[replace(search.baseline, effects=effects)][0]
    terms = density.terms(found.point, found.mode.size)
    expected = density.log_constant - (terms.loss - found.point.prior.loss)
    assert log_densities(density, found).sum() == pytest.approx(float(expected), rel=1e-9)


def test_a_drag_is_carried_by_many_and_one_reading_is_told_as_one(searched):
    experiment, search, with_drag = searched
    density = search.density
    found, without = search.modes[with_drag][0], search.modes[search.baseline][0]
    drag = decisive(density, experiment.trials, found, without)
    assert drag.blocks > 4  # of two coarsely sampled tests
    assert drag.phase in ("ramp", "unload")
    assert drag.of == density.whitener.precisions.size
    # the same fits, of a record in which one reading alone is off the plain model
    spiked = found.point.predicted.copy()
    test, block = 1, 40
    spiked[test, block] -= 1.0
    other = replace(found, mode=replace(found.mode, size=0.0))
    alone = replace(other, mode=replace(other.mode, point=replace(found.point, predicted=spiked)))
    one = decisive(density, experiment.trials, other, alone)
    assert one.blocks == 1
    assert one.test == experiment.trials[test].name
    assert decisive(density, experiment.trials, alone, other) is None
