"""Files as strangers' programs write them: read whole, or refused with the line and a remedy."""

import numpy as np
import pytest
from support.machine_files import Pressed, _workbook, pressed, workbook

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.formats.answers import Answers, UnsureError
from qlvbayes.io.formats.columns import split_header
from qlvbayes.io.formats.conversion import convert
from qlvbayes.io.formats.naming import is_mean
from qlvbayes.io.formats.textrows import read_rows
from qlvbayes.io.reading.unread import unread_rows

TEST = pressed(hold=0.6, rate=50.0)


def rows_of(test=TEST, form="{:.3f},{:.4f},{:.4f}"):
    return [form.format(*row) for row in zip(test.time, test.way, test.load, strict=True)]


def converted(folder, lines, name="a.csv", encoding="utf-8"):
    path = folder / name
    path.write_bytes("\n".join([*lines, ""]).encode(encoding))
    return convert([path])


def is_whole(found, force=1.0, way=1.0, rtol=1e-3):
    """All rows of the one test are there, in the units of the numbers given."""
    (test,) = found.tests
    assert len(test.time) == len(TEST.time)
    assert test.force.max() == pytest.approx(force * TEST.load.max(), rel=rtol)
    assert np.ptp(test.displacement) == pytest.approx(way * np.ptp(TEST.way), rel=rtol)
    return test


# cells


@pytest.mark.parametrize("minus", ["\u2212", "\u2013", "-"])
def test_a_typeset_minus_is_a_minus(tmp_path, minus):
    rows = [row.replace("-", minus) for row in rows_of()]
    is_whole(converted(tmp_path, ["Time (s),Position (mm),Load (N)", *rows]))


@pytest.mark.parametrize("space", ["\u202f", "\u00a0", " "])
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_spaces_at_thousands_are_no_text(tmp_path, space, encoding):
    if encoding == "cp1252" and space == "\u202f":
        return
    cells = zip(TEST.time, TEST.way, 3e3 * TEST.load, strict=True)
    rows = [f"{t:.2f};{d:.4f};{f:,.1f}".replace(",", space).replace(".", ",") for t, d, f in cells]
    lines = ["Temps (s);Déplacement (mm);Force (mN)", *rows]
    assert any(space in row for row in rows)
    test = is_whole(converted(tmp_path, lines, encoding=encoding), force=3e3)
    assert test.force.max() > 1000.0


def test_text_in_a_column_that_is_not_used_is_no_fault(tmp_path):
    press = int(np.argmax(TEST.way >= TEST.way.max()))
    for event in ("Hold", "Hold, second", '"Hold, second"'):
        rows = [row + ("," if k < press else f",{event}") for k, row in enumerate(rows_of())]
        test = is_whole(
            converted(tmp_path, ["Time,Extension,Load,Event", "(s),(mm),(N),(-)", *rows])
        )
        assert not test.dropped
    rows = [f"Belastung;{row}".replace(".", ",") for row in rows_of(form="{:.3f};{:.4f};{:.4f}")]
    names = "Zyklus;Prüfzeit;Standardweg;Standardkraft"
    is_whole(converted(tmp_path, [names, ";s;mm;N", *rows], "b.txt"))


def test_the_decimal_mark_is_sought_in_all_rows(tmp_path):
    still = [f"{k};0;0" for k in range(500)]
    moved = [f"{500 + k};{0.03 * k:.3f};{0.02 * k:.3f}".replace(".", ",") for k in range(60)]
    (test,) = converted(tmp_path, ["Zeit [s];Weg [mm];Kraft [N]", *still, *moved]).tests
    assert test.force.max() == pytest.approx(0.02 * 59)


def test_rows_that_cannot_be_read_are_refused_where_they_are_many(tmp_path):
    rows = rows_of()
    few = [*rows[:30], rows[30].rsplit(",", 1)[0] + ",OVER", *rows[31:]]
    (test,) = converted(tmp_path, ["Time (s),Position (mm),Load (N)", *few]).tests
    assert test.dropped == {"lines without numbers": 1}
    many = [row.rsplit(",", 1)[0] + ",OVER" if 30 <= k < 33 else row for k, row in enumerate(rows)]
    with pytest.raises(InputError) as caught:
        converted(tmp_path, ["# a rig", "Time (s),Position (mm),Load (N)", *many])
    assert caught.value.line == 33
    assert f"3 of {len(rows)} rows have no number in a column" in str(caught.value)
    assert f"the first is '{many[30]}'; write numbers there" in str(caught.value)


