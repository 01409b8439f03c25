"""A density with several humps: modes that change names tell the same of the tests."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_pads import ensemble_of, hidden_pad

from qlvbayes.diagnosis.contest import _searched, contest
from qlvbayes.diagnosis.evidence import evidence_of_humps, sampled_evidence
from qlvbayes.diagnosis.search import plain_fits
from qlvbayes.effects.extra_relaxation_mode import ExtraRelaxationMode
from qlvbayes.effects.fluid_pressure import FluidPressure
from qlvbayes.inference.multistart import climbs_anew
from qlvbayes.synthetic import HIDDEN

EXTRA = "extra_relaxation_mode"


@pytest.fixture(scope="module")
def ensemble():
    """Of a pad with three modes, fitted with two and an extra one, or fluid that is trapped."""
    experiment = hidden_pad(HIDDEN[EXTRA](c=0.1, v=1.2), rates=(1.0, 20.0, 100.0))
    return ensemble_of(experiment, ExtraRelaxationMode, FluidPressure)


@pytest.fixture(scope="module")
def tops(ensemble):
    return climbs_anew(ensemble, ensemble.subset((EXTRA,)))


def spectrum(ensemble, point):
    """Shares and rates of all modes, the fastest first."""
    found = dict(zip(ensemble.names, point.constants, strict=True))
    kept = 1.0 - found[f"{EXTRA}.c"]  # the extra mode takes its share from all others
    modes = [(found[f"v[{k}]"], kept * found[f"c[{k}]"]) for k in (1, 2)]
    return sorted([*modes, (found[f"{EXTRA}.v"], found[f"{EXTRA}.c"])], reverse=True)


def test_modes_change_names(ensemble, tops):
    """The second hump has the first one's spectrum, and is as likely; only the names differ."""
    first, second = tops[:2]
    names = [ensemble.names.index(f"{EXTRA}.v"), ensemble.names.index("v[2]")]
    assert abs(np.log(first.constants[names[0]] / second.constants[names[0]])) > 1.0
    assert sum(first.losses) == pytest.approx(sum(second.losses), abs=1.0)
    sds = first.constants_sds[names] / first.constants[names]
    for one, two in zip(spectrum(ensemble, first), spectrum(ensemble, second), strict=True):
        assert one == pytest.approx(two, rel=max(0.02, sds.max()))


def test_each_hump_counts_once(ensemble, tops):
    first, second = tops[:2]
    alone = [sampled_evidence(ensemble, top) for top in (first, second)]
    assert evidence_of_humps(ensemble, [first, first]) == alone[0]
    assert evidence_of_humps(ensemble, [first, second]) == pytest.approx(np.logaddexp(*alone))


def test_close_contenders_are_searched_for_their_highest_humps(ensemble, tops):
    found = contest(ensemble, plain_fits(ensemble)[0], ensemble.candidates)
    assert all(contender.point is not None for contender in found.contenders)
    alike = [replace(contender, log_bayes_factor=9.0) for contender in found.contenders]
    searched = _searched(ensemble, alike)
    for before, after in zip(alike, searched, strict=True):
        rise = after.point.log_evidence - before.point.log_evidence
        assert after.log_bayes_factor == pytest.approx(9.0 + rise)
        assert rise >= 0.0
        assert all(hump.log_evidence <= after.point.log_evidence for hump in after.humps)
    extra = next(contender for contender in searched if contender.effect == EXTRA)
    assert extra.humps
    assert extra.point.log_evidence >= tops[0].log_evidence
    clear = [replace(one, log_bayes_factor=9.0 * k) for k, one in enumerate(found.contenders)]
    assert _searched(ensemble, clear) == clear


def test_a_start_where_the_density_overflows_is_left_out(ensemble, tops, monkeypatch):
    far = ensemble.draw(3).copy()
    far[1, ensemble.plain] = 800.0  # exp(800) is infinite
    monkeypatch.setattr(type(ensemble), "draw", lambda self, count: far)
    found = climbs_anew(ensemble, ensemble.subset((EXTRA,)))
    assert found
    assert all(np.isfinite(top.log_evidence) for top in found)
