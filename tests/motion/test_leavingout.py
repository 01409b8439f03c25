"""A force that the user leaves out counts nowhere, the motion under it does; parts are cut out."""

import json
from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.controlled import press_and_pause, record_controlled
from support.endtoend import call
from support.hidden_pads import FEW
from support.solids import made_ready

from qlvbayes import InputError
from qlvbayes.fitting.relaxation import relaxation_report
from qlvbayes.io.data import Pad, Test, read_measurements
from qlvbayes.io.units import PAD
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.choices import Choices
from qlvbayes.model.model import Model
from qlvbayes.motion.facts import covered
from qlvbayes.motion.pad import arguments_of, cut, refuse_unknown
from qlvbayes.simulate import NOISES, TABLE_1, Hold, Move, simulate_test

B = TABLE_1["B"]
NOISE = NOISES["correlated"]
PRESS = (Move(1.6, 1.0), Hold(10.0), Move(0.8, 1.0), Hold(10.0))
DEEPER = (Move(0.6, 1.0), Hold(5.0), Move(1.6, 1.0), Hold(5.0), Move(0.6, 1.0), Hold(10.0))
CYCLES = tuple(Move(depth, 1.0) for _ in range(8) for depth in (1.6, 0.0))
KNOCK = "t:5..7s"


@cache
def pressed(program=PRESS, seed=0):
    """One test at 50 readings a second."""
    found = simulate_test(B, program, NOISE, np.random.default_rng(seed), 50.0)
    return Test("t", "B", found.time, found.displacement, found.force)


def disturbed(test=None, low=5.0, high=7.0, by=lambda t: 3.0 * np.sin(40.0 * t)):
    """The test with another force from ``low`` to ``high`` (s)."""
    test = test or pressed()
    inside = (test.time >= low) & (test.time <= high)
    force = np.where(inside, by(test.time), 0.0) + np.where(inside, 0.0, test.force)
    return replace(test, force=force)


def without_rows(test, low, high):
    kept = (test.time < low) | (test.time > high)
    columns = (test.time, test.displacement, test.force)
    return Test("t", "B", *(column[kept] for column in columns))


prepared = partial(made_ready, all_tests=True)


def same(one, two):
    """Return whether all arrays of two records are equal."""
    pairs = zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True)
    return all(np.array_equal(a, b) for a, b in pairs)


# the force counts nowhere, the motion everywhere


@pytest.mark.parametrize(
    "by",
    [
        lambda t: 3.0 * np.sin(40.0 * t),
        np.zeros_like,  # a tenth of the readings are lost: far beyond the limit for bad ones
        lambda t: 100.0 + np.round(7.0 * t),
    ],
    ids=["knock", "lost", "steps"],
)
@pytest.mark.parametrize("how", [(KNOCK,), ("t:hold",), "column"])
@pytest.mark.few(3)  # each once
def test_nothing_depends_on_a_force_that_is_left_out(by, how):
    tests = [pressed(), disturbed(by=by)]
    if how == "column":
        used = (tests[0].time < 5.0) | (tests[0].time > 7.0)
        tests, how = [replace(test, used=used) for test in tests], ()
    sound, bad = (prepared(test, leave_out=how) for test in tests)
    assert bad.floor.total == sound.floor.total
    assert bad.scales == sound.scales
    assert same(bad.record(bad.trials), sound.record(sound.trials))
    assert [n for n in bad.notices if "bad" in n] == []


def test_the_motion_and_its_phases_are_those_of_all_readings():
    every, some = prepared(pressed()), prepared(disturbed(), leave_out=[KNOCK])
    (one,), (two,) = every.trials, some.trials
    assert two.phases == one.phases
    time = np.linspace(0.0, 22.4, 5000)
    assert np.array_equal(two.trajectory.displacement(time), one.trajectory.displacement(time))
    assert np.array_equal(two.whole.time, one.test.time)
    assert np.setdiff1d(one.test.time, two.test.time).tolist() == two.left_out.time.tolist()
    assert two.left_out.count == 101


