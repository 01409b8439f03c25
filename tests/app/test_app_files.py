"""Check what is dropped onto the bench: files of any kind."""

import shlex
from pathlib import Path

import pytest
from support.endtoend import call
from support.machine_files import workbook

from qlvbayes.app.intake import read_in
from qlvbayes.app.sessions import BenchPad, HistoryState, Made, Session, commands
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements

UNCLEAR = "# a rig's own\nfirst;second;third\n" + "".join(
    f"{0.01 * k:.2f};{min(10.0 * k, 1000.0):.1f};{min(0.01 * k, 1.0) ** 1.5:.4f}\n"
    for k in range(300)
)
TIDY = "pad,test,time_s,displacement_mm,force_N\n" + "".join(
    f"B,slow,{0.01 * k:.2f},{min(0.01 * k, 1.0):.3f},{0.5 * min(0.01 * k, 1.0):.4f}\n"
    for k in range(300)
)
COLUMNS = {"time": "1: first", "displacement": "2: second", "force": "3: third"}
UNITS = {"time_unit": "s", "displacement_unit": "um", "force_unit": "mN"}


def written(tmp_path, content):
    file = tmp_path / "own.csv"
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file


def repeated(tmp_path, monkeypatch, session):
    """The measurements that a session's first command makes of the same files."""
    line = commands(session, session.pads[0]).splitlines()[0]
    monkeypatch.chdir(tmp_path)
    status, _, err = call(*shlex.split(line)[1:])
    assert status == 0, err
    return read_measurements(tmp_path / "data.csv")


def session_of(folder, file, found):
    """A session with one model of each pad, stored and opened again."""
    study = read_measurements(found["data"])
    begun = HistoryState(0, None, "start", "exponential", "prony:2", [], {}, 0.1)
    session = Session("s", folder, folder, file.name, data=found["data"])
    session.made = Made(**found["made"])
    session.bench = {pad.name: BenchPad(history=[begun]) for pad in study.pads}
    session.save()
    again = Session("s", folder, folder, "", pads=[pad.name for pad in study.pads])
    again.load()
    return again, study


def test_a_tidy_file_is_taken_as_it_is(tmp_path):
    file = written(tmp_path, TIDY)
    assert Path(read_in(tmp_path / "session", [file], {})["data"]).read_text() == TIDY
    with pytest.raises(InputError, match="2 files in tidy form"):
        read_in(tmp_path / "session", [file, file], {})


def test_unknown_columns_and_units_are_asked_for_and_then_read(tmp_path, monkeypatch):
    """As ``convert`` asks for them, so that the command of the session reads the file so, too."""
    file, folder = written(tmp_path, UNCLEAR), tmp_path / "session"
    asked = read_in(folder, [file], {})["questions"]
    assert [one["name"] for one in asked["ask"]] == list(COLUMNS)
    assert asked["ask"][0]["choices"] == list(COLUMNS.values())
    assert asked["lines"].splitlines()[1] == "first;second;third"
    then = read_in(folder, [file], COLUMNS)["questions"]
    assert [one["name"] for one in then["ask"]] == list(UNITS)
    found = read_in(folder, [file], COLUMNS | UNITS)
    session, study = session_of(folder, file, found)
    (test,) = study.pads[0].tests
    assert (study.units.displacement, study.units.force) == ("um", "mN")
    assert test.displacement.max() == pytest.approx(1000.0, abs=20.0)  # from its contact
    again = repeated(tmp_path, monkeypatch, session).pads[0].tests[0]
    assert (again.displacement == test.displacement).all()
    assert (again.force == test.force).all()


@pytest.mark.parametrize("change", [{"force": "1: first"}, {"force_unit": "s"}, {"force": ""}])
def test_answers_that_are_none_are_told_and_leave_nothing(tmp_path, change):
    with pytest.raises(InputError):
        read_in(tmp_path / "s", [written(tmp_path, UNCLEAR)], {**COLUMNS, **UNITS, **change})
    assert not (tmp_path / "s" / "data.csv").exists()
    for content in (b"", b"\x7fELF\0\0\0\0", b"nothing\nhere\n"):  # which holds no table
        with pytest.raises(InputError) as refused:
            read_in(tmp_path / "s", [written(tmp_path, content)], {})
        assert refused.value.file == "own.csv"
        assert str(tmp_path) not in str(refused.value)


@pytest.fixture
def specimens(tmp_path):
    """A workbook of two specimens, with two tests and one."""
    pytest.importorskip("openpyxl")
    return workbook(tmp_path / "two pads.xlsx", ["AA1", "AA2", "BB1"])


def test_which_test_is_of_which_pad_is_asked_where_a_file_holds_several(tmp_path, specimens):
    asked = read_in(tmp_path / "session", [specimens], {})["questions"]
    assert [row[0] for row in asked["rows"][1:]] == ["AA1", "AA2", "BB1"]
    values = {one["name"]: one["value"] for one in asked["ask"]}
    assert values == {"specimens": "one", "pad0": "AA", "pad1": "AA", "pad2": "BB"}
    one = workbook(tmp_path / "one.xlsx", ["AA1"])
    assert "data" in read_in(tmp_path / "session", [one], {})


@pytest.mark.parametrize(
    ("answers", "tests"),
    [({"specimens": "one"}, {"pad": ["AA1", "AA2", "BB1"]}),
     ({"specimens": "several", "pad0": "x y", "pad1": "B", "pad2": "x y"},
      {"x y": ["AA1", "BB1"], "B": ["AA2"]})],
)  # fmt: skip
def test_the_command_of_a_session_divides_the_tests_as_the_answers_did(
    tmp_path, monkeypatch, specimens, answers, tests
):
    folder = tmp_path / "session"
    session, study = session_of(folder, specimens, read_in(folder, [specimens], answers))
    again = repeated(tmp_path, monkeypatch, session)
    for found in (study, again):
        assert {pad.name: [test.name for test in pad.tests] for pad in found.pads} == tests
    for one, other in zip(again.pads, study.pads, strict=True):
        for mine, its in zip(one.tests, other.tests, strict=True):
            assert (mine.displacement == its.displacement).all()
            assert (mine.force == its.force).all()


@pytest.mark.parametrize(
    "pads", [(), ("A", None, "A"), ("A", "A,B", "A"), ("A", "a", "B"), ("A", "compare", "B"), "AB"]
)
@pytest.mark.few(3)
def test_pads_that_cannot_be_named_so_are_told(tmp_path, specimens, pads):
    named = {f"pad{k}": pad for k, pad in enumerate(pads) if pad}
    with pytest.raises(InputError):
        read_in(tmp_path / "session", [specimens], {"specimens": "several", **named})
    assert not (tmp_path / "session" / "data.csv").exists()


@pytest.mark.parametrize(
    ("needed", "words", "said"),
    [(("no_such_package",), [], "pip install 'qlvbayes[app]'"), ((), ["none.csv"], "none.csv")],
)
def test_what_lacks_is_told_in_a_line_before_anything_starts(monkeypatch, needed, words, said):
    monkeypatch.setattr("qlvbayes.cli.app._NEEDED", needed)
    status, _, err = call("app", *words)
    assert status == 2
    assert said in err
    assert err.count("\n") == 1
