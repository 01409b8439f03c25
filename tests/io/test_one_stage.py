"""Files of one pad on one stage: one contact, told where files disagree; our own and those kept."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_files import Pressed
from support.stages import film_press, stage, written

from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import convert
from qlvbayes.io.loading import Answers

ONE = Answers.from_words(pads=("P",))


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("contact", "speeds", "press"),
    [(12.4, (0.5, 2.0, 10.0, 30.0), {"step": 0.01}),
     (4.1, (10.0, 1.0, 3.0), {"eta": 0.012, "noise": 0.001}),
     (7.0, (2.0, 1.0), {"eta": 0.012, "power": 1.5, "step": 0.01}),
     (20.0, (5.0, 0.5, 2.0, 1.0, 20.0), {"eta": 0.0, "power": 2.0, "noise": 0.005})],
)  # fmt: skip
@pytest.mark.few(3)
def test_files_of_a_stage_have_one_contact_within_its_error(contact, speeds, press, way, tmp_path):
    """Three stated errors: of eight cases none is beyond them but for a chance of 2 %."""
    files = stage(tmp_path, contact, speeds, way=way, **press)
    tests = convert(files, ONE).tests
    (zero,) = {test.zero for test in tests}
    (sd,) = {test.zero_sd for test in tests}
    (label,) = {test.contact_stage for test in tests}
    assert abs(zero - contact) < 3.0 * sd
    assert sd < 0.08
    assert float(label) == pytest.approx(way * zero, rel=1e-5)
    if way > 0.0:  # the order of the files does not matter
        (other,) = {test.zero for test in convert(files[::-1], ONE).tests}
        assert other == pytest.approx(zero, abs=1e-9)


def test_quick_presses_that_start_at_contact_are_read_with_the_slow_ones(tmp_path):
    """At 40 mm/s a press has four rows: with drag it shows no contact of its own."""
    rng = np.random.default_rng(4)
    files = []
    for speed in (0.2, 1.0, 5.0, 15.0, 40.0):
        ends = np.cumsum([0.5, 1.6 / speed, 20.0, 0.8, 15.0])
        time = np.arange(0.0, ends[-1], 0.01)
        way = np.interp(time, [0.0, *ends], [0.0, 0.0, 1.6, 1.6, 0.8, 0.8])
        load = 0.35 / 1.1 * np.expm1(1.1 * way) + 0.016 * np.gradient(way, time) * way / 1.6
        load += rng.normal(0.0, 0.008, len(time))
        way = way + rng.normal(0.0, 0.0005, len(time))
        files.append(written(tmp_path, f"at_{speed:g}", Pressed(time, way, load), 0.0))
    tests = convert(files, ONE).tests
    assert len(tests) == 5
    assert all(abs(test.zero) < 0.1 for test in tests)


def test_contacts_that_differ_stay_apart_and_are_told_with_the_option(tmp_path):
    files = stage(tmp_path, 7.0, (0.5, 1.0, 2.0))
    alone = {test.test: test.zero for test in convert(files, ONE).tests}
    moved = [
        written(tmp_path, f"moved_{k}", film_press(speed, 9 + k), 7.6)
        for k, speed in enumerate((1.0, 2.0))
    ]
    found = {test.test: test for test in convert([*moved, *files], ONE).tests}
    assert {name: found[name].zero for name in alone} == alone  # others do not move them
    (other,) = {found[path.stem].zero for path in moved}
    assert abs(other - 7.6) < 3.0 * found["moved_0"].zero_sd
    assert len({test.contact_stage for test in found.values()}) == 2
    said = " ".join(found["moved_0"].findings)
    assert "doubt: the pad's 3 other files have it at 7.0" in said or "at 6.99" in said
    assert f"--contact {alone['at_1']:.6g}" in said
    assert not any("doubt" in line for name in alone for line in found[name].findings)


def test_a_lag_of_the_force_moves_the_contact_of_no_file(tmp_path):
    """The onset of the quickest press is late by 0.3 mm, which the slower ones foretell."""
    files = []
    for seed, speed in enumerate((0.1, 0.5, 3.0, 10.0, 15.0)):
        press = film_press(speed, seed, eta=0.0)
        load = np.interp(press.time - 0.02, press.time, press.load)
        files.append(written(tmp_path, f"at_{speed:g}", replace(press, load=load), 3.0))
    tests = convert(files, ONE).tests
    (zero,) = {test.zero for test in tests}
    (sd,) = {test.zero_sd for test in tests}
    assert abs(zero - 3.0) < 3.0 * sd
    assert sd < 0.03


def test_a_file_that_begins_at_its_zero_without_force_keeps_it(tmp_path):
    """Others on the stage show a contact that agrees with the file's zero, or another one."""
    still = film_press(1.0, 5, approach=0.0)
    begins = slice(int(np.argmax(still.way > 0.0)) - 1, None)
    at_once = type(still)(still.time[begins] - still.time[begins][0], still.way[begins],
                          np.maximum(still.load[begins], 0.0))  # fmt: skip
    own = written(tmp_path, "own", at_once, 0.0)
    for contact in (0.0, -0.8):
        files = stage(tmp_path, contact, (0.5, 1.0, 2.0))
        test = convert([own, *files], ONE).tests[0]
        assert test.zero == 0.0
        assert (test.zero_sd is None) == (contact != 0.0)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_stated_contact_has_the_files_sign_and_lies_within_the_travel(way, tmp_path):
    (file,) = stage(tmp_path, 5.0, (2.0,), way=way)
    (test,) = convert([file], Answers.from_words(contact=f"{way * 5.0}")).tests
    assert test.zero == 5.0
    for wrong in (-way * 5.0, way * 9.0, way * 2.0):
        with pytest.raises(InputError, match="lies outside the travel"):
            convert([file], Answers.from_words(contact=f"{wrong}"))


