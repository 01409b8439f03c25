"""What files of strangers state, lack and show: pads, clocks, signs, units, remedies."""

import re

import numpy as np
import pytest
from support.endtoend import call
from support.machine_files import pressed

from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import split_header
from qlvbayes.io.conversion import convert, write_csv
from qlvbayes.io.data import read_measurements
from qlvbayes.io.header import stated_above
from qlvbayes.io.loading import Answers
from qlvbayes.io.readings import unread_rows
from qlvbayes.io.recording import UnsureError
from qlvbayes.io.tidy import joined
from qlvbayes.pipeline.source import Source

GERMAN = "Prüfzeit;Traversenweg;Prüfkraft\ns;mm;N"
TABBED = "Time (ms)\tPosition (um)\tLoad (gf)"


def written(folder, name, header, *above, scale=(1.0, 1.0, 1.0), seed=1):
    test = pressed(0.4, hold=1.0, rate=50.0, seed=seed)
    mark = "\t" if "\t" in header else ";"
    rows = zip(test.time, test.way, test.load, strict=True)
    lines = [mark.join(f"{x * k:.5f}" for x, k in zip(row, scale, strict=True)) for row in rows]
    path = folder / name
    path.write_text("\n".join([*above, "", header, *lines, ""]), "utf-8")
    return path


def tabbed(folder, name, *above):
    return written(folder, name, TABBED, *above, scale=(1e3, 1e3, 1.0 / 9.80665e-3), seed=3)


@pytest.mark.parametrize("more", [(), ("Operator\tKV",)])
@pytest.mark.few(1)
def test_files_that_differ_are_one_pad_only_with_a_remark_whose_remedies_work(tmp_path, more):
    files = [
        written(tmp_path, "silicone_v1.txt", GERMAN),
        written(tmp_path, "silicone_v2.txt", GERMAN, seed=2),
        tabbed(tmp_path, "oil_1.txt", *more),
    ]
    status, said, _ = call("look", *files)
    assert status == 0, said
    words = re.search(r"name the pad of each file with --pad (\S+);", said.replace("\n", " "))
    parted = Source.from_files(files, only=tuple(words[1].split(",")))
    assert [len(one.pads[0].tests) for one in parted] == [2, 1]
    assert not convert(files, Answers.from_words(pads=("pad",))).remarks
    assert not convert(files[:2]).remarks
    same_names = [files[0], tabbed(tmp_path, "silicone_v3.txt")]
    assert "different columns or units" in convert(same_names).remarks[0]


@pytest.mark.parametrize(
    ("line", "began"),
    [("Date: 2026-11-24T09:26:05", 5), ("Datum;24.11.2026 09:26", 0),
     ("Date\t11/24/2026 9:26:05 PM", 43205), ("Test date: 24 Nov 2026, 09:26:05", 5),
     ("# started: 2026-11-24 09:26:05", 5), ("// Begin: 24.11.2026 09:26:05", 5),
     ("! recorded on\t2026-11-24T09:26:05", 5),
     ("Specimen: Pad P\t\tStarted: 2026-11-24 09:26:05", 5),
     ("Calibration date: 2026-11-24 09:26:05", None), ("Date: 31.02.2026 09:26:05", None),
     ("Date: 2026-11-24", None), ("% finished: 2026-11-24 09:26:05", None)],
)  # fmt: skip
def test_dates_that_can_mean_one_thing_are_read(line, began):
    assert stated_above([line]).began == (None if began is None else 1795512360.0 + began)


