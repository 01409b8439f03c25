"""A fast mode that stands in for a growing drag: a film like it is found all the same."""

from dataclasses import replace

import pytest
from hidden_pads import ensemble_of, hidden_pad

from qlvbayes.diagnosis.contest import contest
from qlvbayes.diagnosis.search import plain_fits
from qlvbayes.effects.extra_relaxation_mode import ExtraRelaxationMode
from qlvbayes.effects.squeeze_film import SqueezeFilm
from qlvbayes.inference.gaussnewton import climb
from qlvbayes.synthetic import PAPER_RATES, Constants, GrowingDrag, full_retraction_protocol

FAST = 100.0  # 1/s, faster than any mode of the pad
PAD = Constants(m=0.85, b=0.77, c=(0.31, 0.65, 0.04), v=(3.2, 0.13))
KINDS = (SqueezeFilm, ExtraRelaxationMode)


@pytest.fixture(scope="module")
def ensemble():
    drag = GrowingDrag(eta=1e-3, depth=0.41)
    experiment = hidden_pad(
        drag, rates=PAPER_RATES, constants=PAD, protocol=full_retraction_protocol
    )
    return ensemble_of(experiment, *KINDS)


@pytest.fixture(scope="module")
def top(ensemble):
    """The plain model's optimum, whose first mode has the drag's place."""
    top = plain_fits(ensemble)[0]
    assert top.constants[ensemble.names.index("v[1]")] > FAST
    return top


def test_it_is_found_though_the_next_best_spectrum_is_wrong_too(ensemble, top, monkeypatch):
    """Without the wider search, which the best contenders alone get."""
    monkeypatch.setattr("qlvbayes.diagnosis.contest._widened", lambda e, base, ranked, best: ranked)
    theta = top.theta.copy()
    theta[ensemble.plain[-1]] += 1.5
    wrong = replace(top, theta=theta)
    found = contest(ensemble, top, [kind.name for kind in KINDS], humps=[top, wrong])
    assert found.best.effect == "squeeze_film"
    rate = found.best.point.constants[ensemble.names.index("v[1]")]
    assert rate == pytest.approx(PAD.v[0], rel=0.1)
    # a local fit from there sees next to nothing of what the film is worth
    beside = climb(ensemble, ensemble.subset(("squeeze_film",)), top.theta)
    assert beside.log_evidence - top.log_evidence < 0.05 * found.best.log_bayes_factor
