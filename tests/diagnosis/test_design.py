"""Which further test would tell two explanations apart: the promise against what it then brings."""

from dataclasses import replace

import numpy as np
import pytest
from blind.study import measured

from qlvbayes.diagnosis.candidate import candidate_at
from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.information import Readings, screen
from qlvbayes.diagnosis.nexttest.planning import equal_belief, suggest
from qlvbayes.diagnosis.searchsetup import as_chosen, build_search
from qlvbayes.effects.drifts import ForceDrift, ForceOffset
from qlvbayes.inference.modes import find_mode
from qlvbayes.inference.starts import shapes
from qlvbayes.io.data import Pad
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import HIDDEN, NOISES, TABLE_1, HiddenPad, paper_protocol, record_study

EFFECTS = (ForceOffset, ForceDrift)
OFFSET = 0.012  # N
HOUR = 3600.0  # s
AGAIN = 4  # noises of the further test


def ramps(seed, names, later=0.0):
    """Ramps of 20 mm/s with holds, of a pad whose force is offset."""
    pad = HiddenPad(TABLE_1["B"], (HIDDEN["force_offset"](offset=OFFSET),))
    programs = {name: paper_protocol(20.0) for name in names}
    found = measured(record_study({"B": pad}, programs, NOISES["white"], seed, 300), "B")
    return tuple(replace(test, start_s=later) for test in found.tests)


def fitted(tests):
    """Experiment, and the modes with an offset and with a drift."""
    white = Choices(noise="white")
    experiment = as_chosen(prepare(Pad("B", tests, PAD)), white)
    search = build_search(experiment, white, kinds=EFFECTS)
    search.evaluate(search.baseline)
    plain = search.modes[search.baseline][0]
    found = []
    for effect in EFFECTS:
        hypothesis = search.baseline.plus(effect.name)
        own = search.density.space.parameters(hypothesis)
        start = shapes(search.density.space, plain.point, own, effect.name)[0]
        mode = find_mode(search.density, hypothesis, start)
        found.append(candidate_at(search.density, hypothesis, mode, 0.0))
    return experiment, found


def gain(found):
    """2 ln of the evidence of the offset over that of the drift."""
    offset, drift = (one.log_evidence for one in found)
    return 2.0 * (offset - drift)


@pytest.fixture(scope="module")
def present():
    return fitted(ramps(0, ("one",)))


@pytest.mark.slow
def test_suggestions_come_best_first_whatever_the_order(present):
    experiment, found_modes = present
    found = suggest(experiment, found_modes)
    worth = [suggestion.evidence for suggestion in found]
    assert worth == sorted(worth, reverse=True)
    assert min(worth) >= 0.0
    assert suggest(experiment, found_modes[::-1]) == found


def test_explanations_that_are_the_same_promise_nothing(present):
    experiment, (offset, _) = present
    found = suggest(experiment, [offset, replace(offset)])
    assert {suggestion.evidence for suggestion in found} == {0.0}


def test_nothing_is_suggested_where_no_test_fits_into_the_time(present, monkeypatch):
    """A pad that forgets slowly needs too long a rest before the next test."""
    experiment, found_modes = present
    monkeypatch.setattr("qlvbayes.diagnosis.nexttest.planning._LONGEST", 1e-3)
    assert suggest(experiment, found_modes) == []


@pytest.mark.slow
def test_the_promise_is_kept(present):
    """Press once more in an hour: the offset, which is right, gains about what was promised."""
    experiment, found = present
    again = Design(1.6, 20.0, 1000.0, hold=30.0, share=0.5, rest=30.0, wait=HOUR)
    (expected,) = screen(equal_belief(found), [again], Readings.after(experiment, 0.0)).evidence()
    first, later = ramps(0, ("one",)), experiment.scales.clock + HOUR
    gains = []
    for seed in range(1, AGAIN + 1):
        _, points = fitted(first + ramps(seed, ("again",), later))
        gains.append(gain(points) - gain(found))
    assert 0.5 * expected < np.mean(gains) < 2.0 * expected
