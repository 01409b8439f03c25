"""``qlvbayes convert``, and machine files where tidy ones are expected."""

import os
import pty
import subprocess

import numpy as np
import pytest
from support.endtoend import COMMAND, call, environment
from support.machine_files import CORPUS, STORED, of_layout

from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import convert, in_short, tidy_text
from qlvbayes.io.data import read_measurements
from qlvbayes.io.loading import Answers
from qlvbayes.motion.experiment import prepare
from qlvbayes.plots import figure_of, plot_conversion

CYCLES = (CORPUS / "other" / "cycles-cellscale.csv").read_bytes()


@pytest.fixture
def instron(tmp_path):
    """A file of Bluehill 3: both columns negative when pressed, contact at -3 mm."""
    path = tmp_path / "press.csv"
    path.write_bytes(of_layout("bluehill-3-a.csv").read_bytes())
    return path


def test_what_was_found_is_told_and_drawn_and_the_study_can_be_read(instron, tmp_path):
    out = tmp_path / "tidy.csv"
    status, said, err = call("convert", instron, "-o", out, "--pad", "B", drawn=True)
    assert (status, err) == (0, "")
    assert f"next:\n  qlvbayes study {out} -o {out.with_name('tidy_results')}\n" in said
    assert (tmp_path / "tidy.png").stat().st_size > 10_000
    (pad,) = read_measurements(out).pads
    (test,) = pad.tests
    assert (pad.name, test.name) == ("B", "pad B")
    ramp = prepare(pad).trials[0]
    assert ramp.rate == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize(
    "name",
    ["machines/bluehill-3-a.csv", "machines/mach-1-b.txt", "machines/two-clocks-b.csv",
     "machines/hdf5-b.h5", "read/converted_creep_says_what_is_prescribed-1.csv"],
)  # fmt: skip
def test_a_machine_s_file_is_read_unasked_like_its_conversion(name, tmp_path):
    source, out = CORPUS / name, tmp_path / "tidy.csv"
    assert call("convert", source, "-o", out)[0] == 0
    one, other = read_measurements(source), read_measurements(out)
    assert any("read as" in notice for notice in one.notices)
    assert [pad.name for pad in one.pads] == [pad.name for pad in other.pads]
    assert one.units == other.units
    for mine, yours in zip(one.pads, other.pads, strict=True):
        for a, b in zip(mine.tests, yours.tests, strict=True):
            for key in ("name", "start_known", "contact_stage", "control"):
                assert getattr(a, key) == getattr(b, key)
            assert (a.contact_sd or 0.0) == pytest.approx(b.contact_sd or 0.0, rel=1e-2)
            assert a.start_s == pytest.approx(b.start_s, abs=1e-6)
            for key in ("time", "displacement", "force"):
                peak = np.abs(getattr(a, key)).max()
                np.testing.assert_allclose(getattr(a, key), getattr(b, key), atol=1e-9 * peak)


def test_what_is_the_same_of_several_tests_stands_once():
    lines = ["a: units mm", "b: units mm", "a: 5 rows", "b: 6 rows", "columns not used"]
    assert in_short(lines) == ["2 tests: units mm", "a: 5 rows", "b: 6 rows", "columns not used"]


def test_what_is_in_doubt_is_refused_in_a_pipe(tmp_path):
    source = tmp_path / "a.csv"
    source.write_bytes(CYCLES)
    status, said, err = call("convert", source, "-o", tmp_path / "tidy.csv")
    assert (status, said, err.count("\n")) == (2, "", 1)
    assert "the direction that presses cannot be determined" in err
    assert "--sign none|displacement|force|both" in err
    assert not (tmp_path / "tidy.csv").exists()
    with pytest.raises(InputError, match=rf"say it to qlvbayes look {source} -o tidy.csv --sign"):
        read_measurements(source)


def test_what_is_in_doubt_is_asked_on_a_terminal(tmp_path):
    source, out = tmp_path / "a.csv", tmp_path / "tidy.csv"
    source.write_bytes(CYCLES)
    ours, theirs = pty.openpty()
    line = [str(COMMAND), "convert", str(source), "-o", str(out), "--contact", "file"]
    process = subprocess.Popen(
        line, stdin=theirs, stdout=theirs, stderr=theirs, env={**environment(), "TERM": "dumb"}
    )
    os.close(theirs)
    os.write(ours, b"none\n")
    shown = b""
    try:
        while part := os.read(ours, 4096):
            shown += part
    except OSError:  # the other end is closed
        pass
    assert process.wait(timeout=900) == 0
    assert b"which columns are to be turned over" in shown
    assert b"sign kept as written, as stated by the user" in shown
    np.testing.assert_allclose(
        read_measurements(out).pads[0].tests[0].force, np.sin(9.0 * STORED.time), atol=1e-6
    )


def test_several_files_several_pads_and_their_clock(tmp_path):
    files = []
    for name, clock in (("one", "10:00:00"), ("two", "10:05:00"), ("three", "10:10:00")):
        files.append(tmp_path / f"{name}.csv")
        text = of_layout("testsuite-a.csv").read_bytes().replace(b"10:00:00", clock.encode())
        files[-1].write_bytes(text.replace(b"pad 7", name.encode()))
    out = tmp_path / "tidy.csv.gz"
    assert call("convert", *files, "-o", out, "--test", "a,b,c")[0] == 0
    (pad,) = read_measurements(out).pads
    assert [test.name for test in pad.tests] == ["a", "b", "c"]
    assert [test.start_s for test in pad.tests] == pytest.approx([0.0, 300.0, 600.0])
    assert all(test.start_known for test in pad.tests)
    assert call("convert", *files, "-o", out, "--pad", "A,B,C")[0] == 0
    assert [pad.name for pad in read_measurements(out).pads] == ["A", "B", "C"]


def test_the_file_itself_is_not_written_over(instron):
    before = instron.read_bytes()
    status, _, err = call("convert", instron, "-o", instron)
    assert status == 2
    assert "would be written over" in err
    assert instron.read_bytes() == before


def test_rows_long_before_contact_are_left_out_and_counted():
    (test,) = convert([CORPUS / "other" / "early-bluehill-universal.csv"]).tests
    # 4 s of approach at 200 Hz, of which one second stays
    (dropped,) = test.dropped.values()
    assert dropped == pytest.approx(600, abs=3)
    assert test.time[0] == 0.0
    assert len(test.time) + dropped == 1039  # rows of the file


def test_the_picture_shows_every_test_with_its_contact():
    axes = plot_conversion(convert([of_layout("mach-1-b.txt")]), width=85.0)
    drawn = [line.get_gid() for axis in axes for line in axis.get_lines()]
    assert [drawn.count(gid) for gid in ("displacement", "force", "rise")] == [2, 2, 2]
    assert figure_of(axes).get_size_inches()[0] == pytest.approx(85.0 / 25.4)
    bands = [patch for axis in axes for patch in axis.patches if patch.get_gid() == "contact"]
    assert len(bands) == 2


def test_names_that_a_tidy_file_cannot_hold_are_written_otherwise(tmp_path):
    source = tmp_path / 'a;b,"c.csv'
    source.write_bytes(of_layout("cellscale-a.csv").read_bytes())
    text = tidy_text(convert([source], Answers.from_words(pads=("100% B",)))).decode()
    row = next(line for line in text.split("\n") if line.startswith("100% B"))
    assert row.startswith("100% B,a-b-c,0.0")
