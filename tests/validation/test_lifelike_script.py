"""Lifelike pads: what the simulator says of them is so in their arrays and motions."""

import json
from functools import cache

import lifelike
import numpy as np
import pytest
from blind.contact import NearContact
from blind.lists import PRESENT
from lifelike_pads import BLOCK, NOISE, SPREAD, STIFFNESS_SPREAD, item, make_study
from lifelike_rig import RAMP_S, JerkLimited, kind_of
from lifelike_sizes import CONTACT_MM, SEEN, UNLISTED_SHARE

from qlvbayes.io.data import read_measurements
from qlvbayes.simulate import HiddenPad, Move

SEED = 1
INDICES = {"none": 1, "single": 6, "sticky": 9, "air": 15, "double": 0}


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(k, marks=() if name == "single" else pytest.mark.slow, id=name)
        for name, k in INDICES.items()
    ],
)
def study(request):
    return made(request.param)


@cache
def made(index):
    return make_study(SEED, index)


def test_twenty_studies_hide_what_a_block_holds_and_every_name_comes():
    items = [item(3, k) for k in range(20 * 5)]
    assert sorted(one.scene for one in items[:20]) == sorted(BLOCK)
    singles = [one.names[0] for one in items if one.scene == "single"]
    assert set(singles) == set(PRESENT.listed)
    assert all(len(set(one.names)) == 2 for one in items if one.scene == "double")


def test_truth_the_unlisted_part_and_the_noise_have_their_sizes(study):
    low, high = UNLISTED_SHARE
    assert 0.97 * low < study.unlisted_share < 1.03 * high
    noise = np.hypot(study.cell.white, study.cell.correlated)
    assert 0.3 * NOISE[0] < noise / study.peak < 3.0 * NOISE[1]  # the peak without effects
    assert all(0.0 <= spread <= SPREAD for spread in study.spreads[:-1])
    assert 0.0 <= study.spreads[-1] <= STIFFNESS_SPREAD
    assert abs(study.rig.contact) <= CONTACT_MM
    assert 4 <= len(study.pad.tests) <= 9
    assert all(value >= SEEN for value in study.seen.values())
    # measured in the arrays, phase by phase
    parts = [a - b for a, b in zip(study.forces(), study.forces(unlisted=False), strict=True)]
    squares = []
    for motion, t, part in zip(study.rig.motions.values(), study.rig.times, parts, strict=True):
        ends = [begin for begin, _ in motion.phases[1:]]
        squares += [np.mean(own**2) for own in np.split(part, np.searchsorted(t, ends))]
    assert np.sqrt(np.mean(squares)) / study.peak == pytest.approx(study.unlisted_share, rel=1e-6)
    errors = [t.force - f for t, f in zip(study.pad.tests, study.forces(), strict=True)]
    expected = np.hypot(study.cell.white, study.cell.correlated)
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) == pytest.approx(expected, rel=0.4)
    for test, motion in zip(study.pad.tests, study.rig.motions.values(), strict=True):
        off = test.displacement - motion.displacement(test.time)
        assert np.abs(off).max() <= 0.5 * study.cell.encoder * (1 + 1e-6)


def test_motion_has_the_jerk_and_the_ramp_of_its_rig(study):
    """Third differences of the displacement, and the time to the top speed."""
    fastest = max(study.rig.motions.values(), key=lambda m: np.abs(_speeds(m)).max())
    t = np.linspace(0.0, fastest.duration, 100_000)
    step = t[1]
    a = fastest.acceleration(t)
    assert np.abs(np.diff(a)).max() / step == pytest.approx(study.rig.plan.jerk, rel=1e-3)
    for one, derivative in (("displacement", "velocity"), ("velocity", "acceleration")):
        values = getattr(fastest, one)(t)
        apart = np.abs(np.gradient(values, step) - getattr(fastest, derivative)(t))[2:-2]
        assert np.mean(apart > study.rig.plan.jerk * step) < 1e-3  # pieces meet to within rounding
        assert 2.0 * step * apart.max() < 1e-3 * np.ptp(values)
    v = np.abs(fastest.velocity(t))
    top = int(np.argmax(v > 0.999 * v.max()))
    begun = top - int(np.argmax(v[top::-1] < 1e-3 * v.max()))
    ramp = t[top] - t[begun]
    assert 0.9 * ramp < study.rig.plan.ramp < 1.1 * ramp
    assert RAMP_S[0] <= study.rig.plan.ramp <= RAMP_S[1]
    motion = JerkLimited((Move(1.0, 5.0), Move(-0.2, 100.0), Move(0.3, 0.1)), 2e4, -0.1)
    ends = [end for _, end in motion.phases]
    assert motion.displacement(ends) == pytest.approx([1.0, -0.2, 0.3], abs=1e-9)
    assert motion.velocity([end - 1e-9 for end in ends]) == pytest.approx(0.0, abs=1e-4)


