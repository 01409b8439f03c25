"""Check that unlisted structure is reported with its size, and that none is named for sure."""

import pytest
from blind.catalogue import OUTSIDE
from msgspec import structs
from support.hidden_pads import FEW, hidden_pad, keeps_diagnosis_contract

from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.settings import Breadth, DiagnosisSettings
from qlvbayes.diagnosis.summary.words import _unnamed
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.simulate import HIDDEN, PAPER_RATES

LEVEL = 1.1  # N, where the amplifier clips: 80 % of the largest force
RATES = {"few": (1.0, 100.0), "all": (0.1, 1.0, 20.0, 100.0)}
KINDS = {"few": FEW[:2], "all": EFFECTS}
NARROW = Breadth(starts=2, draws=2, shapes=1, optimised=1, redrawn=0, substitutes=0, sampled=4)
SETTINGS = {"few": DiagnosisSettings(breadth=NARROW), "all": DiagnosisSettings()}


@pytest.mark.slow
def test_a_steady_drift_is_one_and_a_jump_in_the_middle_of_a_study_none_alone():
    """A drift may take a part of what gives way, but something else is there and said to be."""
    given_way = OUTSIDE["slow_creep_jump"](offset=-0.1, begin=280.0, time=15.0)
    jump = diagnose(hidden_pad(given_way, rates=PAPER_RATES), kinds=FEW)
    assert jump.result.verdict in ("partly_explained", "unexplained")
    assert jump.result.outside > 0.5
    assert jump.result.stages[-1].rmse > 1.5 * jump.result.noise
    steady = hidden_pad(HIDDEN["force_drift"](rate=1e-4), rates=PAPER_RATES)
    found = diagnose(steady, kinds=FEW).result
    assert (found.verdict, found.effects) == ("missing_effect", ("force_drift",))
    drift = found.stages[-1].parameters["force_drift.rate"]
    assert abs(drift.mean - 1e-4) < 4.0 * drift.sd
    assert found.outside < 0.5


@pytest.fixture(scope="module", params=["few", pytest.param("all", marks=pytest.mark.slow)])
def clipped(request):
    """An amplifier that cannot read large forces: no effect of the list does that."""
    clipping = OUTSIDE["amplifier_clipping"](level=LEVEL)
    given, size = hidden_pad(clipping, rates=RATES[request.param]), request.param
    return diagnose(given, kinds=KINDS[size], settings=SETTINGS[size])


def test_what_is_not_on_the_list_is_left_and_told(clipped):
    keeps_diagnosis_contract(clipped)
    assert clipped.result.verdict in ("unexplained", "partly_explained")
    assert clipped.result.outside > 0.5
    assert clipped.result.stages[-1].p_value < DiagnosisSettings().false_alarms
    left = clipped.result.remainder
    assert not left.small
    assert left.test in " ".join(clipped.paragraphs())


def test_what_names_nothing_and_is_in_the_prediction_is_told(clipped):
    """Predictions are averaged over the alternatives, whatever these hold."""
    first, *others = clipped.result.alternatives
    name = min(clipped.work.search.families.unmodelled)
    for share, told in ((0.6, 1), (0.001, 0)):
        held = structs.replace(first, effects=(*first.effects, name), probability=share)
        rest = [structs.replace(one, effects=()) for one in others]
        said = _unnamed(structs.replace(clipped.result, alternatives=(held, *rest)), name, "this")
        assert len(said) == told
