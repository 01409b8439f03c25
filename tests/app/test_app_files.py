"""Check what is dropped onto the bench: files of any kind."""

import json
import shlex

import pytest
from support.endtoend import call
from support.machine_files import workbook

from qlvbayes.app.intake import read_in
from qlvbayes.app.job import write_pad
from qlvbayes.app.scripts import commands, script
from qlvbayes.app.sessions import BenchPad, HistoryState, Session
from qlvbayes.app.specimens import pads_by
from qlvbayes.cli.main import run
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements

UNCLEAR = "# a rig's own\nZeit;Weg (um);Last\n" + "".join(
    f"{0.01 * k:.2f};{min(10.0 * k, 1000.0):.1f};{min(0.01 * k, 1.0) ** 1.5:.4f}\n"
    for k in range(300)
)
TIDY = "pad,test,time_s,displacement_mm,force_N\n" + "".join(
    f"B,slow,{0.01 * k:.2f},{min(0.01 * k, 1.0):.3f},{0.5 * min(0.01 * k, 1.0):.4f}\n"
    for k in range(300)
)
ANSWERS = {
    "time": "Zeit", "displacement": "Weg (um)", "force": "Last",
    "time_unit": "s", "displacement_unit": "um", "force_unit": "mN",
}  # fmt: skip


def test_a_tidy_file_is_taken_as_it_is(tmp_path):
    file = tmp_path / "tidy.csv"
    file.write_text(TIDY)
    found = read_in(tmp_path / "session", [file], {})
    with open(found["data"]) as data:
        assert data.read() == TIDY


def test_several_tidy_files_become_one(tmp_path):
    files = [tmp_path / "one.csv", tmp_path / "two.csv"]
    files[0].write_text(TIDY)
    files[1].write_text(TIDY.replace("B,slow", "B,fast"))
    study = read_measurements(read_in(tmp_path / "session", files, {})["data"])
    assert [test.name for test in study.pad("B").tests] == ["slow", "fast"]
    assert (study.pad("B").tests[1].force == study.pad("B").tests[0].force).all()


def test_unknown_columns_are_asked_for_and_then_read(tmp_path):
    file = tmp_path / "unclear.csv"
    file.write_text(UNCLEAR)
    asked = read_in(tmp_path / "session", [file], {})["questions"]
    assert asked["rows"][0] == ["Zeit", "Weg (um)", "Last"]
    values = {one["name"]: one["value"] for one in asked["ask"]}
    assert values["time"] == "Zeit"
    assert (values["displacement"], values["displacement_unit"]) == ("Weg (um)", "um")
    assert values["force"] is None
    assert "line 2" in asked["text"]
    study = read_measurements(read_in(tmp_path / "session", [file], ANSWERS)["data"])
    (test,) = study.pads[0].tests
    assert (study.units.displacement, study.units.force) == ("um", "mN")
    assert len(test.time) == 300
    assert test.displacement.max() == 1000.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force": ""}, "no column is chosen as the force"),
        ({"force": "Zeit"}, "chosen as two quantities"),
        ({"force_unit": "lb"}, "unit of force"),
    ],
)
def test_answers_that_are_none_are_told(tmp_path, change, message):
    file = tmp_path / "unclear.csv"
    file.write_text(UNCLEAR)
    with pytest.raises(InputError, match=message):
        read_in(tmp_path / "session", [file], {**ANSWERS, **change})


def test_a_bad_row_under_unknown_columns_keeps_its_line_and_its_files_name(tmp_path):
    file = tmp_path / "unclear.csv"
    lines = UNCLEAR.split("\n")
    lines[50:52] = [lines[50].replace("0.48", "0.01"), lines[51].replace("0.49", "0.02")]
    file.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"^unclear.csv, line 51: "):
        read_in(tmp_path / "session", [file], ANSWERS)
    assert not (tmp_path / "session" / "data.csv").exists()


@pytest.fixture
def specimens(tmp_path):
    """A workbook of two specimens, with two tests and one."""
    pytest.importorskip("openpyxl")
    return workbook(tmp_path / "two pads.xlsx", ["AA1", "AA2", "BB1"])


def test_which_test_is_of_which_pad_is_asked_where_a_file_holds_several(tmp_path, specimens):
    asked = read_in(tmp_path / "session", [specimens], {})["questions"]
    assert asked["kind"] == "specimens"
    assert asked["text"].startswith("two pads.xlsx holds 3 tests.")
    assert [row[0] for row in asked["rows"][1:]] == asked["names"] == ["AA1", "AA2", "BB1"]
    assert pads_by(asked["names"], asked["pad_from"]) == ["AA", "AA", "BB"]
    values = {one["name"]: one["value"] for one in asked["ask"]}
    assert values == {"specimens": "one", "pad0": "AA", "pad1": "AA", "pad2": "BB"}
    assert not (tmp_path / "session" / "data.csv").exists()


def test_a_file_with_one_test_asks_for_no_pads(tmp_path):
    pytest.importorskip("openpyxl")
    one = workbook(tmp_path / "one.xlsx", ["AA1"])
    assert "data" in read_in(tmp_path / "session", [one], {})