def _speeds(motion):
    return motion.velocity(np.linspace(0.0, motion.duration, 20_000))


def test_all_tests_are_touched_at_the_one_contact(study):
    """The law alone, on this rig: no force before the contact of the file's coordinate."""
    if study.item.scene == "air":
        pytest.skip("nothing is touched")
    rig = study.rig
    near = NearContact(4.0 * rig.width, rig.width)
    forces = rig.forces([HiddenPad(study.law, (near,), cells=60)] * len(rig.times))
    for motion, t, force in zip(rig.motions.values(), rig.times, forces, strict=True):
        end = motion.phases[0][1]
        way, force = motion.displacement(t[t <= end]), force[t <= end]
        assert np.all(force[way < rig.contact - 8.0 * rig.width] < 1e-3 * study.peak)
        assert np.all(force[way > max(rig.contact + 8.0 * rig.width, 0.01)] > 0.0)


def test_strengths_are_those_of_the_tests():
    study = made(INDICES["single"])
    (effect,), (factors,) = study.effects, study.strengths
    assert len(factors) == len(study.pad.tests)
    assert len(set(factors)) == len(factors)
    whole = study.forces(unlisted=False)
    bare = study.forces(unlisted=False, effects=False)
    key = kind_of(effect.name).recipe.size
    assert effect.name == "viscous_drag"
    for motion, t, a, b, factor in zip(
        study.rig.motions.values(), study.rig.times, whole, bare, factors, strict=True
    ):
        pressed = (a > 0.05 * study.peak) & (b > 0.05 * study.peak)
        wanted = factor * effect.parameters[key] * motion.velocity(t)
        assert (a - b)[pressed] == pytest.approx(wanted[pressed], abs=1e-3 * study.peak)


def test_a_written_study_reads_back_with_its_truth(tmp_path, monkeypatch):
    monkeypatch.setattr(lifelike, "make_study", lambda seed, index: made(index))
    lifelike.write(SEED, INDICES["single"], tmp_path / "study.csv")
    truth = json.loads((tmp_path / "study.truth.json").read_text())
    (pad,) = read_measurements(tmp_path / "study.csv").pads
    assert [test.force.size for test in pad.tests] == truth["rows"]
    for read, test in zip(pad.tests, made(INDICES["single"]).pad.tests, strict=True):
        assert read.force == pytest.approx(test.force, abs=1e-5)
    assert truth["kind"] == "single"
    assert truth["unlisted"]["kind"]


def _case(kind, names, verdict, effects, **more):
    case = {"kind": kind, "names": names, "kin": {n: [n] for n in names}, "verdict": verdict}
    case |= {"effects": effects, "group": [], "seen": True, "scene": kind}
    return case | {"rig": {"gap_mm": 0.01}, "strata": {}, "seconds": {"diagnose": 1.0}} | more


def test_counts_are_over_what_can_be_seen():
    cases = [
        _case("none", [], "adequate", []),
        _case("none", [], "unexplained", []),
        _case("none", [], "missing_effect", ["inertia"]),
        _case("single", ["friction"], "missing_effect", ["friction", "contact_offset"]),
        _case("single", ["friction"], "missing_effect", ["friction", "inertia"]),
        _case("single", ["friction"], "ambiguous", ["friction"]),
        _case("single", ["friction"], "adequate", [], seen=False),
    ]
    found = lifelike.report(cases)
    rates = {words: (rate["hits"], rate["n"]) for words, rate in found["rates"].items()}
    assert rates["nothing hidden: adequate"] == (1, 3)
    assert rates["nothing hidden: adequate or no name"] == (2, 3)
    assert rates["one effect: named, with further names or without"] == (2, 3)
    assert rates["one effect: named alone"] == (1, 3)
    assert rates["all: a name that is not hidden"] == (2, 6)
    assert found["wrong_names"] == {"inertia": 2}
    assert found["seen"] == 6
