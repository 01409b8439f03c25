"""A first look: what a pad's tests show follows from what they do, and nothing is fitted."""

import json
import subprocess
import sys
from itertools import product

import numpy as np
import pytest
from support.endtoend import undrawn
from typer.testing import CliRunner

from qlvbayes.cli.main import application
from qlvbayes.diagnosis.searchsetup import protocol_of
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.motion import evidence
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.facts import loaded_once
from qlvbayes.pipeline.run import run_study
from qlvbayes.pipeline.steps import Watcher
from qlvbayes.plots.look import plot_look
from qlvbayes.report.firstlook import FirstLook, look_at

STEP = 0.01  # s between readings
NOISE = 0.002  # N


def motion(*strokes, wait=0.0):
    """Times and displacements of strokes (to, speed, hold) after a wait at zero."""
    times, depths = [0.0, *([wait] if wait else [])], [0.0, *([0.0] if wait else [])]
    for target, speed, hold in strokes:
        times.append(times[-1] + abs(target - depths[-1]) / speed)
        depths.append(target)
        if hold:
            times.append(times[-1] + hold)
            depths.append(target)
    time = np.arange(0.0, times[-1], STEP)
    return time, np.interp(time, times, depths)


def force_of(time, depth, seed):
    """An exponential law with one relaxation time of 1 s; a pad that cannot pull."""
    steps = np.diff(np.exp(0.8 * depth) - 1.0, prepend=0.0)
    branch, kept = np.zeros_like(time), np.exp(-STEP / 1.0)
    for k in range(1, time.size):
        branch[k] = kept * branch[k - 1] + steps[k]
    force = np.maximum(0.5 * (0.6 * np.cumsum(steps) + 0.4 * branch), 0.0)
    return force + np.random.default_rng(seed).normal(0.0, NOISE, time.size)


def table(tests, *, pad="P", starts=None):
    """Rows of a tidy file: tests are (time, depth, force) by name."""
    rows = []
    for k, (name, columns) in enumerate(tests.items()):
        start = "" if starts is None else f"{starts[k]:g}"
        rows += [
            f"{pad},{name},{start},{t:.6g},{d:.6f},{f:.6f}"
            for t, d, f in zip(*columns, strict=True)
        ]
    return rows


def write(path, rows):
    """A file of some rows."""
    path.write_text("\n".join(["pad,test,start_s,time_s,displacement_mm,force_N", *rows]) + "\n")
    return path


def pressed(*strokes, seed=0, wait=0.0):
    """Columns of one test."""
    time, depth = motion(*strokes, wait=wait)
    return time, depth, force_of(time, depth, seed)


def seen(tmp_path, tests, *, bonded=False, **more):
    """The first look at one pad, and its experiment."""
    file = write(tmp_path / "p.csv", table(tests, **more))
    experiment = prepare(read_measurements(file).pads[0])
    return look_at(experiment, bonded=bonded), experiment


def answers(look):
    """By the first effect or constant that a part of the model has, or what it is about."""
    return {next(iter((*one.effects, *one.constants, one.about))): one for one in look.shown}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """One test: a press and a hold of 30 s."""
    return seen(tmp_path_factory.mktemp("plain"), {"a": pressed((1.0, 2.0, 30.0))})


@pytest.fixture(scope="module")
def rich(tmp_path_factory):
    """Two speeds, holds at two depths, all the way back, with the clock."""
    tests = {
        "slow": pressed((1.0, 1.0, 10.0), (1.6, 1.0, 10.0), (0.0, 1.0, 5.0), seed=1),
        "fast": pressed((1.6, 10.0, 10.0), (0.0, 10.0, 5.0), seed=2),
    }
    return seen(tmp_path_factory.mktemp("rich"), tests, starts=[0.0, 100.0])


def test_what_shows_follows_from_what_the_tests_do(plain, rich):
    found = answers(plain[0])
    assert found["m"].answer == found["c"].answer == "yes"
    shown = {name for name, one in found.items() if one.answer == "yes"}
    assert shown <= {"m", "c", "inertia", "frame_ringing"}
    assert all(one.remedy for one in found.values() if one.answer != "yes")
    assert "one load" in plain[0].shown[-1].reason
    look, _ = rich
    assert {one.answer for one in look.shown if "inertia" not in one.effects} == {"yes"}
    assert not look.cautions


def test_two_speeds_show_a_drag_and_the_clock_between_tests_must_be_in_the_file(tmp_path, rich):
    for fast, answer in ((3.0, "hardly"), (8.0, "yes")):
        tests = {"a": pressed((1.0, 2.0, 5.0)), "b": pressed((1.0, fast, 5.0))}
        found = answers(seen(tmp_path, tests)[0])
        assert found["viscous_drag"].answer == answer
    assert (found["fluid_leak"].answer, "start_s" in found["fluid_leak"].remedy) == ("hardly", True)
    assert answers(rich[0])["fluid_leak"].answer == "yes"