def test_a_gap_of_empty_cells_is_refused_and_cells_of_two_rates_are_not(tmp_path):
    head = "Time (s),Position (mm),Load (N)"
    rows = rows_of()
    gap = [row.rsplit(",", 1)[0] + "," if 20 <= k < 35 else row for k, row in enumerate(rows)]
    with pytest.raises(InputError, match=r"line 22: 15 of .* rows have no number"):
        converted(tmp_path, [head, *gap])
    slow = [row.rsplit(",", 1)[0] + "," if k % 3 else row for k, row in enumerate(rows)]
    (test,) = converted(tmp_path, [head, *slow]).tests
    assert len(test.time) == -(-len(rows) // 3)
    block = "\n".join([*gap, ""]).encode()
    assert len(read_rows(block, ",", range(3), tmp_path, sparse=True).columns[0]) == len(rows) - 15


def test_lines_above_and_below_the_rows_are_not_among_them(tmp_path):
    rows = rows_of()
    below = ["", "Specimen,Fmax,dmax", "1,a,b", "2,a,b", "3,a,b", "4,a,b"]
    test = is_whole(converted(tmp_path, ["Time (s),Position (mm),Load (N)", *rows, *below]))
    assert sum(test.dropped.values()) == 5


def test_a_line_of_text_alone_is_told_where_no_row_can_be_read(tmp_path):
    rows = [row.replace(",", ";") for row in rows_of()]
    with pytest.raises(InputError, match=r"line 2: there are no rows of numbers \(the first line"):
        converted(tmp_path, ["Time (s),Position (mm),Load (N)", *rows])


@pytest.mark.parametrize("mark", [".", ","])
def test_numbers_that_a_workbook_holds_as_text_are_numbers(tmp_path, mark):
    pytest.importorskip("python_calamine")
    table = np.stack([TEST.time, TEST.way, TEST.load], 1).round(4).tolist()
    mixed = [[t, d, f"{f:.4f}".replace(".", mark)] if f > 0.2 else [t, d, f] for t, d, f in table]
    names = [["Zeit", "Weg", "Kraft"], ["s", "mm", "N"]]
    path = tmp_path / "a.xlsx"
    path.write_bytes(_workbook({"P1": [*names, *mixed]}))
    is_whole(convert([path]))
    over = [[t, d, "over" if f > 0.2 else f] for t, d, f in mixed_as_numbers(table)]
    path.write_bytes(_workbook({"P1": [*names, *over, [None, None, 1.0]]}))
    with pytest.raises(InputError, match="rows have no number in a column that is used"):
        convert([path])


def mixed_as_numbers(table):
    """The rows of a table, and a last one that can be used after them."""
    return [*table, [table[-1][0] + 0.02, table[-1][1], 0.1]]


# columns


def three_beside(names, separator=",", above=None):
    tables = [rows_of(pressed(hold=hold, rate=50.0, seed=seed)) for seed, hold in
              enumerate((0.6, 0.5, 0.4))]  # fmt: skip
    empty = separator * (names.count(separator))
    rows = [
        separator.join(table[k] if k < len(table) else empty for table in tables)
        for k in range(len(tables[0]))
    ]
    head = [above] if above else []
    return [*head, separator.join([names] * 3), *rows], [len(table) for table in tables]


def test_columns_repeated_side_by_side_are_several_tests(tmp_path):
    lines, sizes = three_beside("Time (s),Extension (mm),Load (N)")
    found = convert_lines(tmp_path, lines)
    assert [test.test for test in found.tests] == ["1", "2", "3"]
    assert [len(test.time) for test in found.tests] == sizes
    assert not any(test.dropped for test in found.tests)
    lines, _ = three_beside("Time (s),Extension (mm),Load (N)", above="Gel A,,,Gel B,,,Gel C,,")
    assert [test.test for test in convert_lines(tmp_path, lines).tests] == [
        "Gel A", "Gel B", "Gel C",
    ]  # fmt: skip


def convert_lines(folder, lines):
    return converted(folder, lines, "beside.csv")


def test_tests_side_by_side_may_share_their_time(tmp_path):
    rows = [f"{row},{row.split(',')[1]},{2 * float(row.split(',')[2]):.4f}" for row in rows_of()]
    head = "Time (s),Position (mm),Load (N),Position (mm),Load (N)"
    found = convert_lines(tmp_path, [head, *rows])
    assert [test.test for test in found.tests] == ["1", "2"]
    first, second = (test.force.max() for test in found.tests)
    assert second == pytest.approx(2.0 * first, rel=1e-3)


def test_specimens_side_by_side_in_a_workbook_are_several_tests(tmp_path):
    pytest.importorskip("python_calamine")
    table = np.stack([TEST.time, TEST.way, TEST.load], 1).tolist()
    head = [["Probe 1", None, None, "Probe 2"], 2 * ["Zeit", "Weg", "Kraft"], 2 * ["s", "mm", "N"]]
    path = tmp_path / "a.xlsx"
    path.write_bytes(
        _workbook({"Kurven": [*head, *([*row, *row[:2], 2.0 * row[2]] for row in table)]})
    )
    assert [test.test for test in convert([path]).tests] == ["Kurven Probe 1", "Kurven Probe 2"]


def test_a_column_left_out_is_named(tmp_path):
    head = "Time (s),Crosshead (mm),Load (N),Extensometer displacement (mm),Load cell 2 (N)"
    rows = [f"{row},0.1,0.2" for row in rows_of()]
    test = is_whole(converted(tmp_path, [head, *rows]))
    assert "columns not used: Extensometer displacement, Load cell 2" in test.findings


# rows before the channels were read, and signs


@pytest.mark.parametrize("stage", [25.0, -25.0])
def test_a_first_row_of_zeros_is_dropped_before_signs_and_contact_are_judged(tmp_path, stage):
    late = Pressed(TEST.time + 0.02, np.sign(stage) * TEST.way + stage, TEST.load)
    head = "Time (s),Position (mm),Load (N)"
    test = is_whole(converted(tmp_path, [head, "0.000,0.0000,0.0000", *rows_of(late)]))
    assert test.dropped["rows before the channels were read, both exactly 0"] == 1
    assert abs(test.zero) == pytest.approx(25.0, abs=0.1)


def test_a_first_row_of_zeros_in_a_tidy_file_is_dropped_and_told(tmp_path):
    path = tmp_path / "tidy.csv"
    late = Pressed(TEST.time + 0.02, TEST.way + 25.0, TEST.load)
    rows = ["0.000,0.0000,0.0000,3.0", *(f"{row},3.0" for row in rows_of(late))]
    path.write_text("\n".join(["time_s,displacement_mm,force_N,start_s", *rows, ""]))
    read = read_measurements(path)
    (test,) = read.pads[0].tests
    assert len(test.time) == len(TEST.time)
    assert test.displacement.min() > 24.0
    assert test.start_s == pytest.approx(3.02)
    assert "dropped 1 row before the channels were read, both exactly 0 (line 2)" in str(
        read.notices
    )


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


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_stress_against_the_strain_is_of_the_wrong_sign(tmp_path, sign):
    path = tmp_path / "tidy.csv"
    turned = Pressed(TEST.time, 0.1 * np.maximum(TEST.way, 0.0), sign * TEST.load)
    path.write_text("\n".join(["time_s,strain,stress_kPa", *rows_of(turned), ""]))
    if sign > 0.0:
        assert read_measurements(path).units.dimensionless
        return
    with pytest.raises(InputError, match="stress_kPa of the wrong sign; multiply stress_kPa by -1"):
        read_measurements(path)


# units and names


@pytest.mark.parametrize(
    ("unit", "newtons"),
    [("lb", 4.4482216), ("lbs", 4.4482216), ("kg", 9.80665), ("cN", 0.01), ("daN", 10.0)],
)
def test_units_of_force_as_people_write_them(tmp_path, unit, newtons):
    rows = rows_of(Pressed(TEST.time, TEST.way, TEST.load / newtons), "{:.3f},{:.4f},{:.8f}")
    is_whole(converted(tmp_path, [f"Time (s),Position (mm),Load ({unit})", *rows]))
    is_whole(converted(tmp_path, ["Time,Extension,Load", f"(s),(mm),({unit})", *rows]))


@pytest.mark.parametrize(
    ("unit", "millimetres"), [("inches", 25.4), ("mil", 0.0254), ("dm", 100.0), ("IN", 25.4)]
)
def test_units_of_length_as_people_write_them(tmp_path, unit, millimetres):
    rows = rows_of(Pressed(TEST.time, TEST.way / millimetres, TEST.load), "{:.3f},{:.8f},{:.4f}")
    is_whole(converted(tmp_path, [f"Time (s),Position ({unit}),Load (N)", *rows]))


@pytest.mark.parametrize(("unit", "seconds"), [("Min.", 60.0), ("Sekunden", 1.0), ("hours", 3600)])
def test_units_of_time_as_people_write_them(tmp_path, unit, seconds):
    rows = rows_of(Pressed(TEST.time / seconds, TEST.way, TEST.load), "{:.8f},{:.4f},{:.4f}")
    test = is_whole(converted(tmp_path, [f"Time ({unit}),Position (mm),Load (N)", *rows]))
    assert test.time[-1] == pytest.approx(TEST.time[-1], rel=1e-3)


@pytest.mark.parametrize(
    "head",
    [
        ["Time (s),Position (mm),Load (furlong)"],
        ["Time,Extension,Load", "(s),(mm),(furlong)"],
        ["Time,Extension,Load", "s,mm,furlong"],
        ["Load (furlong),Time (s),Position (mm)"],
    ],
)
def test_an_unknown_unit_is_named(tmp_path, head):
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*head, *rows_of(), ""]))
    for read in (convert, lambda paths: read_measurements(paths[0])):
        with pytest.raises(InputError, match="the unit 'furlong' of Load is unknown") as caught:
            read([path])
        assert caught.value.line in (1, len(head))


