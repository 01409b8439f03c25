"""Kinds of records that strangers have: signs, blocks, zeros, dead weights, units, remedies."""

from pathlib import Path

import numpy as np
import pytest
from support.machine_files import pressed

from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import is_mean, split_header
from qlvbayes.io.conversion import convert, write_csv
from qlvbayes.io.data import Control, read_measurements
from qlvbayes.io.loading import Answers
from qlvbayes.io.readings import unread_rows
from qlvbayes.io.tidy import joined

STRANGERS = Path(__file__).parents[3] / "shared" / "records" / "strangers"
NAMES = "Time (s),Displacement (mm),Force (N)"
TEST = pressed(hold=1.0, rate=50.0)


def rows_of(test, form="{:.5f},{:.5f},{:.5f}"):
    return [form.format(*row) for row in zip(test.time, test.way, test.load, strict=True)]


def written(folder, name, *lines):
    path = folder / name
    path.write_text("\n".join([*lines, ""]))
    return path


def test_no_message_has_bytes_of_a_file_that_is_no_text(tmp_path):
    path = tmp_path / "a.dat"
    path.write_bytes(b"\x01\x02,\x03,4\n" + bytes(range(256)) * 40)
    for answers in (Answers(), Answers.from_words(columns="1,2,3")):
        with pytest.raises(InputError) as told:
            convert([path], answers)
        assert str(told.value).isascii()
        assert "\\x" not in str(told.value)


def test_records_that_begin_at_zero_keep_their_first_rows():
    time = np.arange(60) / 50.0
    ramp = np.clip(time - 0.1, 0.0, 0.8)
    step = np.where(time < 0.1, 0.0, 1.5)
    stairs = np.floor(time * 5.0) * 0.3
    for way in (ramp, step, stairs):
        assert unread_rows(time, way, 2.0 * way) == 0
    noise = 1e-3 * np.random.default_rng(1).standard_normal(60) * (time >= 0.1)
    assert unread_rows(time, step + noise, 2.0 * step) == 0
    assert unread_rows(time, np.where(time < 0.05, 0.0, 30.0 + ramp), 2.0 * ramp) == 3


def test_names_of_a_speed_are_no_mean_specimen():
    means = ("Mean", "Mittelwert", "Moyenne", "Average", "Eprouvette moyenne", "Mittelwertprobe",
             "Mean curve",
             "Silicone mean", "Moyenne des éprouvettes", "Kurven Mittelwert")  # fmt: skip
    assert all(map(is_mean, means))
    tests = ("vitesse moyenne", "mean speed", "mittlere Geschwindigkeit", "velocidad media",
             "average rate", "compression moyenne")  # fmt: skip
    assert not any(map(is_mean, tests))


@pytest.mark.parametrize(
    ("cell", "name", "unit"),
    [
        ("Speed mm/s", "Speed mm/s", ""),
        ("F/N", "F", "N"),
        ("s/mm", "s/mm", ""),
        ("Force in the middle", "Force in the middle", ""),
        ("Strain mm/mm", "Strain mm/mm", ""),
    ],
)
def test_a_quotient_of_units_is_no_name_over_its_unit(cell, name, unit):
    assert split_header(cell) == (name, unit)


@pytest.mark.skipif(not STRANGERS.is_dir(), reason="the strangers' records are not here")
def test_the_kept_records_of_strangers():
    blocks = [STRANGERS / f"{name}.csv" for name in ("one_test", "two_blocks", "three_blocks")]
    first, *others = (convert([path]).tests for path in blocks)
    for same in others:
        np.testing.assert_array_equal(same[0].displacement, first[0].displacement)
        np.testing.assert_array_equal(same[0].force, first[0].force)
    with pytest.raises(InputError, match="largest where the test begins"):
        convert([STRANGERS / "retract.csv"])
    assert len(convert([STRANGERS / "two_units.csv"]).tests) == 1
    zeros = [STRANGERS / "zeros" / f"{name}.csv" for name in "ABC"]
    assert convert(zeros).tests[-1].zero == convert(zeros[-1:]).tests[0].zero == 0.0
    weights = [STRANGERS / f"dead_weight{more}.csv" for more in ("", "_control")]
    plain, stated = (read_measurements(path).pads[0].tests[0] for path in weights)
    assert plain.control == stated.control == Control.FORCE
    assert len(convert([STRANGERS / "no_x_column.lvm"]).tests[0].time) == 486
    with pytest.raises(InputError, match="there is no time"):
        read_measurements(STRANGERS / "no_time.txt")


def test_tidy_files_of_a_test_each_are_joined_to_one_of_a_pad(tmp_path):
    header = "time_s,displacement_mm,force_N"
    files = [written(tmp_path, f"v{k}.csv", header, *rows_of(TEST)) for k in (1, 2, 3)]
    path = tmp_path / "P.csv"
    write_csv(joined(files, "P"), path)
    (pad,) = read_measurements(path).pads
    assert (pad.name, [test.name for test in pad.tests]) == ("P", ["v1", "v2", "v3"])
    alone = read_measurements(files[1]).pads[0].tests[0]
    for one in ("time", "displacement", "force"):
        np.testing.assert_array_equal(getattr(pad.tests[1], one), getattr(alone, one))
    other = written(tmp_path, "other.csv", "time_s,force_N,displacement_mm", *rows_of(TEST))
    with pytest.raises(InputError, match=r"are not those of v1\.csv"):
        joined([files[0], other], "P")
    with pytest.raises(InputError, match="names its pads or tests itself"):
        joined([files[0], path], "P")


@pytest.mark.parametrize("units", [None, "s,mm,N"])
def test_columns_in_another_order_than_their_units_are_refused(tmp_path, units):
    path = written(tmp_path, "a.csv", NAMES, *rows_of(TEST))
    answers = Answers.from_words(columns="Time (s),Force (N),Displacement (mm)", units=units)
    with pytest.raises(InputError, match="'Force' is taken as the displacement, but N is a unit"):
        convert([path], answers)