@pytest.mark.parametrize(("second", "answer"), [(1.1, "hardly"), (1.6, "yes")])
def test_softening_and_a_set_are_told_apart_by_growing_depths(tmp_path, second, answer):
    """One test's second load goes as deep as its first or deeper; two tests show more."""
    strokes = ((1.0, 1.0, 1.0), (0.0, 1.0, 1.0), (second, 1.0, 1.0), (0.0, 1.0, 1.0))
    look, experiment = seen(tmp_path, {"a": pressed(*strokes)})
    found = answers(look)["stress_softening"]
    assert found.answer == answer
    assert loaded_once(experiment) is (answer == "hardly")
    tests = {"a": pressed(*strokes), "b": pressed(*strokes, seed=1)}
    assert answers(seen(tmp_path, tests)[0])["stress_softening"].answer == "yes"


def test_relaxation_is_shown_up_to_the_longest_hold_and_not_without(tmp_path):
    short, long = (
        answers(seen(tmp_path, {"a": pressed((1.0, 2.0, hold))})[0])["c"] for hold in (6.0, 60.0)
    )
    assert "to 6 s (the longest hold): up to 2 relaxation times" in short.reason
    assert "to 60 s (the longest hold): up to 3 relaxation times" in long.reason
    once = answers(seen(tmp_path, {"a": pressed((1.0, 0.2, 0.0))})[0])["c"]
    assert (once.answer, "hold" in once.remedy) == ("no", True)
    several = {"a": pressed((1.0, 0.2, 0.0)), "b": pressed((1.0, 2.0, 0.0))}
    assert answers(seen(tmp_path, several)[0])["c"].answer == "hardly"


def test_what_is_said_not_to_show_is_what_the_diagnosis_does_not_look_for(tmp_path, plain, rich):
    """For every effect of the list, in tests that unload, return, or neither, loose or glued."""
    half = seen(tmp_path, {"a": pressed((1.6, 10.0, 3.0), (0.8, 10.0, 3.0))})
    sparse = seen(tmp_path, {"a": tuple(x[::60] for x in pressed((1.0, 0.2, 5.0)))})
    pairs = list(product((plain, rich, half, sparse), (False, True)))
    for (_, experiment), bonded in pairs:
        protocol = protocol_of(experiment, bonded=bonded)
        look = look_at(experiment, bonded=bonded)
        refused = {name for one in look.shown if one.answer == "no" for name in one.effects}
        named = {name for one in look.shown for name in one.effects}
        blind = {kind.name for kind in EFFECTS if kind.blind(protocol)}
        assert refused == (blind if bonded else blind - {"interface_slip"})  # no matter of tests
        assert named <= {kind.name for kind in EFFECTS}
    assert len(pairs) == 8


def of_a_test_that_begins_in_contact():
    """Readings that begin after the platen has rested at 0.3 mm for a second."""
    time = np.arange(0.0, 4.0, STEP)
    depth = 0.3 + 0.7 * np.clip(time - 1.0, 0.0, 1.0)
    return time, depth, force_of(time, depth, 5)


def test_a_dead_load_cell_a_late_contact_a_tare_and_a_tear_are_told(tmp_path, plain):
    time, depth, force = pressed((1.0, 2.0, 10.0), wait=1.0)
    quiet = np.random.default_rng(3).normal(0.0, NOISE, time.size)
    tests = {
        "dead": (time, depth, quiet),
        "late": (time, depth, force_of(time, np.maximum(depth - 0.3, 0.0), 4)),
        "tare": (time, depth, force + 0.2),
        "in_contact": of_a_test_that_begins_in_contact(),
        "torn": (time, depth, np.where((depth > 0.79) & (time < 1.49), 0.3 * force, force)),
        "good": (time, depth, force),
    }
    cautions = seen(tmp_path, tests)[0].cautions
    said = {name: [text for text in cautions if f"test {name}:" in text] for name in tests}
    assert "never leaves its noise" in said["dead"][0]
    assert "contact_offset" in said["late"][0]
    assert "0.2 N" in said["tare"][0]
    assert "from 0.78 mm on" in said["torn"][0]
    assert not said["good"]
    assert not said["in_contact"]
    assert not plain[0].cautions


def test_a_force_that_lags_is_no_late_contact_and_contacts_are_found_once(tmp_path, monkeypatch):
    tests = {}
    for seed, speed in enumerate((0.5, 4.0, 10.0)):
        time, depth, force = pressed((1.6, speed, 5.0), (0.0, speed, 2.0), wait=1.0, seed=seed)
        tests[f"at_{speed:g}"] = time, depth, np.interp(time - 0.05, time, force)
    found, rises = [], evidence.first_rises
    monkeypatch.setattr(evidence, "first_rises", lambda *a, **k: found.append(a) or rises(*a, **k))
    look, _ = seen(tmp_path, tests)
    assert len(found) == len(tests)
    assert [e.effect for e in look.direct_evidence if e.beyond_doubt] == ["channel_lag"]
    assert look.tests[2].contact.position > 0.3
    assert not any("contact_offset" in text for text in look.cautions)


