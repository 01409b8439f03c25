"""Lines above a table state pads and clocks; files that differ are told, and what lacks."""

import re
from shutil import copy

import numpy as np
import pytest
from support.endtoend import call
from support.machine_files import pressed

from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import convert
from qlvbayes.io.data import read_measurements
from qlvbayes.io.loading import Answers
from qlvbayes.io.recording import UnsureError
from qlvbayes.io.stated import stated_above
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


def german(folder, name, clock, specimen="Silikon A", day="24.11.2026"):
    return written(folder, name, GERMAN, f"Datum: {day} {clock}", f"Probe: {specimen}")


def tabbed(folder, name, *above):
    return written(folder, name, TABBED, *above, scale=(1e3, 1e3, 1.0 / 9.80665e-3), seed=3)


def test_specimens_above_the_tables_are_pads_and_dates_their_clock(tmp_path):
    files = [
        german(tmp_path, "a_v1.txt", "09:26:05"),
        german(tmp_path, "a_v2.txt", "09:12:05"),
        tabbed(tmp_path, "b1.txt", "Specimen\tpad B", "Speed\t0.1 mm/s"),
    ]
    source = Source.from_files(files)
    first, second = source.read.pads
    assert [(pad.name, len(pad.tests)) for pad in (first, second)] == [
        ("Silikon A", 2),
        ("B", 1),
    ]
    assert [(t.name, t.start_s, t.start_known) for t in first.tests] == [
        ("a_v2", 0.0, True),
        ("a_v1", 840.0, True),
    ]
    told = " ".join(source.notices)
    assert "called Silikon A, as in 'Probe: Silikon A'" in told
    assert "start_s is taken from 'Datum: 24.11.2026 09:26:05'" in told
    (one,) = Source.from_files(files, only=("P",)).read.pads
    assert (one.name, len(one.tests)) == ("P", 3)


@pytest.mark.parametrize("more", [(), ("Operator\tKV",)])
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


def test_a_date_with_day_and_month_in_either_order_serves_within_its_day(tmp_path):
    def starts(day):
        files = [
            german(tmp_path, "v1.txt", "09:00:00", day="03/04/2025"),
            german(tmp_path, "v2.txt", "10:00:00", day=day),
        ]
        found = convert(files)
        return [test.start_s for test in found.tests], " ".join(found.notices)

    assert starts("03/04/2025")[0] == [0.0, 3600.0]
    unclear, told = starts("04/04/2025")
    assert unclear == [None, None]
    assert "day and month of" in told
    assert "may be exchanged" in told


@pytest.mark.parametrize(
    ("line", "began"),
    [
        ("Date: 2026-11-24T09:26:05", 1795512365.0),
        ("Datum;24.11.2026 09:26", 1795512360.0),
        ("Date\t11/24/2026 9:26:05 PM", 1795555565.0),
        ("Test date: 24 Nov 2026, 09:26:05", 1795512365.0),
        ("Calibration date: 2026-11-24 09:26:05", None),
        ("Date: 31.02.2026 09:26:05", None),
        ("Date: 2026-11-24", None),
        ("# started: 2026-11-24 09:26:05", 1795512365.0),
        ("// Begin: 24.11.2026 09:26:05", 1795512365.0),
        ("! recorded on\t2026-11-24T09:26:05", 1795512365.0),
        ("Specimen: Pad P\t\tStarted: 2026-11-24 09:26:05", 1795512365.0),
        ("% finished: 2026-11-24 09:26:05", None),
    ],
)
def test_dates_that_can_mean_one_thing_are_read(line, began):
    assert stated_above([line]).began == began


@pytest.mark.parametrize(
    "line",
    [
        "Specimen: Pad P",
        "Specimen\tPad P",
        "Specimen: Pad P\t\tStarted: 9:26:05",
        "; Pad: Pad P",
    ],
)
def test_a_key_and_its_value_may_share_a_cell(line):
    assert stated_above([line]).specimen == "P"


@pytest.mark.parametrize(
    ("header", "comments", "delimiter"),
    [
        ("time_s displacement_mm force_N", "# ", " "),
        ("time_s,displacement_mm,force_N", "# ", ","),
        ("time_s displacement_mm force_N", "# ", ","),
        ("time_s\tdisplacement_mm\tforce_N", "%", "\t"),
        ("t (s), d (mm), F (N)", "% ", " "),
        ("t [s]   d [mm]   F [N]", "# ", "\t"),
        ("specimen: Pad P\nt (s) d (mm) F (N)", "// ", " "),
        ("Time Displacement Force\ns mm N", "# ", "\t"),
        ("Time (s); Displacement (mm); Force (N)", "! ", ";"),
    ],
)
def test_names_in_a_comment_above_the_numbers_are_read_and_joined(
    tmp_path, header, comments, delimiter
):
    one = pressed(0.4, hold=1.0, rate=50.0)
    file = tmp_path / "P.txt"
    columns = np.c_[one.time, one.way, one.load]
    np.savetxt(file, columns, header=header, comments=comments, delimiter=delimiter)
    (pad,) = read_measurements(file).pads
    assert pad.name == ("P" if "specimen" in header else "pad")
    assert (pad.units.displacement, pad.units.force) == ("mm", "N")
    (test,) = pad.tests
    if header.startswith("time_s,"):
        (tmp_path / "all.csv").write_bytes(joined([file, copy(file, tmp_path / "2.txt")], "P"))
        (pad,) = read_measurements(tmp_path / "all.csv").pads
        assert (pad.name, [len(t.time) for t in pad.tests]) == ("P", [len(one.time)] * 2)
    assert np.array_equal(test.time, one.time)
    assert np.ptp(test.displacement) == np.ptp(one.way)


def test_a_probe_is_a_specimen_in_german_alone():
    assert stated_above(["Datum: 24.11.2026", "Probe: S 1"]).specimen == "S 1"
    assert stated_above(["Probe: S 1"], "Zeit;Weg;Kraft").specimen == "S 1"
    assert stated_above(["Date: 2026-11-24", "Probe: sphere 3 mm"]).specimen == ""
    assert stated_above(["Sample rate: 100 Hz", "Sample;Load (N)"]).specimen == ""


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