def test_an_unknown_unit_of_time_is_not_asked_for_as_seconds(tmp_path):
    with pytest.raises(InputError, match="the unit 'fortnight' of Time is unknown") as caught:
        converted(tmp_path, ["Time (fortnight),Position (mm),Load (N)", *rows_of()])
    assert "--units s" not in str(caught.value)


def clock(seconds):
    return f"00:{int(seconds) // 60:02}:{seconds % 60:06.3f}"


def test_hours_minutes_and_seconds_are_read_as_seconds(tmp_path):
    pairs = list(zip(TEST.time, rows_of(), strict=True))
    rows = [f"{clock(t)},{row.partition(',')[2]}" for t, row in pairs]
    for head in (["Time (hh:mm:ss),Position (mm),Load (N)"],
                 ["Time,Extension,Load", "hh:mm:ss.fff,mm,N"]):  # fmt: skip
        test = is_whole(converted(tmp_path, [*head, *rows]))
        assert test.time[-1] == pytest.approx(TEST.time[-1])
    with pytest.raises(InputError, match="is hh:mm:ss, and its values are plain numbers"):
        converted(tmp_path, ["Time (hh:mm:ss),Position (mm),Load (N)", *rows_of()])
    day = [f"10:{clock(t)[3:]},{row}" for t, row in pairs]
    head = "Time of day,Elapsed Time (s),Position (mm),Load (N)"
    assert is_whole(converted(tmp_path, [head, *day])).time[-1] == pytest.approx(TEST.time[-1])


