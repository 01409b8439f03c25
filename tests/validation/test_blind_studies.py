"""The wide population: balance, determinism, simulator's additions, the count, registration."""

from dataclasses import replace

import numpy as np
import pytest
import registration
from blind.catalogue import FOREIGN, FURTHER
from blind.counting import Rate, is_grouped, is_named, lower, names_kin, names_wrongly, upper
from blind.disturbed import RECORDS, unequal_holds
from blind.laws import ELASTIC, RELAXATION, Law, draw_law
from blind.loadcell import CELLS, LoadCell, draw_cell
from blind.population import Population, kin
from blind.programmes import session, sine, swing
from blind.study import _disturbed, make_study
from blind.visible import visible
from registration import Registration
from runs import read_cases
from scipy.integrate import solve_ivp

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.simulate import (
    HiddenPad,
    Hold,
    Move,
    Platen,
)
from qlvbayes.simulate.motion import Piece, Track

LAW = Law("exponential", (0.5, 0.8), "prony:2", (0.4, 6.0, 0.2, 0.2))


def test_the_population_repeats_and_kinds_hide_what_they_say():
    items = [Population(1).item(k) for k in range(60)]
    assert items == [Population(1).item(k) for k in range(60)]
    assert items != [Population(2).item(k) for k in range(60)]
    for item in items:
        listed = [name for name in item.names if name in kin(name)]
        want = {"none": (0, 0), "single": (1, 1), "double": (2, 2), "form": (1, 0)}
        want |= {"outside": (1, 0), "outside_beside": (2, 1)}
        assert (len(item.names), len(listed)) == want[item.levels["kind"]]


def test_a_registered_run_makes_its_old_studies_again():
    registered = Registration.read("support")
    cases = read_cases("support")
    for case in cases:
        item = registered.population.item(case["index"])
        assert [*item.names] == case["names"], "what is hidden is drawn from the lists of that time"
        assert item.levels == case["strata"]
    quickest = min(cases, key=lambda case: case["seconds"]["simulate"])
    # to the last digits, in which libraries of mathematics differ
    peak = make_study(registered.population, quickest["index"]).peak
    assert peak == pytest.approx(quickest["peak_N"], rel=1e-14)


def test_a_new_registration_has_disturbed_records_and_an_old_one_none(monkeypatch):
    monkeypatch.setattr(registration, "code_digest", lambda: "this")  # the package is not parsed
    new = Registration.of_present("some", 1, 5)
    assert new.population == Population(1, disturbed=True)
    later = replace(new, lists=new.lists | {"forms": new.lists["forms"][:-1]})
    assert later.population.key != new.population.key
    assert new.strata["record"] == list(RECORDS)
    assert not new.broken()
    old = Registration.read("bounds")
    assert "record" not in old.strata
    assert "the strata" not in old.broken()


def first_of(population, wanted):
    """Index of the first study of these levels."""
    items = map(population.item, range(20_000))
    return next(i.index for i in items if wanted.items() <= i.levels.items())


def test_noise_that_changes_changes_the_noise_alone():
    """Forces of a study with and without it differ by the noise times the factor less one."""
    wanted = {"protocol": "three_tests", "logger": "thinned", "history": "rested"}
    wanted |= {"record": "changing_noise"}
    own_population = Population(0, disturbed=True)
    index = first_of(own_population, wanted)
    plain, own = make_study(Population(0), index), make_study(own_population, index)
    assert own.peak == plain.peak
    motions = own.session.motions.values()
    for one, two, time, motion in zip(
        plain.pad.tests, own.pad.tests, own.times, motions, strict=True
    ):
        np.testing.assert_array_equal(one.displacement, two.displacement)
        more = own.gain.at(time, motion.duration) - 1.0
        changed = np.abs(two.force - one.force)
        assert np.all(changed[more == 0.0] == 0.0)
        large, small = more > 0.5 * more.max(), more < 0.05 * more.max()
        if small.any():
            assert np.mean(changed[large] ** 2) > 9.0 * np.mean(changed[small] ** 2)


