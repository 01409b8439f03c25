"""Many pads: the same files with any number of processes and in parts; what is finished stays."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from operator import attrgetter

import pytest
from support.endtoend import Listener, call, read_json, with_tests
from support.work import MeanStep, pads

from qlvbayes import write_report
from qlvbayes.fitting.results import RunLog
from qlvbayes.io.data import read_measurements
from qlvbayes.io.files import alone_in
from qlvbayes.parallel.engines import engine_of
from qlvbayes.parallel.running import FailedError, Fault
from qlvbayes.pipeline.derived import draw_constants
from qlvbayes.pipeline.many import map_pads, run_pads
from qlvbayes.pipeline.steps import FINISHED, faults_in
from qlvbayes.report.firstlook.looking import look_into
from qlvbayes.report.page import MOST_ON_A_PAGE

QUICK = ("--method", "least-squares", "--modes", "1", "--noise", "white")


def run(out, names, step=None, engine=None):
    listener = Listener()
    step = step or MeanStep()
    options = {"size": len(names), "engine": engine, "watcher": listener}
    done = run_pads(out, pads(*names), lambda study: [step], **options)
    told = zip(["", *listener.notices], listener.notices, strict=False)
    # that a pad which was just done is there says nothing more
    return done, [new for old, new in told if new == old or old != new.replace("there", "done")]


def files(out):
    return {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and FINISHED not in path.parts and path.name != "run.json"
    }


@pytest.fixture(scope="module")
def two():
    """As good as processes, which start slowly: tests/parallel has these."""
    with ThreadPoolExecutor(2) as executor:
        yield engine_of(executor)


def test_a_bad_pad_stops_nothing_and_is_named(tmp_path, two):
    names = ["A", "bad", "C"]
    found, notices = run(tmp_path / "one", names)
    assert found.pads == ("A", "C")
    assert found.faults == (Fault("some.csv, line 3: no force; measure it", of="pad bad"),)
    assert notices == ["pad A: done", "pad C: done"]
    assert faults_in(tmp_path / "one") == list(found.faults)
    for file in (tmp_path / "one" / FINISHED / "failed").iterdir():
        file.rename(file.with_name("A.json"))
    run(tmp_path / "one", ["A"])  # one that was mended is no longer named
    assert faults_in(tmp_path / "one") == []
    run(tmp_path / "one", names)
    side_by_side, again = run(tmp_path / "two", names, engine=two)
    assert (side_by_side, again) == (found, notices)
    assert files(tmp_path / "one") == files(tmp_path / "two")


def test_what_is_finished_is_told_not_done_again(tmp_path, two):
    run(tmp_path, "AB")
    for engine in (None, two):
        assert run(tmp_path, "AB", engine=engine)[1] == ["pad A: there", "pad B: there"]
    assert run(tmp_path, "AB", MeanStep(1.0))[1] == ["pad A: done", "pad B: done"]
    (tmp_path / "A" / "mean.json").write_text("damaged")
    assert run(tmp_path, "AB", MeanStep(1.0))[1] == ["pad A: done", "pad B: there"]
    (tmp_path / "B" / "deep" / "who.txt").unlink()
    assert run(tmp_path, "AB", MeanStep(1.0))[1] == ["pad A: there", "pad B: done"]


def test_two_runs_into_one_folder_do_not_mix(tmp_path):
    with alone_in(tmp_path / "A"):
        found, notices = run(tmp_path, "AB", MeanStep(1.0))
    assert found.pads == ("B",)
    assert notices == ["pad B: done"]
    (fault,) = found.faults
    assert (fault.of, fault.mendable) == ("pad A", True)
    assert "another run is writing results here" in fault.text
    assert not (tmp_path / "A").exists()
    assert run(tmp_path, "AB", MeanStep(1.0))[1] == ["pad A: done", "pad B: there"]

    # what a killed run left half written is removed
    part = tmp_path / "A" / "mean.json.4711.part"
    part.write_text("half")
    (tmp_path / "A" / "mine.part").write_text("a user's own file")
    run(tmp_path, "A")
    assert not part.exists()
    assert (tmp_path / "A" / "mine.part").exists()


def test_workers_without_the_disk_send_back_what_they_leave(tmp_path, monkeypatch):
    for place in ("here", "there"):
        (tmp_path / place / "A").mkdir(parents=True)
        (tmp_path / place / "A" / "before.txt").write_text("read")
    run(tmp_path / "here", "AB")
    kind, exists = type(tmp_path), type(tmp_path).exists
    hidden = lambda path: not path.name.startswith(".shared") and exists(path)  # noqa: E731
    monkeypatch.setattr(kind, "exists", hidden)
    with ThreadPoolExecutor(2) as executor:
        found, notices = run(tmp_path / "there", "AB", engine=engine_of(executor))
    assert found.pads == ("A", "B")
    assert notices == ["pad A: done", "pad B: done"]
    assert files(tmp_path / "there") == files(tmp_path / "here")
    assert read_json(tmp_path / "there" / "A" / "mean.json")["more"] == "read"


def test_processes_look_at_pads_as_this_one_does(tmp_path, two):
    study = read_measurements(with_tests(tmp_path / "some.csv", "A-20", "B-20"))
    for name, engine in (("one", None), ("two", two)):
        look_into(tmp_path / name, study, study.pads, apply=partial(map_pads, engine))
    with pytest.raises(FailedError) as failed:
        map_pads(two, attrgetter("nothing"), study.pads)
    assert [fault.of for fault in failed.value.faults] == ["pad A", "pad B"]
    assert set(files(tmp_path / "one")) == {"look.json", "look_A.png", "look_B.png"}
    assert files(tmp_path / "one") == files(tmp_path / "two")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Pads of the example data in files of their own, and one that cannot be read."""
    place = tmp_path_factory.mktemp("files")
    for name in "AB":
        with_tests(place / f"{name}.csv", f"{name}-20")
    (place / "broken.csv").write_text("time_s,displacement_mm,force_N\n0,0,0\n0.1,x,0\n")
    (place / "notes.md").write_text("not measured\n")
    (place / "paper_table1.csv").write_text("pad,parameter,value,unit\n")
    return place


