"""Check that errors end in one plain line, nothing is left half done, and stopped runs resume."""

import errno
import os
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest
from support.endtoend import COMMAND, PADS, call, environment, one_line, read_json

from qlvbayes.io.checks import InputError
from qlvbayes.io.files import alone_in, results_folder, write_json, write_whole

QUICK = ("--pads", "B", "--method", "least-squares")


def refused(*words):
    """The line that the command ends with, status 2, and nothing on stdout."""
    status, out, err = call(*words)
    assert status == 2
    assert out == ""
    return one_line(err)


@pytest.mark.parametrize("place", [".", "deeper"])
def test_a_file_where_the_results_should_go_is_left_alone(tmp_path, place):
    taken = tmp_path / "taken"
    taken.write_text("mine")
    line = refused("fit", PADS, "-o", taken / place, *QUICK)
    assert str(taken) in line
    assert "choose another folder with -o" in line
    assert taken.read_text() == "mine"


@pytest.fixture
def read_only():
    """A folder that this process may read and not write, not even if it is root's."""
    user = os.geteuid()
    with tempfile.TemporaryDirectory() as base:
        Path(base).chmod(0o755)
        (folder := Path(base) / "read-only").mkdir(0o555)
        if user == 0:
            os.seteuid(65534)  # nobody
        yield folder
        if user == 0:
            os.seteuid(user)
        folder.chmod(0o755)


def test_a_folder_that_cannot_be_written_is_named_before_the_work(read_only):
    with pytest.raises(InputError, match=f"{read_only}.*cannot write results here.*another folder"):
        results_folder(read_only / "out")
    with pytest.raises(InputError, match="cannot write results here"), alone_in(read_only):
        pass
    assert list(read_only.iterdir()) == []


def test_check_says_when_the_data_are_gone_or_changed(done, tmp_path):
    data, folder = done[0].parents[1] / "some.csv", tmp_path / "B"
    folder.mkdir()
    shutil.copy(done[0] / "posterior.nc", folder)
    content = data.read_bytes()
    try:
        data.unlink()
        line = refused("check", tmp_path)
        assert line.startswith(str(data))
        assert "--data FILE" in line
        data.write_bytes(content + b"# another line\n")
        assert "changed since the fit" in refused("check", tmp_path)
    finally:
        data.write_bytes(content)
    assert "no longer here" in refused("check", tmp_path, "--data", tmp_path / "no.csv")
    assert [path.name for path in folder.iterdir()] == ["posterior.nc"]


@pytest.mark.parametrize("damage", ["empty", "half", "text", "zeros", "folder"])
def test_check_refuses_damaged_results(done, tmp_path, damage):
    good = (done[0] / "posterior.nc").read_bytes()
    file = tmp_path / "B" / "posterior.nc"
    file.parent.mkdir()
    if damage == "folder":
        file.mkdir()
    elif damage == "zeros":
        # a hole in the draws themselves, where a file's structure is whole
        hole = len(good) // 2
        file.write_bytes(good[:hole] + bytes(4096) + good[hole + 4096 :])
    else:
        file.write_bytes({"empty": b"", "half": good[: len(good) // 2], "text": b"m,b\n"}[damage])
    line = refused("check", tmp_path)
    assert line.startswith(str(file))
    assert "run qlvbayes fit again" in line
    assert [path.name for path in file.parent.iterdir()] == ["posterior.nc"]


@pytest.mark.slow
def test_a_full_disk_leaves_no_half_written_results(tmp_path):
    # files of at most 1 MB: as on a full disk, a write comes to an end in the middle
    limited = ["sh", "-c", 'ulimit -f 1000; exec "$0" "$@"', COMMAND]
    line = [*limited, "fit", PADS, "-o", tmp_path, *QUICK]
    process = subprocess.run(line, capture_output=True, text=True, timeout=900, env=environment())
    assert process.returncode == 2
    assert one_line(process.stderr).startswith(f"{tmp_path / 'B' / 'posterior.nc'}: ")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_failed_write_keeps_the_file_that_was_there(tmp_path):
    file = tmp_path / "kept.json"
    write_json(file, {"a": 1})
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(OSError, match=r"kept\.json") as error:
            write_whole(file, bytes(5000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert error.value.errno == errno.EFBIG
    assert read_json(file) == {"a": 1}
    assert list(tmp_path.iterdir()) == [file]