def test_a_dense_record_is_drawn_with_its_extremes_and_a_lost_reading_crossed_out(tmp_path):
    time = np.arange(0.0, 30.0, 1e-3)
    depth = np.clip(2.0 * time, 0.0, 1.0)
    force = depth + np.random.default_rng(0).normal(0.0, NOISE, time.size)
    force[20_000:20_040] += 0.1  # a knock that lasts: it is no lost reading
    force[5000] = 0.0
    look, experiment = seen(tmp_path, {"a": (time, depth, force)})
    lines = plot_look(experiment)[0].lines
    drawn = lines[0].get_ydata()
    assert drawn.size < time.size / 10
    assert drawn.max() == experiment.trials[0].test.force.max()
    assert look.tests[0].left_out == 1
    (crosses,) = (line for line in lines if line.get_gid() == "left out")
    assert (crosses.get_marker(), *crosses.get_ydata()) == ("x", 0.0)


def look(*words):
    """Run the command, without its picture."""
    with undrawn():
        return CliRunner().invoke(application(["look"]), ["look", *map(str, words)])


def test_the_next_command_says_how_the_specimen_is_held(tmp_path):
    file = write(tmp_path / "glued.csv", table({"a": pressed((1.0, 2.0, 5.0))}))
    for word in ("--bonded", "--loose"):
        said = look(file, word, "--keep-all-readings").output.replace("\n", "")
        assert f"-o glued_results {word} --keep-all-readings" in said


def test_the_command_leaves_numbers_words_and_a_picture(tmp_path):
    tests = {"a": pressed((1.0, 2.0, 5.0)), "b": pressed((1.0, 8.0, 5.0))}
    rows = [*table(tests), *table({"c": pressed((1.0, 2.0, 50.0))}, pad="Q")]
    file = write(tmp_path / "two pads.csv", rows)
    result = look(file, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    left = {path.name for path in (tmp_path / "out").iterdir()}
    assert left == {"look.json", "look_P.png", "look_Q.png"}
    found = FirstLook.read(tmp_path / "out" / "look.json")
    assert [pad.pad for pad in found.pads] == ["P", "Q"]
    assert [one.answer for one in found.between] == ["hardly", "yes"]
    assert found.next == (f"qlvbayes study '{file}' -o 'two pads_results'",)
    assert found.next[0] in result.output.replace("\n", "")
    numbers = json.loads((tmp_path / "out" / "look.json").read_text())
    first = numbers["pads"][0]["tests"][0]
    assert first["depth_mm"] == pytest.approx(1.0)
    assert first["reached_mm_s"] == pytest.approx(2.0, rel=0.01)
    assert [phase["phase"] for phase in first["phases"]] == ["ramp", "hold"]


def test_a_bad_file_does_not_lose_the_others(tmp_path):
    good = write(tmp_path / "good.csv", table({"a": pressed((1.0, 2.0, 5.0))}))
    bad = tmp_path / "bad.csv"
    bad.write_text("time_s,displacement_mm\n0,0\n")
    result = look(bad, good, "-o", tmp_path / "out")
    assert isinstance(result.exception, InputError)
    assert str(bad) in str(result.exception)
    assert (tmp_path / "out" / "look.json").exists()


def test_a_machine_file_that_leaves_something_open_takes_the_answer_of_convert(tmp_path):
    time, depth, force = pressed((1.0, 2.0, 5.0))
    file = tmp_path / "cell.csv"
    rows = [f"{t:.3f},{-d:.5f},{-f:.5f}" for t, d, f in zip(time, depth, force, strict=True)]
    file.write_text("\n".join(["Time,Extension,Load", "(s),(mm),(N)", *rows]) + "\n")
    result = look(file, "-o", tmp_path / "out", "--sign", "both", "--contact", "file")
    assert result.exit_code == 0, result.exception
    found = FirstLook.read(tmp_path / "out" / "look.json")
    assert found.pads[0].tests[0].depth == pytest.approx(1.0)
    assert found.next[0].startswith("qlvbayes look ")
    assert "--sign both --contact file" in found.next[0]


def test_a_look_loads_no_jax_and_jax_is_float64_for_who_imports_it_later(tmp_path):
    file = write(tmp_path / "p.csv", table({"a": pressed((1.0, 2.0, 5.0))}))
    code = (
        "import sys\n"
        f"sys.argv = ['qlvbayes', 'look', {str(file)!r}, '-o', {str(tmp_path / 'out')!r}]\n"
        "from qlvbayes.cli.main import run\n"
        "try:\n    run()\nexcept SystemExit as stop:\n    assert not stop.code\n"
        "print('jax' in sys.modules)\n"
        "import jax.numpy\n"
        "print(jax.numpy.ones(1).dtype)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split()[-2:] == ["False", "float64"]


def test_a_study_shows_it_before_anything_is_fitted(tmp_path):
    class Stopping(Watcher):
        def looked(self, look, figures):
            self.seen = look, figures
            raise KeyboardInterrupt

    watcher = Stopping()
    file = write(tmp_path / "p.csv", table({"a": pressed((1.0, 2.0, 5.0))}))
    with pytest.raises(KeyboardInterrupt):
        run_study(file, tmp_path / "out", watcher=watcher)
    look, figures = watcher.seen
    assert [pad.pad for pad in look.pads] == ["P"]
    assert figures == [tmp_path / "out" / "look_P.png"]
