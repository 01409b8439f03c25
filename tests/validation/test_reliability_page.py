"""The page of rates is what its script generates, and its tables are what was kept of the runs."""

import pytest
import results
import runs
from blind.population import Population
from reliability import PAGE, page
from results import RESULTS, Origin, Table
from runs import rates_of, read_cases, read_runs, write_cases, write_run
from wide import keep

ORIGIN = Origin("command", "today", "commit", "machine")


def test_the_page_is_what_the_script_generates_and_results_stay_small():
    assert PAGE.read_text(encoding="utf-8") == page()
    assert sum(path.stat().st_size for path in RESULTS.rglob("*")) < 1e6


@pytest.mark.parametrize("run", ["support", "rig"])
def test_rates_of_a_run_are_those_of_its_studies(run):
    kept, line = read_cases(run), read_runs()[run]
    assert rates_of(kept) == line.rates
    assert (len(kept), sum(case["seen"] for case in kept)) == (line.finished, line.seen)


def test_studies_and_rates_come_back_from_their_files(tmp_path, monkeypatch):
    cases = read_cases("rig")[:20]
    monkeypatch.setattr(runs, "RESULTS", tmp_path)
    monkeypatch.setattr(Origin, "today", staticmethod(lambda: "2026-11-30"))
    write_cases("again", cases)
    assert read_cases("again") == cases
    for note in ("first", "new, and better"):
        keep("again", Population(518, paper=True), 20, cases, "abc", note)
    (line,) = read_runs().values()
    assert (line.new, line.rig, line.date, line.finished) == (
        "new, and better",
        "paper",
        "2026-11-30",
        20,
    )
    assert line.rates == rates_of(cases)
    write_run(line)
    assert read_runs() == {"again": line}


def test_a_smaller_run_does_not_replace_a_larger_one(tmp_path, monkeypatch):
    monkeypatch.setattr(results, "RESULTS", tmp_path)
    Table(ORIGIN, 10, ["a"], [["1"]], ["A note."]).write("some")
    Table(ORIGIN, 5, ["a"], [["2"]]).write("some")
    assert Table.read("some").rows == [["1"]]
    assert Table.read("again/some").rows == [["2"]]
    Table(ORIGIN, 10, ["a"], [["3"]]).write("some")
    assert Table.read("some").rows == [["3"]]
    assert not (tmp_path / "again" / "some.json").exists()
    assert "| 1 |" in Table(ORIGIN, 10, ["a"], [["1"]], ["A note."]).markdown()


def test_a_run_of_changed_code_is_refused(monkeypatch):
    monkeypatch.setattr(results, "_git", lambda *words: " M qlvbayes/x.py" * ("status" in words))
    with pytest.raises(SystemExit, match="commit them"):
        Origin.now()
