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


def p_value(experiment: Experiment) -> float:
    search = build_search(experiment, kinds=FEW)
    search.evaluate(search.baseline)
    point = search.candidates[search.baseline].point
    record = search.density.space.record
    return adequacy(experiment, record, point, search.settings.cells).p_value


def test_a_known_error_of_the_zeros_explains_what_they_leave():
    assert p_value(shifted(None)) < 1e-3
    assert p_value(shifted(0.02)) > 0.05
