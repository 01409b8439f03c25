"""Check that the constants allow for each effect where several explain the tests alike."""

import numpy as np
import pytest
from support.hidden_pads import FEW, hidden_pad

from qlvbayes.diagnosis.checks.outcome import averaged
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.result import Estimate
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.catalogue import find
from qlvbayes.model.choices import Choices
from qlvbayes.simulate import HIDDEN
from qlvbayes.use.prescribed.forecast import predict_program
from qlvbayes.use.prescribed.hypotheses import drawn_hypotheses

DRAGS = ("viscous_drag", "power_law_drag", "squeeze_film")
RIVALS = (*FEW, *(kind for kind in map(find, DRAGS) if kind not in FEW))


@pytest.fixture(scope="module")
def either():
    """A drag nearly as the speed, in tests that hardly tell it from one just so."""
    experiment = hidden_pad(
        HIDDEN["power_law_drag"](k=0.003, n=0.87), rates=(0.1, 1.0, 20.0, 100.0)
    )
    return diagnose(experiment, kinds=RIVALS)


def test_the_average_has_the_moments_of_the_mixture():
    rng = np.random.default_rng(0)
    logs = np.array([-1000.0, -1001.0])
    found = [{"m": Estimate("N/mm", 1.0, 0.1)}, {"m": Estimate("N/mm", 2.0, 0.3)}]
    weights = np.array([1.0, np.exp(-1.0)]) / (1.0 + np.exp(-1.0))
    which = rng.choice(2, 400_000, p=weights)
    draws = rng.normal(np.array([1.0, 2.0])[which], np.array([0.1, 0.3])[which])
    mixed = averaged(logs, found)["m"]
    assert mixed.unit == "N/mm"
    assert mixed.mean == pytest.approx(draws.mean(), abs=0.005)
    assert mixed.sd == pytest.approx(draws.std(), abs=0.005)
    alone = {"m": Estimate("N/mm", 0.3, 0.01), "b": Estimate("1/mm", 1.1, 0.02)}
    found = averaged([-50.0], [alone])
    assert {n: (e.mean, e.sd) for n, e in found.items()} == {
        n: (e.mean, pytest.approx(e.sd)) for n, e in alone.items()
    }


@pytest.mark.slow
def test_rivals_make_the_verdict_ambiguous_and_a_further_test_is_suggested(either):
    result = either.result
    assert result.verdict == "ambiguous"
    assert {"viscous_drag", "power_law_drag"} <= set(result.group)
    assert result.suggestions[0].evidence > 0.0
    held = [r.inclusion for r in result.ranking if r.effect in result.group]
    assert sum(held) >= DiagnosisSettings().covered
    assert max(held) < DiagnosisSettings().named
    listed = [one.probability for one in result.not_ruled_out]
    assert listed == sorted(listed, reverse=True)
    assert sum(listed) <= 1.0 + 1e-9
    last = result.stages[-1].parameters
    assert set(result.constants) == {name for name in last if "." not in name}
    weight = result.alternatives[0].probability
    for name, found in result.constants.items():
        # of one hypothesis alone, the share of its weight is the least that its variance keeps
        assert found.sd >= last[name].sd * np.sqrt(weight) * 0.99


@pytest.fixture(scope="module")
def left(either):
    return drawn_hypotheses(either, Choices())


@pytest.mark.slow
def test_draws_of_hypotheses_have_their_probabilities_moments_and_bounds(either, left):
    listed, last = either.result.alternatives, either.result.stages[-1]
    assert [(h.base, h.effects) for h in left.hypotheses] == [(h.base, h.effects) for h in listed]
    total = sum(one.probability for one in listed)
    for one in left.hypotheses:
        assert abs(len(one.constants["m"]) - 400 * one.probability / total) <= 1.0
        shares = np.sum([one.constants[f"c[{k}]"] for k in range(3)], axis=0)
        assert np.allclose(shares, 1.0)
        assert not any(name.startswith("noise.") for name in one.constants)
        assert min(one.constants.get("viscous_drag.eta", (0.0,))) >= 0.0
    drawn = drawn_hypotheses(either, Choices(), draws=8000)
    one = next(h for h in drawn.hypotheses if (h.base, h.effects) == (last.base, last.effects))
    count = len(one.constants["m"])
    for name in ("m", "b", "v[1]"):
        values, reported = np.array(one.constants[name]), last.parameters[name]
        # four sds of what so many draws say; the reported sd is that of a slope
        most = 4.0 * reported.sd / np.sqrt(count) + 0.1 * reported.sd
        assert abs(values.mean() - reported.mean) < most
        assert values.std() == pytest.approx(reported.sd, rel=0.1)
        # what a discrepancy may have moved them by makes them wider than those of the curve
        assert np.std(one.curve[name]) < 1.2 * values.std()


@pytest.mark.slow
def test_a_prediction_of_the_motion_tested_holds_the_measured_force(either, left):
    """Averaged over all hypotheses, late in the hold of the fastest test."""
    trial = either.work.experiment.trials[-1]
    found = predict_program(left, "ramp 1.6 mm at 33 mm/s, hold 29 s")
    late = (trial.test.time > 20.0) & (trial.test.time < 29.0)
    place = np.searchsorted(found.time, 25.0)
    low, high = (end[place] for end in found.band(0.9))
    noise = either.work.experiment.floor.total
    assert late.sum() > 3
    assert low - 2.0 * noise < trial.test.force[late].mean() < high + 2.0 * noise
