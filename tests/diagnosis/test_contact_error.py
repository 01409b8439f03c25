"""The error of the zeros of displacement, in the search and in the adequacy test."""

from dataclasses import replace

from support.hidden_pads import FEW, hidden_pad

from qlvbayes.diagnosis.checks.adequacy import adequacy
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.io.data import Pad
from qlvbayes.motion.experiment import Experiment, prepare

OFF = (0.03, -0.02, 0.02)  # mm, of a stroke of 2 mm


def shifted(contact_sd: float | None) -> Experiment:
    """A pad with nothing hidden, whose tests have zeros that are off."""
    known = hidden_pad(rates=(1.0, 5.0, 20.0))
    tests = tuple(
        replace(trial.test, displacement=trial.test.displacement + off, contact_sd=contact_sd)
        for trial, off in zip(known.trials, OFF, strict=True)
    )
    return prepare(Pad(known.pad, tests, known.units))


def fitted(experiment: Experiment) -> tuple[float, tuple[float, ...]]:
    """Return the p-value of the plain model, and the scatter between tests that it needs."""
    search = build_search(experiment, kinds=FEW)
    search.evaluate(search.baseline)
    point = search.candidates[search.baseline].point
    record = search.density.space.record
    tested = adequacy(experiment, record, point, search.settings.cells)
    return tested.p_value, point.separation.scatter.sizes


def test_a_known_error_of_the_zeros_explains_what_they_leave():
    """Without it the stiffness would have to differ from test to test."""
    _, scatter = fitted(shifted(None))
    assert any(scatter)
    p_value, scatter = fitted(shifted(0.02))
    assert p_value > 0.05
    assert not any(scatter)