def modelled(experiment, since):
    """Times after ``since``, and the model's force there."""
    (trial,) = experiment.trials
    rows = np.flatnonzero(trial.test.time > since)[::20]
    record = experiment.reduced(trial, rows)
    model = Model(Exponential(B.m, B.b), Prony(jnp.array(B.c), jnp.array(B.v)), False)
    return trial.test.time[rows], record.average(model.force(record.motion))


def test_what_was_done_to_the_specimen_meanwhile_is_remembered():
    """Deeper and back between 5.6 and 12.6 s: without these rows it would be a hold."""
    gap = ["t:5.7..13s"]
    time, every = modelled(prepared(pressed(DEEPER)), 13.2)
    for leave_out in (gap, ["t:..13s"]):  # at the beginning as in the middle
        again, some = modelled(prepared(pressed(DEEPER), leave_out=leave_out), 13.2)
        assert np.array_equal(again, time)
        np.testing.assert_allclose(some, every, rtol=0, atol=2e-6)
    absent, forgotten = modelled(prepared(without_rows(pressed(DEEPER), 5.7, 13.0)), 13.2)
    assert np.max(np.abs(np.interp(time, absent, forgotten) - every)) > 0.02


def test_the_next_test_remembers_it_too():
    first = replace(pressed(), name="first", start_known=True)
    second = replace(pressed(seed=1), name="second", start_s=25.0, start_known=True)
    every = prepared(first, second)
    some = prepared(first, second, leave_out=["first:12..22.4s", "second:..0.3s"])
    pasts = [experiment.past(experiment.trials[1]) for experiment in (every, some)]
    for name in ("time", "displacement", "ago"):
        assert np.array_equal(*(getattr(past, name) for past in pasts))
    assert every.clock_zero == some.clock_zero
    assert every.scales.clock == some.scales.clock


def test_a_bad_reading_of_what_is_left_is_still_found():
    test = disturbed()
    force, way = test.force.copy(), test.displacement.copy()
    force[200], way[300] = 9.99, 0.0  # at 4 s, and at 6 s in what is left out
    found = prepared(replace(test, force=force, displacement=way), leave_out=[KNOCK]).notices
    assert "two readings are left out" in found[1]


def test_the_floor_of_equal_cycles_does_without_the_first():
    """0.01 N were simulated."""
    some = prepared(pressed(CYCLES), leave_out=["t:ramp 1", "t:unload 1"]).floor
    assert "what does not repeat from one cycle to the next" in some.notices[0]
    assert some.total == pytest.approx(0.01, rel=0.2)


def test_a_force_that_is_held_is_seen_without_the_readings_left_out():
    program = press_and_pause(1.0, 1.0, 10.0)
    found, _ = record_controlled(B, program, NOISE, np.random.default_rng(0), 50.0, False)
    test = Test("t", "B", found.time, found.displacement, found.force)
    (every,), (some,) = (
        prepared(one, leave_out=leave_out).trials
        for one, leave_out in ((test, ()), (disturbed(test), [KNOCK]))
    )
    assert [phase.control for phase in every.phases] == ["displacement", "force", "displacement"]
    assert [(p.kind, p.control) for p in some.phases] == [(p.kind, p.control) for p in every.phases]
    for one, two in zip(every.phases, some.phases, strict=True):
        assert (two.start, two.stop) == pytest.approx((one.start, one.stop), abs=0.1)


# which readings


@pytest.mark.parametrize(
    ("text", "spans"),
    [("t:5..7s", "5 to 7 s"), ("B/t:5000..7000 ms", "5 to 7 s"), ("t:20..s", "20 to 22.4 s"),
     ("t:hold 1", "1.62 to 11.6 s"), ("t:unloading", "11.62 to 12.4 s"),
     ("t:0..100um", "0 to 0.1 s"), ("t:1.2..1.5mm", "1.2 to 1.5 s and 11.72 to 12 s")],
)  # fmt: skip
def test_a_part_is_a_time_a_displacement_or_a_phase(text, spans):
    (notice,) = prepared(pressed(), leave_out=[text]).notices
    assert f"({spans}), as stated by --leave-out {text};" in notice