@pytest.mark.parametrize(
    ("answers", "tests"),
    [
        ({"specimens": "one"}, {"pad": ["AA1", "AA2", "BB1"]}),
        (
            {"specimens": "several", "pad0": "x y", "pad1": "B", "pad2": "x y"},
            {"x y": ["AA1", "BB1"], "B": ["AA2"]},
        ),
    ],
)
def test_the_command_of_a_session_divides_the_tests_as_the_answers_did(
    tmp_path, monkeypatch, specimens, answers, tests
):
    folder = tmp_path / "session"
    found = read_in(folder, [specimens], answers)
    study = read_measurements(found["data"])
    assert {pad.name: [test.name for test in pad.tests] for pad in study.pads} == tests
    assert not any("--pad-from" in text for text in found["notices"])
    pad = study.pads[0].name
    begun = HistoryState(0, None, "start", "exponential", "prony:2", [], {}, 0.1)
    session = Session("s", folder, folder, specimens.name, data=found["data"], made=found["made"])
    session.pads, session.bench = list(tests), {pad: BenchPad(history=[begun])}
    session.save()
    again = Session("s", folder, folder, "", pads=list(tests))
    again.load()
    line = commands(again, pad).splitlines()[0]
    assert line in eval(script(again, pad).split("\n")[0])  # its first statement is a text
    monkeypatch.chdir(tmp_path)
    status, _, err = call(*shlex.split(line)[1:])
    assert status == 0, err
    repeated = read_measurements(tmp_path / "data.csv")
    for one, other in zip(repeated.pads, study.pads, strict=True):
        assert (one.name, [t.name for t in one.tests]) == (
            other.name,
            [t.name for t in other.tests],
        )
        for mine, its in zip(one.tests, other.tests, strict=True):
            assert (mine.displacement == its.displacement).all()
            assert (mine.force == its.force).all()


def test_a_stranger_s_session_can_add_no_other_option_to_the_command(tmp_path):
    made = {"files": ["a.xlsx"], "options": {"formats-file": "evil.py"}}
    Session("s", tmp_path, tmp_path, "a.xlsx", made=made).save()
    again = Session("s", tmp_path, tmp_path, "")
    again.load()
    assert again.made is None


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        ({}, "test 1 has no pad"),
        ({"pad0": "A", "pad2": "A"}, "test 2 has no pad"),
        ({"pad0": "A", "pad1": "A,B", "pad2": "A"}, "the name 'A,B' cannot be used"),
        ({"pad0": "A", "pad1": "a", "pad2": "B"}, "differ in upper and lower case only"),
        ({"pad0": "A", "pad1": "compare", "pad2": "B"}, "that of a file of results"),
        ({"pad0": "A", "pad1": "B"}, "names 2 pads; the number of files is 1, that of tests 3"),
    ],
)
def test_pads_that_cannot_be_named_so_are_told(tmp_path, specimens, answers, message):
    with pytest.raises(InputError, match=message):
        read_in(tmp_path / "session", [specimens], {"specimens": "several", **answers})
    assert not (tmp_path / "session" / "data.csv").exists()


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("(A", "'(A' is no pattern"),
        ("x", "'x' finds nothing in the name 'aaa"),
        ("(a+)+$", "takes too long"),
    ],
)
def test_a_pattern_of_no_use_is_told_in_a_line(pattern, message, monkeypatch):
    monkeypatch.setattr("qlvbayes.app.specimens._PATIENCE", 0.5)  # s
    with pytest.raises(InputError) as refused:
        pads_by(["a" * 40 + "!"], pattern)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"\x7fELF\0\0\0\0", b"nothing\nhere\n"])
def test_what_holds_no_table_is_told(tmp_path, content):
    file = tmp_path / "other.csv"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"^other\.csv"):
        read_in(tmp_path / "session", [file], {})


def test_a_dealt_pad_repeats_and_does_not_tell(tmp_path):
    texts = []
    for name in ("one", "two"):
        write_pad(tmp_path / name / "data.csv", tmp_path / name / "truth.json", 5)
        texts.append((tmp_path / name / "data.csv").read_text())
    truth = json.loads((tmp_path / "one" / "truth.json").read_text())
    assert texts[0] == texts[1]
    assert all(effect["effect"] not in texts[0] for effect in truth["effects"])
    assert len(read_measurements(tmp_path / "one" / "data.csv").pad("pad").tests) == 6


def test_without_the_extra_one_line_says_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setattr("qlvbayes.cli.app._NEEDED", ("no_such_package",))
    monkeypatch.setattr("sys.argv", ["qlvbayes", "app"])
    with pytest.raises(SystemExit) as stopped:
        run()
    assert stopped.value.code == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "pip install 'qlvbayes[app]'" in line


def test_a_file_that_is_not_there_is_told_before_anything_starts(monkeypatch, capsys):
    monkeypatch.setattr("qlvbayes.cli.app._NEEDED", ())
    monkeypatch.setattr("sys.argv", ["qlvbayes", "app", "none.csv"])
    with pytest.raises(SystemExit) as stopped:
        run()
    assert stopped.value.code == 2
    assert "none.csv: no such file" in capsys.readouterr().err