def test_late_starts_and_lost_readings():
    time = np.arange(0.0, 10.0, 0.01)
    way = np.minimum(time, 1.6)
    one = Test("a", "p", time, way, 2.0 * way, start_s=50.0)
    pad, times = Pad("p", (one,) * 20, PAD), (time,) * 20
    kept, late = _disturbed("late_start", times, pad, np.random.default_rng(0))
    begun = [test.start_s - 50.0 for test in late.tests]
    assert 4 <= sum(start > 0.0 for start in begun) <= 16
    assert all(start < 0.5 * 1.6 for start in begun)
    for test, clock, start in zip(late.tests, kept, begun, strict=True):
        assert test.time[0] == 0.0
        assert test.displacement[0] == pytest.approx(start)
        assert np.allclose(clock, test.time + start)
    one = Test("a", "p", time, 1.0 + time, 2.0 + time)
    pad = Pad("p", (one,) * 20, PAD)
    _, found = _disturbed("lost_readings", times, pad, np.random.default_rng(0))
    for test in found.tests:
        lost = [np.count_nonzero(x == 0.0) for x in (test.displacement, test.force)]
        assert min(lost) == 0 < max(lost) <= 0.01 * time.size
    assert _disturbed("plain", times, pad, np.random.default_rng(0)) == (times, pad)


def test_unequal_holds_change_rests_alone():
    plan = session("staircase", False, 30.0, 3e-4, np.random.default_rng(1))
    own = unequal_holds(plan, np.random.default_rng(2))
    same = [a.duration == b.duration for a, b in zip(*both(plan, own), strict=True)]
    assert sum(same) == 1
    for one, two in zip(*both(plan, own), strict=True):
        assert two.duration <= one.duration
        assert one.displacement(one.duration) == pytest.approx(
            two.displacement(two.duration), abs=2e-3
        )
        speeds = [max(abs(p.velocity) for p in m.pieces) for m in (one, two)]
        assert speeds[0] == speeds[1]
    starts = [motion.start_s for motion in own.motions.values()]
    assert np.all(np.diff(starts) > own.pause)


@pytest.mark.slow
def test_a_held_force_stays_while_the_platen_goes_on():
    """The force of a path that is found is solved finer along that path, and again by its rest."""
    wanted = {"protocol": "paper", "logger": "uniform"}
    wanted |= {"record": "held_force", "history": "rested", "kind": "none"}
    population = Population(0, disturbed=True)
    index = first_of(population, wanted)
    plain, own = make_study(Population(0), index), make_study(population, index)
    held = 0
    for one, two in zip(*both(plain.session, own.session), strict=True):
        if one.duration == two.duration and len(one.pieces) == len(two.pieces):
            continue  # this test has none
        held += 1
        rest = next(p for p in one.pieces if p.duration > 5.0 and abs(p.velocity) < 1e-3)
        times = rest.start + rest.duration * np.linspace(0.02, 0.999, 200)
        finer = replace(own.material(own.law, ()), cells=600)
        force = finer.force(two, times)
        assert np.ptp(force) < 0.006 * force.mean()  # straight between its moments
        assert np.ptp(finer.force(one, times)) > 0.02 * force.mean()
        way = two.displacement(times)
        assert np.all(np.diff(way) > 0.0)
        assert way[-1] - way[0] > 0.02
    assert 1 <= held <= 6


def both(one, two):
    return one.motions.values(), two.motions.values()