@pytest.mark.parametrize(
    ("text", "what"),
    [("t:20s..", "is no part of a test; write --leave-out 'TEST:30"),
     ("t:hold 3", "has no such phase; name one of ramp 1, hold 1, unload 1, recovery 1"),
     ("t:90..95s", "has no reading there"),
     ("t:0..22.3s", "5 are left, and at least 10 are needed; leave out less")],
)  # fmt: skip
def test_what_leaves_nothing_or_leaves_nothing_out_is_refused(text, what):
    with pytest.raises(InputError, match=what):
        prepared(pressed(), leave_out=[text])


def test_an_unknown_test_is_refused_and_what_was_said_is_said_on():
    pads = [Pad("B", (pressed(),), PAD)]
    with pytest.raises(InputError, match="--leave-out: no test 'push'; name one of t"):
        refuse_unknown(pads, [], ["push:hold 1"])
    assert arguments_of(pads, ["t:..20s", "u:..1s"], ["B/t:hold"]) == [
        "--use", "t:..20s", "--leave-out", "B/t:hold",
    ]  # fmt: skip


def test_times_are_those_of_the_file_also_where_the_beginning_is_cut():
    one = prepared(disturbed(), use=["t:1..20s"], leave_out=[KNOCK])
    (trial,) = one.trials
    assert trial.left_out.count == 101
    assert (trial.left_out.time[0], trial.left_out.time[-1]) == pytest.approx((4.0, 6.0))
    assert np.abs(trial.test.force).max() < 1.0


def test_of_a_test_of_phases_only_those_that_are_used_count():
    every = prepared(pressed())
    some = prepared(pressed(), leave_out=["t:hold", "t:recovery"])
    assert [phase.kind for phase in some.trials[0].used_phases] == ["ramp", "unload"]
    assert covered(every).hold == pytest.approx(10.0, abs=0.02)
    assert covered(some).hold == pytest.approx(1.6, abs=0.02)
    slow = replace(pressed((Move(1.6, 0.2), *PRESS[1:])), name="slow")
    assert covered(prepared(pressed(), slow)).slowest == pytest.approx(0.2, rel=0.01)
    fast = covered(prepared(pressed(), slow, leave_out=["slow:ramp"]))
    assert fast.slowest == pytest.approx(1.0, rel=0.01)
    assert relaxation_report(every) is not None
    for leave_out in ("t:1.4..1.8s", "t:hold"):  # the initial force, or all that follows it
        assert relaxation_report(prepared(pressed(), leave_out=[leave_out])) is None


# a user sees it


def written(folder, *tests, marked=False):
    rows = []
    for test in tests:
        for t, d, f in zip(test.time, test.displacement, test.force, strict=True):
            use = f",{'no' if marked and 5.0 <= t <= 7.0 else 'yes'}" if marked else ""
            rows.append(f"{test.name},{t:.4f},{d:.5f},{f:.6f}{use}")
    file = folder / "pads.csv"
    head = "test,time_s,displacement_mm,force_N" + (",use" if marked else "")
    file.write_text("\n".join([head, *rows]) + "\n")
    return file


def notices(file):
    return " ".join(json.loads(file.read_text())["notices"])


@pytest.mark.slow
def test_a_fit_and_its_check_do_without_and_say_so(tmp_path):
    file, out = written(tmp_path, disturbed()), tmp_path / "out"
    chosen = ("--method", "least-squares", "--leave-out", KNOCK)
    assert call("fit", file, "-o", out, *chosen)[0] == 0
    status, printed, error = call("check", out, "--json")
    assert status == 0, error
    (found,) = json.loads(printed)
    hold = next(cell for cell in found["cells"] if cell["phase"] == "hold")
    assert hold["rmse_N"] < 0.1  # the knock is 3 N
    said = f"101 readings is left out (5 to 7 s), as stated by --leave-out {KNOCK}"
    for name in ("summary.json", "check.json"):
        assert said in notices(out / "pad" / name)
    (test,) = json.loads((out / "pad" / "curves.json").read_text())["tests"]
    assert {one["kind"] for one in test["left_out"]} == {"excluded"}
    assert len(test["left_out"]) <= 50


