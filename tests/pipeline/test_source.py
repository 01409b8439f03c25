"""Files to pads: one rule for every command that reads."""

from pathlib import Path

import numpy as np
import pytest
from support import stages
from support.endtoend import PADS, call, read_json, with_tests

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.parallel.running import Fault, Shard
from qlvbayes.pipeline.source import KEPT, Source, pad_of

QUICK = ("--method", "least-squares", "--modes", "1", "--noise", "white")


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """Three recordings of one pad on one stage, as a machine writes them."""
    folder = tmp_path_factory.mktemp("stage")
    stages.stage(folder, 12.4, (0.5, 2.0, 10.0), step=0.01)
    return folder


@pytest.fixture(scope="module")
def source(stage):
    return Source.from_files(stage)


def names(source):
    return [one.pads[0].name for one in source if isinstance(one, Measurements)]


def test_machines_files_are_tests_of_one_pad_unless_the_user_names_more(stage, source):
    (pad,) = source.read.pads
    assert [test.name for test in pad.tests] == ["at_0.5", "at_10", "at_2"]
    assert len({test.contact_stage for test in pad.tests}) == 1
    assert source.is_complete
    assert source.grouping.startswith("read: pad pad of 3 tests")
    assert names(Source.from_files(stage, only=["A", "B", "A"])) == ["A", "B"]
    (single, *_) = sorted(stage.iterdir())
    assert names(Source.from_files(single, only=["stay"])) == ["stay"]
    with pytest.raises(InputError):
        Source.from_files(stage, only=["A", "B"])  # for three files


def test_tidy_files_stand_beside_machines_files_and_a_bad_one_is_named(stage, tmp_path):
    bad = tmp_path / "bad.csv"
    bad.write_text("Time,Extension,Load\n(s),(mm),(N)\n0,0,0\n1,x,1\n")
    tidy = with_tests(tmp_path / "B.csv", "B-20")
    found = list(Source.from_files([tidy, *sorted(stage.iterdir()), bad]))
    assert names(found) == ["pad", "B"]
    assert [one.of for one in found if isinstance(one, Fault)] == ["bad.csv"]
    assert [len(one.pads[0].tests) for one in found if isinstance(one, Measurements)] == [3, 1]


def test_tidy_files_keep_the_pads_that_they_name(tmp_path):
    study = read_measurements(PADS)
    both, single = tmp_path / "run1.csv", with_tests(tmp_path / "B.csv", "B-20")
    both.write_bytes(PADS.read_bytes())
    assert names(Source.from_files([both, single])) == ["run1-A", "run1-B", "run1-C", "B"]
    (renamed,) = pad_of(read_measurements(both), "run1-B").pads
    assert {test.pad for test in renamed.tests} == {"run1-B"}
    assert pad_of(study, "B").pads[0] is study.pad("B")
    assert names(Source.from_files(PADS, only=("C", "A"))) == ["C", "A"]
    assert names(Source.from_files(PADS, shard=Shard(2, 2))) == ["B"]
    for refused in (lambda: pad_of(study, "run2-B"), lambda: Source.from_files(PADS, only=("X",))):
        with pytest.raises(InputError, match="no pad"):
            refused()


def test_what_would_go_to_one_folder_is_refused(tmp_path):
    one = with_tests(tmp_path / "B.csv", "B-20")
    (tmp_path / "b.CSV").write_bytes(one.read_bytes())
    with pytest.raises(InputError, match="one name"):
        Source.from_files([one, tmp_path / "b.CSV"])
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match="no measurements"):
        Source.from_files(tmp_path / "none")


def test_later_steps_read_what_was_read_from_its_tidy_copy(source, tmp_path):
    after = source.kept(tmp_path)
    assert Path(after.read.source) == tmp_path / KEPT
    for one, other in zip(source.read.pads[0].tests, after.read.pads[0].tests, strict=True):
        assert (one.name, one.contact_stage) == (other.name, other.contact_stage)
        assert np.allclose(one.force, other.force, atol=1e-8)
    assert after.read.sha256 == source.read.sha256


@pytest.mark.slow
def test_a_check_of_a_fit_finds_the_tests_in_the_copy(stage, tmp_path):
    status, out, err = call("fit", stage, "-o", tmp_path / "out", *QUICK, "--pad", "stay")
    assert status == 0, err
    assert out.startswith("read: pad stay of 3 tests")
    assert call("check", tmp_path / "out")[0] == 0
    cells = read_json(tmp_path / "out" / "stay" / "check.json")["cells"]
    assert {cell["test"] for cell in cells} == {"at_0.5", "at_10", "at_2"}
