"""Forms that the list's law may be far from are found from anywhere, not from its optimum alone."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_pads import ensemble_of, hidden_pad

from qlvbayes.diagnosis.contest import contest
from qlvbayes.diagnosis.forms.drainage import PowerDrainage
from qlvbayes.diagnosis.forms.ownforms import StiffeningFrame
from qlvbayes.diagnosis.forms.turns import turns
from qlvbayes.diagnosis.search import Path, Step, plain_fits
from qlvbayes.effects.fluid_pressure import FluidPressure
from qlvbayes.effects.frame_compliance import FrameCompliance
from qlvbayes.synthetic import FORMS, PAPER_RATES, TABLE_1, Constants

pytestmark = pytest.mark.slow  # whole diagnoses

SLOW = Constants(m=1.15, b=0.41, c=(0.28, 0.63, 0.09), v=(3.0, 0.2))


def experiment_and_ensemble(constants, effect, kind):
    experiment = hidden_pad(effect, rates=PAPER_RATES, constants=constants)
    return experiment, ensemble_of(experiment, kind)


def attempt(constants, effect, kind, settle=lambda contender: contender):
    """The form that is tried, and the optimum of the list's law that it is tried from."""
    experiment, ensemble = experiment_and_ensemble(constants, effect, kind)
    first = contest(ensemble, plain_fits(ensemble)[0], ensemble.candidates)
    first = replace(first, contenders=tuple(settle(c) for c in first.contenders))
    path = Path([Step((), first.base, [], None)], [first])
    tried = [one for some in turns(experiment, ensemble, path, True) for one in some]
    ((form, _, listed),) = [one for one in tried if one[0].distant]
    return form, listed, first.base


@pytest.fixture(scope="module")
def drainage():
    """Pressure that drains with its square, of which the list's law explains next to nothing."""
    hidden = FORMS["quadratic_pressure"](k=0.165, drain=4.75)
    return attempt(SLOW, hidden, FluidPressure)


@pytest.fixture(scope="module")
def frame():
    """A frame that stiffens, as if the screen had found that a straight one promises nothing."""
    hidden = FORMS["bending_frame"](compliance=0.5, force=0.3)
    return attempt(TABLE_1["C"], hidden, FrameCompliance, lambda c: replace(c, point=None))


def test_pressure_is_found_where_the_lists_law_leads_astray(drainage):
    form, listed, plain = drainage
    assert isinstance(form, PowerDrainage)
    found = form.highest(listed, -np.inf)
    assert found.log_evidence > max(listed.log_evidence, plain.log_evidence) + 20.0
    sd = np.sqrt(found.covariance[-1, -1])
    assert abs(found.theta[-1] - 1.0) < 3.0 * sd < 1.0


def test_a_bending_frame_is_tried_whatever_a_straight_one_promises(frame):
    form, listed, plain = frame
    assert isinstance(form, StiffeningFrame)
    found = form.highest(listed, -np.inf)
    assert found.log_evidence > plain.log_evidence + 10.0
    assert form.is_typical(found)


def test_what_is_not_distant_climbs_from_the_lists_optimum_alone(frame, monkeypatch):
    form, listed, _ = frame
    monkeypatch.setattr(type(form), "distant", False)
    expected = form.fit(listed, worth=-np.inf)
    np.testing.assert_array_equal(form.highest(listed, -np.inf).theta, expected.theta)


def test_a_start_of_no_density_does_not_win(drainage, monkeypatch):
    form, listed, _ = drainage
    nowhere = replace(listed, theta=np.full_like(listed.theta, 400.0))
    monkeypatch.setattr(type(form), "_starts", lambda self, listed: [nowhere, listed, listed])
    assert np.isfinite(form.highest(listed, -np.inf).log_evidence)
