"""Kinds of records that strangers have: signs, blocks, zeros, dead weights, units, remedies."""

import re
from pathlib import Path

import numpy as np
import pytest
from support.machine_files import Pressed, _workbook, lvm, pressed

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Control, read_measurements
from qlvbayes.io.formats.answers import Answers, UnsureError
from qlvbayes.io.formats.conversion import convert
from qlvbayes.io.formats.tidy import tidy_text, write_tidy

STRANGERS = Path(__file__).parents[3] / "shared" / "records" / "strangers"
NAMES = "Time (s),Displacement (mm),Force (N)"
TEST = pressed(hold=1.0, rate=50.0)


def rows_of(test, form="{:.5f},{:.5f},{:.5f}"):
    return [form.format(*row) for row in zip(test.time, test.way, test.load, strict=True)]


def written(folder, name, *lines):
    path = folder / name
    path.write_text("\n".join([*lines, ""]))
    return path


def turned_back(test):
    """The same press from its peak back into the air."""
    return Pressed(test.time, test.way[::-1].copy(), test.load[::-1].copy())


# signs


def test_a_part_that_begins_at_its_largest_force_has_the_sign_of_the_others(tmp_path):
    press = written(tmp_path, "extend.csv", NAMES, *rows_of(TEST))
    back = turned_back(pressed(hold=0.0, rate=50.0))
    retract = written(tmp_path, "retract.csv", NAMES, *rows_of(back))
    with pytest.raises(UnsureError, match="the force is largest where the test begins") as told:
        convert([retract])
    assert told.value.option == "sign"
    for files in ([press, retract], [retract, press]):
        tests = convert(files, Answers.from_words(contact="file")).tests
        found = next(test for test in tests if test.test == "retract")
        np.testing.assert_allclose(found.displacement, back.way, atol=1e-5)
        np.testing.assert_allclose(found.force, back.load, atol=1e-5)
    with pytest.raises(UnsureError, match=r"\(100\.0% of the largest force\)"):
        convert([press, retract])
    # what each message says can be said
    stated = convert([retract], Answers.from_words(sign="none", contact="file")).tests[0]
    np.testing.assert_allclose(stated.force, back.load, atol=1e-5)


@pytest.mark.parametrize("offset", [-5.0, 5.0])
def test_a_cell_that_was_not_tared_still_shows_its_sign_by_an_approach(offset, tmp_path):
    shifted = Pressed(TEST.time, TEST.way, TEST.load + offset)
    (test,) = convert([written(tmp_path, "a.csv", NAMES, *rows_of(shifted))]).tests
    assert (test.signs.way, test.signs.load) == (1, 1)


# blocks


@pytest.mark.parametrize("cuts", [[], [60], [30, 70]])
@pytest.mark.parametrize(
    "head",
    [[NAMES], ["Time,Extension,Load", "(s),(mm),(N)"], ["Elapsed Time,Disp,Load", "Sec,mm,N"]],
)
def test_blocks_below_repeated_names_are_one_test(cuts, head, tmp_path):
    rows, lines = rows_of(TEST), []
    for begin, end in zip([0, *cuts], [*cuts, len(rows)], strict=True):
        lines += [*head, *rows[begin:end]]
    whole = tidy_text(convert([written(tmp_path, "a.csv", *head, *rows)]))
    (tmp_path / "b").mkdir()
    assert tidy_text(convert([written(tmp_path / "b", "a.csv", *lines)])) == whole


def test_blocks_whose_clock_begins_anew_under_load_are_refused_with_the_line(tmp_path):
    rows, cut = rows_of(TEST), 60
    later = Pressed(TEST.time[cut:] - TEST.time[cut], TEST.way[cut:], TEST.load[cut:])
    with pytest.raises(InputError, match="the clock begins anew here") as told:
        convert([written(tmp_path, "a.csv", NAMES, *rows[:cut], NAMES, *rows_of(later))])
    assert told.value.line == cut + 2
    again = pressed(hold=1.0, rate=50.0, seed=2)
    found = convert([written(tmp_path, "b.csv", NAMES, *rows, NAMES, *rows_of(again))])
    assert [len(test.time) for test in found.tests] == [len(rows)] * 2