@pytest.mark.parametrize(
    ("lines", "specimen"),
    [(["Specimen: Pad P"], "P"), (["Specimen\tPad P"], "P"), (["; Pad: Pad P"], "P"),
     (["Specimen: Pad P\t\tStarted: 9:26:05"], "P"),
     (["Cell: 10 N, sample: Pad P, oil, operator: AB, date: 2026-11-24, 9:26:05"], "P, oil"),
     # a probe is a specimen in German alone
     (["Datum: 24.11.2026", "Probe: S 1"], "S 1"), (["Probe: S 1", "Zeit;Weg;Kraft"], "S 1"),
     (["Date: 2026-11-24", "Probe: sphere 3 mm"], ""),
     (["Sample rate: 100 Hz", "Sample;Load (N)"], "")],
)  # fmt: skip
def test_a_key_and_its_value_may_share_a_cell(lines, specimen):
    above, names = (lines[:1], lines[1:]) if ";" in lines[-1][1:] else (lines, [])
    assert stated_above(above, *names).specimen == specimen


def test_a_column_that_lacks_is_named_alone_and_the_remedy_works(tmp_path):
    lines = (
        tabbed(tmp_path, "volts.txt", "Specimen\tpad B").read_text().replace("Load (gf)", "S 3 (V)")
    )
    path = tmp_path / "volts.txt"
    path.write_text(lines)
    with pytest.raises(InputError, match=r"which column is the force \(the file has: Time") as told:
        read_measurements(path)
    words = re.search(r"--columns (\S+) --units (\S+),", str(told.value))
    (test,) = convert([path], Answers.from_words(columns=words[1], units=words[2])).tests
    assert (test.units.displacement, test.units.force) == ("um", "N")
    with pytest.raises(UnsureError):
        convert([path])
    path.write_text(re.sub(r"(?m)^(.*)\t[^\t\n]*$", r"\1", lines))
    with pytest.raises(InputError, match=r"no column for force \(the file has: Time \(ms\), Pos"):
        read_measurements(path)


NAMES = "Time (s),Displacement (mm),Force (N)"
TEST = pressed(hold=1.0, rate=50.0)


def rows_of(test, form="{:.5f},{:.5f},{:.5f}"):
    return [form.format(*row) for row in zip(test.time, test.way, test.load, strict=True)]


def file_of(folder, name, *lines):
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
    ramp, step = np.clip(time - 0.1, 0.0, 0.8), np.where(time < 0.1, 0.0, 1.5)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(60) * (time >= 0.1)
    for way in (ramp, step, step + noise, np.floor(time * 5.0) * 0.3):
        assert unread_rows(time, way, 2.0 * way) == 0
    assert unread_rows(time, np.where(time < 0.05, 0.0, 30.0 + ramp), 2.0 * ramp) == 3


@pytest.mark.parametrize(
    ("cell", "name", "unit"),
    [("Speed mm/s", "Speed mm/s", ""), ("F/N", "F", "N"), ("s/mm", "s/mm", ""),
     ("Force in the middle", "Force in the middle", ""), ("Strain mm/mm", "Strain mm/mm", "")],
)  # fmt: skip
def test_a_quotient_of_units_is_no_name_over_its_unit(cell, name, unit):
    assert split_header(cell) == (name, unit)


@pytest.mark.parametrize(
    "header", ["time_s,displacement_mm,force_N", "# time_s displacement_mm force_N"]
)
def test_tidy_files_of_a_test_each_are_joined_to_one_of_a_pad(header, tmp_path):
    files = [file_of(tmp_path, f"v{k}.csv", header, *rows_of(TEST)) for k in (1, 2, 3)]
    path = tmp_path / "P.csv"
    write_csv(joined(files, "P"), path)
    (pad,) = read_measurements(path).pads
    assert (pad.name, [test.name for test in pad.tests]) == ("P", ["v1", "v2", "v3"])
    alone = read_measurements(files[1]).pads[0].tests[0]
    for one in ("time", "displacement", "force"):
        np.testing.assert_array_equal(getattr(pad.tests[1], one), getattr(alone, one))
    other = file_of(tmp_path, "other.csv", "time_s,force_N,displacement_mm", *rows_of(TEST))
    with pytest.raises(InputError, match=r"are not those of v1\.csv"):
        joined([files[0], other], "P")
    with pytest.raises(InputError, match="names its pads or tests itself"):
        joined([files[0], path], "P")