@pytest.mark.parametrize(
    "names", ["Zeit\tScherdeformation\tSchubspannung", "Step time\tStrain\tStress"]
)
def test_names_of_rheometers(tmp_path, names):
    sheared = Pressed(TEST.time, 5.0 * np.maximum(TEST.way, 0.0), TEST.load)
    rows = rows_of(sheared, "{:.3f}\t{:.4f}\t{:.4f}")
    found = converted(tmp_path, [names, "s\t%\tPa", *rows], "a.txt")
    assert found.units.dimensionless
    assert found.tests[0].displacement.max() == pytest.approx(0.05 * TEST.way.max(), rel=1e-3)


def rheometer(gap, force, strain, stress):
    names = "Time [s],Gap [mm],Normal Force [N],Shear Strain [%],Shear Stress [Pa]"
    cells = zip(TEST.time, gap, force, strain, stress, strict=True)
    return [names, *("{:.3f},{:.5f},{:.5f},{:.5f},{:.5f}".format(*row) for row in cells)]


def test_of_a_rheometer_s_two_motions_the_one_that_moves_is_taken(tmp_path):
    noise = 1e-3 * np.random.default_rng(3).standard_normal((2, len(TEST.time)))
    pressed_down = rheometer(6.0 - TEST.way, TEST.load, *noise)
    found = converted(tmp_path, pressed_down)
    test = is_whole(found)
    assert (test.signs.way, test.signs.load) == (-1, 1)
    assert "columns not used: Shear Strain, Shear Stress" in test.findings
    still = 1.0 + 1e-3 * noise[0]
    sheared = 5.0 * np.maximum(TEST.way, 0.0)
    found = converted(tmp_path, rheometer(still, noise[1], sheared, TEST.load))
    assert found.units.dimensionless
    with pytest.raises(InputError, match=r"both Gap and .* and Shear Strain and") as e:
        converted(tmp_path, rheometer(6.0 - TEST.way, TEST.load, 4.0 * sheared, TEST.load))
    assert "delete the two columns that are not meant" in str(e.value)


# several tests in one file


def test_names_of_a_speed_are_no_mean_specimen(tmp_path):
    means = ("Mean", "Mittelwert", "Moyenne", "Average", "Eprouvette moyenne", "Mittelwertprobe",
             "Mean curve",
             "Silicone mean", "Moyenne des éprouvettes", "Kurven Mittelwert")  # fmt: skip
    assert all(map(is_mean, means))
    tests = ("vitesse moyenne", "mean speed", "mittlere Geschwindigkeit", "velocidad media",
             "average rate", "compression moyenne")  # fmt: skip
    assert not any(map(is_mean, tests))
    pytest.importorskip("python_calamine")
    path = workbook(tmp_path / "a.xlsx", ["vitesse lente", "vitesse moyenne", "Moyenne"])
    found = convert([path])
    assert [test.test for test in found.tests] == ["vitesse lente", "vitesse moyenne"]
    (dropped,) = found.tests[0].dropped
    assert dropped == "rows of the mean specimen's sheet 'Moyenne'"


def test_a_column_without_a_unit_does_not_block_a_workbook(tmp_path):
    pytest.importorskip("python_calamine")
    table = np.stack([TEST.time, TEST.way, TEST.load], 1).tolist()
    rows = [["Zeit [s]", "Weg [mm]", "Kraft [N]", "Zyklus"], *([*row, 1] for row in table)]
    path = tmp_path / "a.xlsx"
    path.write_bytes(_workbook({"P1": rows}))
    is_whole(convert([path]))