def _rubbing(folder, speed, friction):
    """Write a press at 1 mm of the file by a platen whose guide rubs from its first motion on."""
    rng = np.random.default_rng(round(10 * speed))
    ends = np.cumsum([1.0, 3.5 / speed, 10.0, 1.5 / speed, 5.0])
    time = np.arange(0.0, ends[-1], 0.005)
    way = np.interp(time, [0.0, *ends], [0.0, 0.0, 3.5, 3.5, 2.0, 2.0])
    slid = np.zeros(time.size)  # Dahl's law over a way of 0.02 mm
    for k, step in enumerate(np.diff(way)):
        slid[k + 1] = np.sign(step) + (slid[k] - np.sign(step)) * np.exp(-abs(step) / 0.02)
    load = 1.35 * np.maximum(way - 1.0, 0.0) ** 1.5 + friction * slid + 0.031
    load += rng.normal(0.0, 0.004, time.size)
    return written(folder, f"at_{speed:g}", Pressed(time, np.round(way, 3), load), 0.0)


def test_a_guide_that_rubs_from_the_first_motion_on_is_no_contact(tmp_path):
    files = [_rubbing(tmp_path, v, friction=0.15) for v in (0.2, 1.0, 5.0, 20.0)]
    for test in convert(files, ONE).tests:
        assert abs(test.zero - 1.0) < 3.0 * test.zero_sd < 0.1
        before = test.force[test.displacement < 1e-3 - test.zero]
        assert abs(before.mean()) < 0.002  # of the platen at rest, the tare is taken off
        assert "the force rises by 0.1" in " ".join(test.findings)
        assert test.displacement[0] == pytest.approx(-test.zero)  # what rubs has its history
    (alone,) = convert(files[1:2], ONE).tests
    assert "if friction or drag of the rig makes the step, --contact 0.9" in " ".join(
        alone.findings
    )
    without = [_rubbing(tmp_path, v, friction=0.0) for v in (0.2, 1.0, 5.0)]
    for test in convert(without, ONE).tests:
        assert not any("friction" in line for line in test.findings)


def test_a_stated_contact_leaves_the_zero_of_the_force_to_the_file(tmp_path):
    file = _rubbing(tmp_path, 1.0, friction=0.0)
    (test,) = convert([file], Answers.from_words(pads=("P",), contact="1.0")).tests
    assert abs(test.force[test.displacement < -0.2].mean()) < 0.002
    assert "taken off the force: 0.03" in " ".join(test.findings)