# zeros


def test_files_beside_it_do_not_move_one_that_begins_at_its_zero_without_force(tmp_path):
    others = []
    for seed, speed in enumerate((1.0, 2.0)):
        late = pressed(0.9, speed=speed, hold=1.0, rate=50.0, seed=seed)
        shifted = Pressed(late.time, late.way + 0.9, late.load)
        others.append(written(tmp_path, f"late{seed}.csv", NAMES, *rows_of(shifted)))
    at_once = pressed(0.0, hold=1.0, rate=50.0, seed=7)
    own = written(tmp_path, "own.csv", NAMES, *rows_of(at_once))
    for files in ([own], [own, *others], [*others, own]):
        test = next(one for one in convert(files).tests if one.test == "own")
        assert test.zero == 0.0
        np.testing.assert_allclose(test.force, at_once.load, atol=1e-5)
        assert "begins beyond it" not in " ".join(test.findings)


# a prescribed force


def creep(force=1.0):
    time = np.geomspace(0.01, 40.0, 80)
    return Pressed(time, 0.03 + 0.2 * (1.0 - np.exp(-time)), np.full(80, force))


@pytest.mark.parametrize("names", [NAMES, "time_s,displacement_mm,force_N"])
def test_a_constant_force_is_creep_and_a_constant_zero_a_dead_channel(names, tmp_path):
    read = read_measurements(written(tmp_path, "a.csv", names, *rows_of(creep(0.37))))
    (test,) = read.pads[0].tests
    assert test.control == Control.FORCE
    np.testing.assert_allclose(test.displacement, creep().way, atol=1e-5)
    assert any("taken as prescribed" in line and "control" in line for line in read.notices)
    with pytest.raises(InputError, match=r"never changes|no test of 10 rows"):
        read_measurements(written(tmp_path, "b.csv", names, *rows_of(creep(0.0))))


def test_a_converted_creep_says_what_is_prescribed(tmp_path):
    write_tidy(convert([written(tmp_path, "a.csv", NAMES, *rows_of(creep()))]), tmp_path / "t.csv")
    assert read_measurements(tmp_path / "t.csv").pads[0].tests[0].control == Control.FORCE


# one quantity in two units


def test_one_record_in_two_units_is_one_side_by_side_below_and_in_two_files(tmp_path):
    other = Pressed(TEST.time, TEST.way / 25.4, TEST.load / 9.80665)
    inches = rows_of(other, "{:.5f},{:.5f},{:.6g}")
    units = "Time (s),Displacement (in),Force (kgf)"
    beside = [f"{a},{b.partition(',')[2]}" for a, b in zip(rows_of(TEST), inches, strict=True)]
    head = f"{NAMES},{units.partition(',')[2]}"
    (one,) = convert([written(tmp_path, "beside.csv", head, *beside)]).tests
    assert one.test == "beside"
    assert "has the same readings and is left out" in " ".join(one.findings)
    files = [
        written(tmp_path, "a.csv", NAMES, *rows_of(TEST)),
        written(tmp_path, "b.csv", units, *inches),
    ]
    assert [test.test for test in convert(files).tests] == ["a"]
    assert len(convert(files, Answers.from_words(pads=("A", "B"))).tests) == 2


def test_a_tidy_file_may_have_one_quantity_in_two_units(tmp_path):
    rows = [f"{row},{1e3 * f:.2f}" for row, f in zip(rows_of(TEST), TEST.load, strict=True)]
    head = "time_s,displacement_mm,force_N,force_mN"
    read = read_measurements(written(tmp_path, "a.csv", head, *rows))
    assert read.units.force == "N"
    assert any("force_mN" in notice for notice in read.notices)
    wrong = [f"{row},{1e3 * f + 9.0:.2f}" for row, f in zip(rows_of(TEST), TEST.load, strict=True)]
    with pytest.raises(InputError, match="two columns for force: 'force_N' and 'force_mN'"):
        read_measurements(written(tmp_path, "b.csv", head, *wrong))


# remedies that work