@pytest.mark.parametrize(
    "head",
    [
        ["Raw Data", "Time (s),Displacement (mm),Force (N)"],
        ["Time,Extension,Load", "(s),(mm),(N)"],
        ["Test time (s),Standard travel (mm),Standard force (N)"],
    ],
)
def test_a_second_header_begins_a_test_where_time_falls(tmp_path, head):
    rows = rows_of()
    other = rows_of(pressed(hold=0.6, rate=50.0, seed=2))
    found = converted(tmp_path, ["Specimen 1", *head, *rows, "", "Specimen 2", *head, *other])
    assert [test.test for test in found.tests] == ["1", "2"]
    assert [len(test.time) for test in found.tests] == [len(rows)] * 2
    is_whole(converted(tmp_path, ["Specimen 1", *head, *rows[:40], *head, *rows[40:]]))


def test_time_that_falls_is_not_to_be_sorted(tmp_path):
    rows = rows_of()
    with pytest.raises(InputError, match=r"time falls from .* export each to a file") as caught:
        converted(tmp_path, ["Time (s),Position (mm),Load (N)", *rows, *rows])
    assert "sort" not in str(caught.value)


def test_a_part_without_contact_is_left_out_where_others_are_tests(tmp_path):
    noise = 1e-3 * np.random.default_rng(5).standard_normal(len(TEST.time))
    block = "<INFO>\n<{}>\n<END INFO>\n<DATA>\nTime, s\tPosition (z), mm\tFz, N\n{}\n<END DATA>\n"
    free = rows_of(Pressed(TEST.time, TEST.way, noise), "{:.3f}\t{:.4f}\t{:.5f}")
    rows = rows_of(TEST, "{:.3f}\t{:.4f}\t{:.5f}")
    blocks = block.format("Move Relative", "\n".join(free)) + block.format("Ramp", "\n".join(rows))
    found = converted(tmp_path, ["<Mach-1 File>", blocks], "a.txt")
    assert [test.test for test in found.tests] == ["2 Ramp"]
    why = "rows of '1 Move Relative', in which the force does not answer"
    assert found.tests[0].dropped == {why: len(free)}
    balanced = 1e-3 * (-1.0) ** np.arange(len(noise))
    free = rows_of(Pressed(TEST.time, TEST.way, balanced), "{:.3f}\t{:.4f}\t{:.5f}")
    with pytest.raises(InputError, match="the force does not answer to the displacement"):
        converted(tmp_path, ["<Mach-1 File>", block.format("Move", "\n".join(free))], "b.txt")


def test_a_tidy_file_may_state_its_separator(tmp_path):
    path = tmp_path / "tidy.csv"
    rows = [row.replace(",", ";").replace(".", ",") for row in rows_of()]
    path.write_text("\n".join(["sep=;", "time_s;displacement_mm;force_N", *rows, ""]))
    (test,) = read_measurements(path).pads[0].tests
    assert test.force.max() == pytest.approx(TEST.load.max(), abs=1e-3)
    path.write_text("\n".join(["sep=;", "time_s;displacement_mm;force_N", *rows, "1;x;2", ""]))
    with pytest.raises(InputError, match="displacement_mm is not a number") as caught:
        read_measurements(path)
    assert caught.value.line == len(rows) + 3


# columns


@pytest.mark.parametrize(
    "names",
    [
        "Zeit / s;Weg / mm;Kraft / N",  # ISO 80000-1: a quantity over its unit
        "Zeit in s;Weg in mm;Kraft in N",
        "time in seconds,displacement in millimeters,force in newtons",
        "TIME_S,DISPLACEMENT_MM,FORCE_N",
        "t [s],x [mm],F [N]",
        "Tijd (s);Verplaatsing (mm);Kracht (N)",
        "時間(s),変位(mm),荷重(N)",
        "Time (s),Crosshead (mm),Load cell (N),Temperature (°C)",
        "Czas,Droga,Siła\n[s],[mm],[N]",
    ],
)
def test_units_show_which_column_is_which(tmp_path, names):
    mark = ";" if ";" in names else ","
    more = f"{mark}23.1" if "Temperature" in names else ""
    rows = [row.replace(",", mark) + more for row in rows_of()]
    is_whole(converted(tmp_path, [*names.split("\n"), *rows]))


def test_a_channel_before_a_name_is_no_part_of_it(tmp_path):
    """Walter+Bai writes two displacements of one channel, and a separator after the last."""
    cells = zip(TEST.time, TEST.load, 0.3 * TEST.way, TEST.way, strict=True)
    rows = [f"{k};{t:.3f};{f:.4f};{own:.4f};{d:.4f};" for k, (t, f, own, d) in enumerate(cells)]
    names = "S/No;C_1_Temps[s];C_1_Force[kN];C_1_Déform1[mm];C_1_Déplacement[mm];"
    is_whole(converted(tmp_path, [names, *rows]), force=1e3)