def test_sines_swings_and_creeping_holds():
    track = sine(1.6, 0.5, 3)
    t = np.linspace(0.0, track.duration, 5000, endpoint=False)
    turn = 2.0 * np.pi * 0.5
    speed = 0.8 * turn
    assert np.abs(track.displacement(t) - 0.8 * (1 - np.cos(turn * t))).max() < 1e-3 * 1.6
    assert np.abs(track.velocity(t) - speed * np.sin(turn * t)).max() < 2e-3 * speed
    assert (
        np.abs(track.acceleration(t) - speed * turn * np.cos(turn * t)).max() < 0.06 * speed * turn
    )
    pieces = swing(-0.7, 3.0)
    assert pieces[-1].end == pytest.approx(-0.7, rel=1e-12)
    assert min(p.velocity for p in pieces) == pytest.approx(-3.0)
    with pytest.raises(InputError, match="gap"):
        Track((Piece(0.0, 1.0, 0.0, 1.0, 0.0), Piece(1.0, 1.0, 0.0, 0.0, 0.0)))
    platen = Platen((Move(1.0, 10.0), Hold(5.0, creep=3e-4)))
    assert platen.displacement(platen.duration) == pytest.approx(1.0003, abs=1e-12)


@pytest.mark.parametrize("relaxation", RELAXATION)
def test_modes_carry_the_closed_form(relaxation):
    law = draw_law("hertz", relaxation, np.random.default_rng(2), 1.6)
    t = np.append(0.0, np.logspace(-3.0, 3.0, 300))
    modes = law.c[0] + np.exp(-np.outer(t, law.v)) @ np.array(law.c[1:])
    assert sum(law.c) == pytest.approx(1.0)
    assert np.abs(modes - law.fade(t)).max() < 2e-3


@pytest.mark.parametrize("elastic", ELASTIC)
@pytest.mark.few(2)
def test_a_held_pad_falls_like_its_relaxation(elastic):
    """After a ramp of 16 ms the force at t is between g(t) and g(t - 16 ms) of the elastic one."""
    law = draw_law(elastic, "prony:3", np.random.default_rng(1), 1.6)
    platen = Platen((Move(1.6, 1e4), Hold(10.0)), acceleration_limit=1e6)
    t = np.linspace(0.1, 10.0, 40)
    whole = law.force(np.array([1.6]))
    force = HiddenPad(law).force(platen, t)
    assert np.all(force >= whole * law.fade(t) * (1 - 1e-9))
    assert np.all(force <= whole * law.fade(t - 0.016) * (1 + 1e-9))


def test_a_carried_test_remembers_and_a_long_pause_forgets():
    rng = np.random.default_rng(0)
    near, far = session("paper", True, 10.0, 0.0, rng), session("paper", False, 10.0, 0.0, rng)
    pad = HiddenPad(LAW, cells=60)
    second = list(near.motions.values())[1]
    t = np.array([second.duration])
    rested = pad.force(list(far.motions.values())[1], t)
    carried = pad.force(near.whole, t + second.start_s)
    slow = 0.2 * np.exp(-0.2 * second.duration)  # what the slow mode still can hold of it
    assert 0.0 < abs(carried - rested) < slow * LAW.force(np.array([1.6]))


@pytest.mark.parametrize("kind", CELLS)
def test_errors_have_the_covariance_that_is_stated(kind):
    rng = np.random.default_rng(5)
    cell = draw_cell(kind, 1.0, 30.0, rng)
    t = np.array([0.0, 0.001, 0.01, 0.5])
    # one walk of 20 000 stretches: the longest memory is 7.5 s, of which e^-133 are left
    apart = np.arange(20_000)[:, None] * 1000.0
    draws = cell.draw((apart + t).ravel(), rng).reshape(apart.size, t.size)
    zero = np.zeros(4)
    wanted = cell.covariance(t, zero, zero, zero, 1.0) - cell.step**2 / 12.0 * np.eye(4)
    scale = wanted[0, 0] + 1e-30
    # the standard error of a covariance of normals is at most sqrt(2 / n) of the variance
    assert np.abs(np.cov(draws.T) - wanted).max() <= 5.0 * np.sqrt(2.0 / 20_000) * scale


def test_readings_are_steps_and_errors_grow_with_force():
    cell = LoadCell(growth=3.0, step=0.01)
    reading = cell.read(np.linspace(0.0, 1.0, 50), np.zeros(50), 1.0)
    np.testing.assert_allclose(reading / 0.01, np.round(reading / 0.01), atol=1e-9)
    assert LoadCell(growth=3.0).read(np.array([1.0]), np.array([0.01]), 1.0) == pytest.approx(1.04)