@pytest.mark.parametrize("columns", [None, "1,3,2"])
def test_the_time_of_labview_s_text_follows_from_its_header(columns, tmp_path):
    path = tmp_path / "a.lvm"
    path.write_bytes(lvm(TEST))
    (test,) = convert([path], Answers.from_words(columns=columns)).tests
    np.testing.assert_allclose(test.time, TEST.time, atol=1e-6)
    assert test.force.max() == pytest.approx(TEST.load.max(), abs=1e-5)


def test_a_workbook_without_names_is_read_as_the_message_says(tmp_path):
    pytest.importorskip("python_calamine")
    path = tmp_path / "a.xlsx"
    rows = np.stack([TEST.time, TEST.load, TEST.way, TEST.time], axis=1).tolist()
    path.write_bytes(_workbook({"Sheet": rows}))
    with pytest.raises(UnsureError, match="the file has: 1, 2, 3, 4") as told:
        convert([path])
    assert re.search("--columns .*--units", str(told.value))
    (test,) = convert([path], Answers.from_words(columns="1,3,2", units="s,mm,N")).tests
    assert test.force.max() == pytest.approx(TEST.load.max())


def test_a_table_without_any_time_is_refused_for_that(tmp_path):
    half = len(TEST.way) // 2
    names = "Ramp_Ex_nm\tRamp_Rt_nm\tDefl_pN_Ex\tDefl_pN_Rt"
    back, load = TEST.way[::-1], TEST.load[::-1]
    rows = zip(TEST.way[:half], back[:half], TEST.load[:half], load[:half], strict=True)
    path = written(tmp_path, "a.txt", names, *("\t".join(f"{x:.2f}" for x in r) for r in rows))
    for read in (lambda: convert([path]), lambda: read_measurements(path)):
        with pytest.raises(InputError, match="there is no time: no column rises") as told:
            read()
        assert "--columns" not in str(told.value)


def test_no_message_has_bytes_of_a_file_that_is_no_text(tmp_path):
    path = tmp_path / "a.dat"
    path.write_bytes(b"\x01\x02,\x03,4\n" + bytes(range(256)) * 40)
    for answers in (Answers(), Answers.from_words(columns="1,2,3")):
        with pytest.raises(InputError) as told:
            convert([path], answers)
        assert str(told.value).isascii()
        assert "\\x" not in str(told.value)


@pytest.mark.parametrize(
    ("lines", "encoding"),
    [
        (["s,mm,N", "Time,Displacement,Force"], "utf-8"),  # units above the names
        (["time (s)", "Čas (s),Posunutí (mm),Síla (N)"][1:], "cp1250"),
        (["時間(sec),変位(mm),試験力(N)"], "cp932"),
        (["Time (s),Displacement (mm),Force (N),Comment"], "utf-8"),  # one name too many
    ],
)
def test_names_of_other_countries_and_rows_of_units_elsewhere(lines, encoding, tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("\n".join([*lines, *rows_of(TEST), ""]).encode(encoding))
    (test,) = convert([path]).tests
    assert len(test.time) == len(TEST.time)
    assert test.force.max() == pytest.approx(TEST.load.max(), abs=1e-4)


@pytest.mark.parametrize("separator", [" ", ",", "\t"])
def test_rows_with_names_of_their_own_as_r_writes_them(separator, tmp_path):
    names = separator.join(['"Time (s)"', '"Displacement (mm)"', '"Force (N)"'])
    rows = [f'"{k}",{row}'.replace(",", separator) for k, row in enumerate(rows_of(TEST), 1)]
    (test,) = convert([written(tmp_path, "a.txt", names, *rows)]).tests
    assert test.force.max() == pytest.approx(TEST.load.max(), abs=1e-4)


@pytest.mark.parametrize("day", ["03/05/2024", "27/11/2024", "11/27/2024"])
def test_dates_with_the_day_or_the_month_first_are_a_clock(day, tmp_path):
    rows = [
        f"{day} 10:{int(t) // 60:02}:{t % 60:06.3f},{d:.5f},{f:.5f}"
        for t, d, f in zip(TEST.time, TEST.way, TEST.load, strict=True)
    ]
    path = written(tmp_path, "a.csv", "Timestamp,Position (mm),Load (N)", *rows)
    np.testing.assert_allclose(convert([path]).tests[0].time, TEST.time, atol=1e-3)


# those kept elsewhere


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