def test_a_crosshead_in_french_side_by_side(tmp_path):
    cells = (f"{t:.3f},{f:.4f},{d:.4f}" for t, d, f in zip(*vars(TEST).values(), strict=True))
    other = (f"{t:.3f},{2 * f:.4f},{d:.4f}" for t, d, f in zip(*vars(TEST).values(), strict=True))
    head = ["Brut,,,Recuit 250°C,,", "Temps,Force,Course_Traverse," * 2, "sec,N,mm," * 2]
    found = converted(
        tmp_path,
        [*(line.rstrip(",") for line in head), *map(",".join, zip(cells, other, strict=True))],
    )
    assert [test.named for test in found.tests] == ["Brut", "Recuit 250°C"]


@pytest.mark.parametrize(
    ("head", "shown"),
    [
        (["A;B;C;", "s;N;N;"], "A, B, C, 4"),  # the names, not the units below them
        (["A;B;C;"], "A, B, C, 4"),
        ([], "1, 2, 3, 4"),
    ],
)
def test_a_question_for_columns_shows_what_may_be_stated(tmp_path, head, shown):
    rows = [f"{row.replace(',', ';')};" for row in rows_of()]
    with pytest.raises(UnsureError, match=f"the file has: {shown}"):
        converted(tmp_path, [*head, *rows])


def test_an_indenter_of_two_load_cells_has_one_force(tmp_path):
    """Anton Paar's bioindenter: Pd is the penetration depth, FnRef the reference's force."""
    rows = [f"{row.replace(',', chr(9))}\t5.35\t1" for row in rows_of()]
    names = "Time (s)\tPd (µm)\tFn (µN)\tFnRef (µN)\tSegmentID"
    found = converted(tmp_path, ["Date :6/9/2026", "Measured values", names, "", *rows])
    assert is_whole(found).units.force == "uN"


def test_two_columns_in_one_unit_are_not_chosen_between(tmp_path):
    rows = [f"{row},{row.rpartition(',')[2]}" for row in rows_of()]
    with pytest.raises(
        UnsureError, match=r"the file has: t .s., x .mm., cell 1 .N., cell 2"
    ) as told:
        converted(tmp_path, ["t (s),x (mm),cell 1 (N),cell 2 (N)", *rows])
    assert told.value.option == "columns"
    stated = Answers.from_words(columns="t, x, cell 2")
    is_whole(convert([tmp_path / "a.csv"], stated))


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


def test_known_names_without_units_are_asked_for_them(tmp_path):
    with pytest.raises(UnsureError, match=r"'Time' .* has no unit") as told:
        converted(tmp_path, ["Time,Position,Force", *rows_of()])
    assert told.value.option == "units"
    is_whole(convert([tmp_path / "a.csv"], Answers.from_words(units="s,mm,N")))


@pytest.mark.parametrize(
    ("head", "mark", "columns", "units"),
    [
        (["t,x,F"], ",", "t,x,F", "s,mm,N"),
        (["t,x,F"], ",", "T,X,f", "s,mm,N"),  # other capitals
        (["t,x,F", "s,mm,N"], ",", "t,x,F", None),
        (["t_s,x_mm,F_N"], ",", "t,x,F", None),
        ([], ",", "1,2,3", "s,mm,N"),
        (["a preamble; of the logger", "Время, с;Перемещение, мм;Сила, Н"], ";", "1,2,3", "s,mm,N"),
        (["# time position force"], " ", "1,2,3", "s,mm,N"),  # numpy.savetxt
        (["% time   position   force"], "   ", "time,position,force", "s,mm,N"),
    ],
)
def test_stated_columns_are_read(tmp_path, head, mark, columns, units):
    rows = [row.replace(",", mark) for row in rows_of()]
    (tmp_path / "a.csv").write_text("\n".join([*head, *rows, ""]), encoding="utf-8")
    answers = Answers.from_words(columns=columns, units=units)
    test = is_whole(convert([tmp_path / "a.csv"], answers))
    assert test.time[-1] == pytest.approx(TEST.time[-1] - TEST.time[0], abs=2e-3)


def test_stated_columns_may_stand_in_any_order_with_decimal_commas(tmp_path):
    cells = zip(TEST.load, TEST.way, TEST.time, strict=True)
    rows = [f"{f:.4f};{d:.4f};{t:.3f};on".replace(".", ",") for f, d, t in cells]
    (tmp_path / "a.csv").write_text("\n".join(["A;B;C;D", *rows, ""]))
    is_whole(convert([tmp_path / "a.csv"], Answers.from_words(columns="C,B,A", units="s,mm,N")))