@pytest.fixture(scope="module")
def alone(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("alone")
    return out, call("fit", folder, "-o", out, *QUICK)


@pytest.fixture(scope="module")
def whole(folder, tmp_path_factory):
    """The same with its figures."""
    out = tmp_path_factory.mktemp("whole")
    return out, call("fit", folder, "-o", out, *QUICK, drawn=True)


def test_a_folder_is_fitted_and_the_bad_file_named_at_the_end(alone):
    out, (status, output, err) = alone
    assert status == 2
    assert "broken.csv, line 3: " in err
    assert err.endswith("qlvbayes: 1 of 3 failed; 2 are done\n")
    assert "Traceback" not in err
    assert output.index("pad A: constants") < output.index("pad B: constants")
    assert (out / "constants.csv").read_text().count(",m,") == 2


@pytest.mark.integration
def test_any_number_of_processes_leaves_the_same_files(whole, folder, tmp_path):
    out, expected = whole
    status, output, err = call("fit", folder, "-o", tmp_path, *QUICK, "--jobs", "2", drawn=True)
    assert (status, err) == (expected[0], expected[2])
    assert output.replace(str(tmp_path), "OUT") == expected[1].replace(str(out), "OUT")
    assert files(tmp_path) == files(out)


@pytest.mark.slow
def test_parts_gathered_are_the_whole(whole, folder, tmp_path):
    for part in ("1/2", "2/2"):
        words = ("fit", folder, "-o", tmp_path, *QUICK, "--shard", part)
        status, _, err = call(*words, drawn=True)
        assert status == (2 if "broken" in err else 0)
        assert not (tmp_path / "constants.csv").exists()
    assert call("check", tmp_path, "--shard", "1/1", drawn=True)[0] == 0
    status, output, err = call("report", tmp_path, "--gather", drawn=True)
    assert status == 2
    assert f"2 pads in {tmp_path}, report in" in output
    assert err.startswith(f"qlvbayes: broken.csv: {folder}/broken.csv, line 3: ")
    assert err.endswith("qlvbayes: 1 of 3 failed; 2 are done\n")
    left, expected = files(tmp_path), files(whole[0])
    assert {name: left[name] for name in expected} == expected
    assert {"report.html", "forces_at_rates.png", "A/check.json"} <= set(left)
    assert RunLog.read(tmp_path / "run.json").runs["fit"].source == str(folder)


def test_a_report_of_many_pads_is_a_table_and_a_page_each(alone, tmp_path):
    names = [f"pad <{k}>" for k in range(MOST_ON_A_PAGE + 1)]
    for name in names:
        (tmp_path / name).mkdir()
        summary = read_json(alone[0] / "B" / "summary.json") | {"pad": name}
        (tmp_path / name / "summary.json").write_text(json.dumps(summary))
        shutil.copy(alone[0] / "B" / "posterior.nc", tmp_path / name)
    text = write_report(tmp_path).read_text()
    assert "<title>25 pads" in text
    assert 'href="pad%20%3C7%3E/report.html">pad &lt;7&gt;</a>' in text
    assert text.count("<tr>") == len(names) + 1
    assert "<img" not in text
    median = read_json(alone[0] / "B" / "summary.json")["parameters"]["m"]["median"]
    assert text.count(f'data-value="{median}"') == len(names)
    pages = [tmp_path / name / "report.html" for name in names]
    assert "Pad pad &lt;7&gt;" in pages[7].read_text()
    made = [page.stat().st_mtime_ns for page in pages]
    (tmp_path / names[3] / "summary.json").touch()
    write_report(tmp_path)
    again = [page.stat().st_mtime_ns for page in pages]
    assert [k for k, (a, b) in enumerate(zip(made, again, strict=True)) if a != b] == [3]
    draw_constants(tmp_path, None)
    left = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert left == {"constants.csv", "report.html"}