NEW = {**FOREIGN, **FURTHER}
VALUES = {
    "cavitating_film": (1e-3, 2.5, 0.02), "poroelastic_diffusion": (0.2, 3.0),
    "tilted_platen": (0.3,), "root_leak": (0.01,), "one_way_friction": (0.05, 0.05),
    "healing_softening": (0.4, 1.0), "viscous_heating": (0.3, 2.0, 5.0), "backlash": (0.05,),
    "drive_ripple": (0.05, 0.4), "load_cell_creep": (0.2, 10.0), "stick_slip": (0.05, 0.2),
    "snap_through": (0.05, 1.0), "thixotropy": (0.2, 5.0, 0.5), "curing": (0.3, 40.0, 10.0),
    "ringing": (0.05, 10.0, 0.3), "bubble": (0.02, 2.5, 20.0), "mains_hum": (0.05, 50.01, 1.0),
    "cracking_skin": (0.05, 1.6, 1.0, 3), "rolling_specimen": (0.1, 1.6, 3),
    "swelling": (0.3, 100.0, 5.0, 1.6), "drive_warmth": (0.1, 1.6, 10.0),
}  # fmt: skip


@pytest.mark.parametrize("name", NEW)
@pytest.mark.few(7)
def test_new_effects_vanish_at_their_null(name):
    program = (Move(1.6, 20.0), Hold(3.0), Move(0.4, 5.0), Hold(3.0))
    platen = Platen(program, start_s=50.0)
    t = np.linspace(0.0, platen.duration, 300)
    plain = HiddenPad(LAW, cells=90).force(platen, t)
    null = NEW[name](0.0, *VALUES[name][1:])
    there = NEW[name](*VALUES[name])
    assert np.abs(HiddenPad(LAW, (null,), cells=90).force(platen, t) - plain).max() < 1e-8
    assert np.abs(HiddenPad(LAW, (there,), cells=90).force(platen, t) - plain).max() > 5e-3


def test_gas_dissolves_as_its_equation_says():
    """n' = n (1 - n q) / time, by a general solver along a press and a hold."""
    platen = Platen((Move(1.6, 20.0), Hold(10.0)))
    times = np.linspace(0.0, platen.duration, 200)

    def squeezed(t):
        return (1.0 - platen.displacement(np.array([t]))[0] / 2.5) ** -1.4

    gas = solve_ivp(
        lambda t, n: n * (1.0 - n * squeezed(t)) / 4.0, (0.0, platen.duration), [1.0], "LSODA",
        times, rtol=1e-9, atol=1e-12, max_step=0.01,
    ).y[0]  # fmt: skip
    added = HiddenPad(LAW, (FURTHER["bubble"](0.05, 2.5, 4.0),)).force(platen, times)
    added -= HiddenPad(LAW).force(platen, times)
    expected = 0.05 * (gas * np.array([squeezed(t) for t in times]) - 1.0)
    assert added == pytest.approx(expected, abs=1e-6)


@pytest.mark.slow
def test_the_effect_of_a_study_counts():
    """The first study with one listed effect, three tests and a thinned record."""
    wanted = {"logger": "thinned", "history": "rested", "kind": "single", "protocol": "three_tests"}
    index = first_of(Population(0), wanted)
    study = make_study(Population(0), index)
    assert set(visible(study)) == set(study.item.names)


def case(kind="single", names=("friction",), verdict="missing_effect", effects=(), group=()):
    return {
        "kind": kind, "names": list(names), "kin": {n: sorted(kin(n)) for n in names},
        "verdict": verdict, "effects": list(effects), "group": list(group), "seen": True,
    }  # fmt: skip