@pytest.mark.slow
def test_a_diagnosis_without_a_phase(tmp_path, monkeypatch):
    """The one test's held-out parts, cells and remainder are of the other phases."""
    monkeypatch.setattr(Choices, "candidates", FEW)
    bad = disturbed(low=1.7, high=11.5)
    file, out = written(tmp_path, bad), tmp_path / "out"
    status, printed, error = call("diagnose", file, "-o", out, "--leave-out", "t:hold", "--json")
    assert status == 0, error
    (found,) = json.loads(printed)
    assert found["verdict"] in ("adequate", "ambiguous")
    assert found["steps"][-1]["rmse_N"] < 0.02
    assert "as stated by --leave-out t:hold" in notices(out / "pad" / "diagnosis.json")


# the column


@pytest.mark.parametrize(
    ("yes", "no"),
    [("1", "0"), ("yes", "no"), ("True", "False"), ("TRUE", "no"), ("1", "1"), ("", "")],
)
def test_the_column_says_it_in_words_or_numbers_or_nothing(tmp_path, yes, no):
    file = written(tmp_path, disturbed(), marked=True)
    file.write_text(file.read_text().replace(",yes\n", f",{yes}\n").replace(",no\n", f",{no}\n"))
    study = read_measurements(file)
    (test,) = study.pads[0].tests
    assert study.notices == ()
    if yes == no:
        assert test.used is None
    else:
        assert np.array_equal(test.used, (test.time < 5.0) | (test.time > 7.0))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (",no\n", ",maybe\n", "line 252: use 'maybe' is unknown in test 't' .*; write 1, "),
        (",no\n", ",\n", "line 252: use is empty in test 't' of pad 'pad'; write 1, yes, true"),
        (",yes\n", ",no\n", "line 2: test 't' .* has 0 rows to use, .*; write 1 in more"),
    ],
)
def test_a_bad_column_is_refused_with_its_line(tmp_path, old, new, message):
    file = written(tmp_path, pressed(), marked=True)
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        read_measurements(file)


def test_a_code_for_no_reading_may_stand_where_the_force_is_not_used(tmp_path):
    lost = disturbed(by=lambda t: np.full_like(t, -999.0))
    (test,) = read_measurements(written(tmp_path, lost, marked=True)).pads[0].tests
    assert test.force.min() == -999.0
    with pytest.raises(InputError, match="-999, a code for no reading"):
        read_measurements(written(tmp_path, lost))


def pulled():
    time = np.arange(0.0, 40.0, 0.1)
    return Pad("strip", (Test("pull", "strip", time, 1.0 * time, np.sqrt(time)),), PAD)


def test_a_part_of_a_test_is_used_and_told():
    pad, notices = cut(pulled(), ["pull:0..18mm"])
    (test,) = pad.tests
    assert (test.time[0], test.displacement[-1]) == (0.0, pytest.approx(18.0))
    told = "181 rows are used, as stated by pull:0..18mm, and 219 left out"
    assert notices == (f"pad strip: of test pull {told}",)
    (late,) = cut(pulled(), ["strip/pull:5..9 s"])[0].tests
    assert (late.time[0], late.displacement[0], late.start_s) == (0.0, 5.0, 5.0)
    assert cut(pulled(), [])[1] == ()
    with pytest.raises(InputError, match="leaves fewer than 10 rows"):
        cut(pulled(), ["pull:0..0.5mm"])
    with pytest.raises(InputError, match="is no part of a test"):
        cut(pulled(), ["pull 0 to 18"])