def test_each_repetition_of_the_stated_names_is_a_test(tmp_path):
    second = pressed(hold=0.6, rate=50.0, seed=2)
    lines = ["t,x,F", *rows_of(), "t,x,F", *rows_of(second), ""]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    answers = Answers.from_words(columns="t,x,F", units="s,mm,N")
    assert [len(test.time) for test in convert([tmp_path / "a.csv"], answers).tests] == [
        len(TEST.time)
    ] * 2


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ("t,x", "not three different columns; write the names"),
        ("t,x,x", "not three different columns"),
        ("t,x,Q", r"columns t, x and Q are not there \(the file has: t, x, F\)"),
        ("1,2,9", "columns 1, 2 and 9 are not there"),
        ("0,1,2", "columns 0, 1 and 2 are not there"),
    ],
)
def test_columns_that_are_not_there_are_refused(tmp_path, columns, says):
    (tmp_path / "a.csv").write_text("\n".join(["t,x,F", *rows_of(), ""]))
    with pytest.raises(InputError, match=says):
        convert([tmp_path / "a.csv"], Answers.from_words(columns=columns, units="s,mm,N"))


def test_a_header_that_is_nearly_tidy_is_to_be_mended(tmp_path):
    """Read as a machine's, its column of tests would be lost."""
    rows = [f"slow,{row}" for row in rows_of()]
    with pytest.raises(InputError, match=r"line 1: .* rename 'load_N' to force_N"):
        converted(tmp_path, ["test,time_s,displacement_mm,load_N", *rows])


def test_decimal_commas_between_commas_are_refused_with_the_line(tmp_path):
    rows = [row.replace(".", ",") for row in rows_of()]
    with pytest.raises(InputError, match=r"line 2: 6 numbers are below 3 names.*semicolons"):
        converted(tmp_path, ["Time (s),Displacement (mm),Force (N)", *rows])


def test_dates_with_hours_are_a_clock_that_goes_on_at_midnight(tmp_path):
    start = np.datetime64("2026-02-28T23:59:59.5")
    dates = start + np.round(1e3 * TEST.time).astype("timedelta64[ms]")
    cells = zip(dates, TEST.way, TEST.load, strict=True)
    rows = [f"{str(when).replace('T', ' ')},{d:.4f},{f:.4f}" for when, d, f in cells]
    assert len({row[:10] for row in rows}) == 2  # two days
    test = is_whole(converted(tmp_path, ["Timestamp,Position (mm),Load (N)", *rows]))
    np.testing.assert_allclose(test.time, TEST.time - TEST.time[0], atol=1e-3)


# what would be read wrongly


@pytest.mark.parametrize(
    "second",
    [
        ["Time,Displacement,Force", "s,mm,mN"],
        ["Time,Force,Displacement", "s,N,mm"],
        ["Time (s),Temp (C),Displacement (mm),Force (N)"],
        ["s,um,N"],
    ],
)
@pytest.mark.parametrize("restarts", [True, False])
def test_other_names_or_units_below_are_refused_with_their_line(tmp_path, second, restarts):
    later = pressed(hold=0.6, rate=50.0)
    shift = 0.0 if restarts else 1.0 + TEST.time[-1] - TEST.time[0]
    rows = rows_of(Pressed(later.time + shift, later.way, later.load))
    first = ["Time,Displacement,Force", "s,mm,N", *rows_of()]
    with pytest.raises(InputError, match="names or units other than those above") as told:
        converted(tmp_path, [*first, *second, *rows])
    assert len(first) < told.value.line <= len(first) + len(second)


def test_units_above_and_below_the_names_must_agree(tmp_path):
    names = "Time (s),Displacement (mm),Force (N)"
    is_whole(converted(tmp_path, [names, "(s),(mm),(N)", *rows_of()]))
    with pytest.raises(InputError, match="line 2: names or units other"):
        converted(tmp_path, [names, "ms,um,mN", *rows_of()])


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_column_of_specimens_divides_a_table(tmp_path, goes_on):
    shift = 5.0 if goes_on else 0.0
    second = rows_of(Pressed(TEST.time + shift, TEST.way, 1.1 * TEST.load))
    rows = [*(f"A,{row}" for row in rows_of()), *(f"B,{row}" for row in second)]
    found = converted(tmp_path, ["Specimen,Time (s),Disp (mm),Force (N)", *rows])
    assert [(test.named, len(test.time)) for test in found.tests] == [
        ("A", len(TEST.time)),
        ("B", len(TEST.time)),
    ]


def test_a_counter_divides_nothing(tmp_path):
    rows = [f"{k},{row}" for k, row in enumerate(rows_of())]
    is_whole(converted(tmp_path, ["Test,Time (s),Disp (mm),Force (N)", *rows]))


@pytest.mark.parametrize("name", ["FORCE_MN", "LOAD (MN)"])
def test_capitals_do_not_tell_a_thousandth_from_a_million(tmp_path, name):
    with pytest.raises(UnsureError, match="the file has: TIME_S, DISP_MM"):
        converted(tmp_path, [f"TIME_S,DISP_MM,{name}", *rows_of()])
    stated = Answers.from_words(columns="1,2,3", units="s,mm,mN")
    assert convert([tmp_path / "a.csv"], stated).units.force == "mN"