def test_what_is_named_and_grouped_and_a_form_may_be_called_by_its_family():
    assert is_named(case(effects=("friction",)))
    assert not is_named(case(effects=("friction", "inertia")))
    assert not is_named(case(verdict="ambiguous", effects=("friction",)))
    assert is_named(case("none", (), "adequate"))
    assert is_named(case("outside", ("slip",), "unexplained"))
    hidden = ("slip", "friction")
    assert is_named(case("outside_beside", hidden, "partly_explained", ("friction",)))
    assert not is_named(case("outside_beside", hidden, "unexplained"))

    def ambiguous(*group):
        return case(verdict="ambiguous", effects=("inertia",), group=group)

    assert is_grouped(ambiguous("inertia", "friction"))
    assert not is_grouped(ambiguous("inertia", "adhesion"))
    assert not is_grouped(ambiguous("inertia", "friction", "adhesion", "channel_lag"))
    wrong = case(effects=("inertia",), group=("friction",))
    assert not is_grouped(wrong | {"not_ruled_out": [["inertia"], ["friction"]]})
    assert names_wrongly(wrong)
    assert not is_grouped(case("none", (), "ambiguous", ("inertia",), ("inertia",)))
    assert names_kin(case("form", ("root_leak",), effects=("fluid_leak",)))
    assert not names_kin(case("form", ("root_leak",), effects=("fluid_leak", "inertia")))
    assert not names_wrongly(case("form", ("root_leak",), effects=("fluid_leak",)))


def test_the_rigs_gap_and_a_mode_that_the_law_lacks_are_neither_wanted_nor_wrong():
    rig, gap = {"rig": {"gap_mm": 0.01}}, "contact_offset"
    assert is_named(case(effects=("friction", gap)) | rig)
    assert not is_named(case(effects=(gap,)) | rig)
    assert not names_wrongly(case(effects=(gap,)) | rig)
    assert is_named(case("none", (), effects=(gap,)) | rig)
    assert not is_named(case("none", (), effects=(gap, "friction")) | rig)
    assert is_named(case("outside", ("slip",), "partly_explained", (gap,)) | rig)
    assert names_wrongly(case(effects=("friction", gap)))  # where there is none
    assert not is_named(case(names=(gap,), effects=()) | rig)  # hidden, it is wanted
    rivals = case(verdict="ambiguous", effects=(gap, "inertia"), group=("inertia", "friction"))
    assert is_grouped(rivals | rig)

    def on_laws(true, base, *effects):
        laws = {"strata": {"relaxation": true}, "base": {"relaxation": base}}
        return case("none", (), effects=effects) | laws

    mode = "extra_relaxation_mode"
    assert is_named(on_laws("prony:3", "prony:2", mode))
    assert not is_named(on_laws("prony:3", "prony:2", mode, "friction"))
    assert not is_named(on_laws("prony:2", "prony:2", mode))
    assert not is_named(on_laws("prony:3", "fung", mode))
    assert not is_named(on_laws("fung", "prony:2", mode))


def test_bounds_are_those_of_clopper_and_pearson():
    """Without a hit in n the bound is p with (1 - p)^n = 0.05; with all hits it is its mirror."""
    assert upper(Rate(0, 30)) == pytest.approx(1.0 - 0.05 ** (1 / 30))
    assert lower(Rate(30, 30)) == pytest.approx(0.05 ** (1 / 30))
    assert lower(Rate(0, 30)) == 0.0
    assert upper(Rate(30, 30)) == 1.0


def test_a_run_under_other_code_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(registration, "FOLDER", tmp_path)
    monkeypatch.setattr(registration, "code_digest", lambda: "this")
    registered = Registration.of_present("a", 1, 10)
    registered.write()
    assert Registration.read("a") == registered
    assert not Registration.read("a").broken()
    with pytest.raises(FileExistsError):
        registered.write()
    monkeypatch.setattr(registration, "code_digest", lambda: "other")
    monkeypatch.setattr(registration, "rules_digest", lambda: "other")
    assert registered.broken() == ["the code", "the rules of the count"]
    assert registered.broken(finished=True) == ["the rules of the count"]