@pytest.mark.parametrize(
    "footer",
    [
        ["Average,4.0,3.46", "99.99,9.0,77.0"],
        ["", "99.99,9.0,77.0"],
        ["", "Max,,3.46", "Mean,,2.8", "99.99,9.0,77.0"],
        ["Average,4.0,3.46"],
    ],
)
def test_numbers_below_a_table_are_none_of_its_rows(tmp_path, footer):
    is_whole(converted(tmp_path, ["Time (s),Disp (mm),Force (N)", *rows_of(), *footer]))


def test_a_table_that_goes_on_after_a_gap_is_whole(tmp_path):
    rows = rows_of()
    lines = [*rows[:-9], "", *rows[-9:]]
    is_whole(converted(tmp_path, ["Time (s),Disp (mm),Force (N)", *lines]))


def test_names_that_pandas_has_numbered_are_repeated(tmp_path):
    names = "Time (s),Disp (mm),Force (N)"
    other = rows_of(pressed(hold=0.6, rate=50.0, seed=2))
    again = ",".join(f"{name}.1" for name in names.split(","))
    found = converted(
        tmp_path, [f"{names},{again}", *map(",".join, zip(rows_of(), other, strict=True))]
    )
    assert [len(test.time) for test in found.tests] == [len(TEST.time)] * 2


def test_a_table_without_displacement_does_not_lack_its_time(tmp_path):
    rows = [f"{0.1 * k:.1f},{k},7" for k in range(30)]
    with pytest.raises(InputError, match=r"the file has: Time .s., Force .N., State"):
        converted(tmp_path, ["Time (s),Force (N),State", *rows])


def test_a_force_in_ten_units_is_none_in_its_unit(tmp_path):
    with pytest.raises(UnsureError, match=r"the file has: t .s., x .mm., Force x10 .N."):
        converted(tmp_path, ["t (s),x (mm),Force x10 (N)", *rows_of()])


def test_a_contact_beyond_the_largest_depth_is_refused(tmp_path):
    names = "Time (s),Disp (mm),Force (N)"
    (tmp_path / "a.csv").write_text("\n".join([names, *rows_of(), ""]))
    with pytest.raises(
        InputError, match=r"--contact 50 lies outside the travel, -0\.4 mm at the start and 1\.2"
    ):
        convert([tmp_path / "a.csv"], Answers.from_words(contact="50"))


@pytest.mark.parametrize(
    ("head", "cells", "says"),
    [
        ("Time,Displacement,Force", "{} s,{} mm,{} N", "line 2: '0.000 s' is no number"),
        (
            "Time (s),Displacement (mm),Force (N)",
            "1:{} PM,{},{}",
            r"line 2: .* \(the first line is '1:0",
        ),
        ("Position (mm),Force (N)", "{1},{2}", "line 1: there is no column of time"),
        ("Index,Position (mm),Force (N)", "7,{1},{2}", "line 1: there is no column of time"),
        ("Time_s,Displacement_mm", "{0},{1}", r"line 1: there is no column of force .*; export"),
        ("time_s,displacement_mm,T", "{0},{1},20", r"line 1: no column for force .*; the columns"),
    ],
)
def test_cells_that_are_no_numbers_are_shown(tmp_path, head, cells, says):
    begun = Pressed(TEST.time - TEST.time[0], TEST.way, TEST.load)
    rows = [cells.format(*row.split(",")) for row in rows_of(begun)]
    with pytest.raises(InputError, match=says):
        converted(tmp_path, [head, *rows])


@pytest.mark.parametrize(
    "names",
    [
        "# time [s] displacement [mm] force [N]",  # numpy.savetxt
        "Time (s)  Displacement (mm)  Force (N)",
        "Time/s Disp/mm Force/N",
        "# time_s displacement_mm force_N",
    ],
)
def test_names_and_numbers_between_blanks(tmp_path, names):
    is_whole(converted(tmp_path, [names, *(row.replace(",", "  ") for row in rows_of())]))


def test_names_as_matlab_writes_them(tmp_path):
    is_whole(converted(tmp_path, ["Time_s_,Displacement_mm_,Force_N_", *rows_of()]))


def test_a_clock_goes_on_at_midnight_without_a_date(tmp_path):
    seconds = 86399.5 + TEST.time
    clock = [f"{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:06.3f}" for s in seconds]
    cells = zip(clock, TEST.way, TEST.load, strict=True)
    rows = [f"{when},{d:.4f},{f:.4f}" for when, d, f in cells]
    assert rows[-1].startswith("00:")
    test = is_whole(converted(tmp_path, ["Time,Disp (mm),Force (N)", *rows]))
    np.testing.assert_allclose(test.time, TEST.time - TEST.time[0], atol=2e-3)


def test_units_are_reported_as_they_were_stated(tmp_path):
    (tmp_path / "a.csv").write_text("\n".join(["t,x,F", *rows_of(), ""]))
    stated = Answers.from_words(columns="t,x,F", units="s,mm,kgf")
    (test,) = convert([tmp_path / "a.csv"], stated).tests
    assert "F in kgf (as stated by the user)" in test.findings[0]
