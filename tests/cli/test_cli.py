"""The commands on the example data: what they leave, print and repeat."""

import json
import os
import subprocess

import numpy as np
import pytest
from support.endtoend import (
    COMMAND,
    CONSTANTS,
    PADS,
    call,
    environment,
    keeps_check_contract,
    keeps_summary_contract,
    read_json,
    true_value,
)

from qlvbayes.cli.terminal import Terminal
from qlvbayes.plots.catalogue import figures_of

BRIEF = ("--pads", "B", "--max-steps", "40")


@pytest.fixture(scope="module")
def checked(done):
    return read_json(done[0] / "check.json")


def test_a_fit_keeps_its_contract_and_says_in_a_pipe_which_tests_are_of_which_pad(done):
    folder, *ran = done
    summary = read_json(folder / "summary.json")
    keeps_summary_contract(summary)
    assert (summary["pad"], summary["converged"], summary["troubles"]) == ("B", True, [])
    units = ["N/mm", "1/mm", "1", "1", "1", "1/s", "1/s", "N"]
    assert list(summary["parameters"]) == [*CONSTANTS, "noise.white"]
    assert [p["unit"] for p in summary["parameters"].values()] == units
    for status, said, err in ran:
        assert (status, err) == (0, "")
        assert "\x1b" not in said
    drawn = [one.name for command in ("fit", "check") for one in figures_of(command)]
    results = ("check.json", "curves.json", "relaxation.json", "summary.json")
    left = {*results, "posterior.nc", "relaxation.txt"}
    left |= {f"{name}.{suffix}" for name in drawn for suffix in ("pdf", "png")}
    assert {path.name for path in folder.iterdir()} == left
    for suffix, begin in (("png", b"\x89PNG"), ("pdf", b"%PDF")):
        assert (folder / f"forces.{suffix}").read_bytes().startswith(begin)
    fit = ran[0][1]
    assert fit.startswith("read: pad B of 3 tests\n")
    assert all(f"│ {name} " in fit for name in summary["parameters"])
    assert f"results in {folder.parent}" in fit


def test_a_check_keeps_its_contract_and_its_errors_are_those_of_the_curves(checked, done):
    keeps_check_contract(checked)
    cells = [(cell["test"], cell["phase"]) for cell in checked["cells"]]
    tests = [f"B-{rate}" for rate in ("1", "20", "100")]
    assert cells == [(t, p) for t in tests for p in ("ramp", "hold", "unload", "recovery")]
    assert {cell["test"] for cell in checked["cells"] if cell["role"] == "fit"} == {"B-20"}
    # 0.006 N white and 0.008 N correlated: 0.010 N in all
    assert checked["noise_N"] == pytest.approx(0.010, rel=0.1)
    left = read_json(done[0] / "curves.json")
    for test in left["tests"]:
        for cell in (cell for cell in checked["cells"] if cell["test"] == test["test"]):
            rows = [k for k, kind in enumerate(test["phase"]) if kind == cell["phase"]]
            missed = [test["observed_N"][k] - test["mean_N"][k] for k in rows]
            covered = [test["low_N"][k] <= test["observed_N"][k] <= test["high_N"][k] for k in rows]
            assert len(rows) == cell["n"]
            # kept to five digits
            assert np.sqrt(np.mean(np.square(missed))) == pytest.approx(cell["rmse_N"], rel=0.01)
            assert np.mean(covered) == pytest.approx(cell["coverage90"], abs=1.5 / len(rows))


def test_check_repeats_wherever_the_data_are_and_prints_json_only(done, checked, tmp_path):
    moved = tmp_path / "moved.csv"
    moved.write_bytes((done[0].parents[1] / "some.csv").read_bytes())
    status, out, err = call("check", done[0].parent, "--data", moved, "--pad", "B", "--json")
    assert (status, err, json.loads(out)) == (0, "", [checked])
    assert read_json(done[0] / "check.json") == checked


def test_a_reader_that_has_gone_sees_no_traceback():
    read_end, write_end = os.pipe()
    os.close(read_end)
    options = {"stdout": write_end, "stderr": subprocess.PIPE, "timeout": 900}
    process = subprocess.run([COMMAND, "--version"], env=environment(), **options)
    os.close(write_end)
    assert (process.returncode, process.stderr) == (1, b"")


@pytest.mark.slow
def test_a_seed_repeats_and_another_does_not(tmp_path):
    found = []
    for place, seed in (("first", 4), ("second", 4), ("third", 5)):
        words = ("fit", PADS, "-o", tmp_path / place, *BRIEF, "--seed", seed, "--json")
        status, out, err = call(*words)
        assert status == 0
        assert err.count("NOT CONVERGED") == err.count("\n") >= 1
        found.append(json.loads(out)[0])
        keeps_summary_contract(found[-1])
    assert found[0] == found[1]
    assert found[0] != found[2]
    assert not found[0]["converged"]


@pytest.mark.slow
def test_simulated_pads_are_fitted_one_folder_each(tmp_path):
    data, out = tmp_path / "mine.csv.gz", tmp_path / "out"
    words = ("--rates", "20", "--load-cell", "none", "--max-rows", "400")
    assert call("simulate", "-o", data, "--pads", "A,B,C", *words)[0] == 0
    status, said, err = call("fit", data, "-o", out, "--pads", "C, B", "--method", "least-squares")
    assert status == 0
    assert said.index("pad C: constants") < said.index("pad B: constants")
    assert err.count("\n") == err.count("notice: pad ") == 2
    tables = [f"constants.{kind}" for kind in ("csv", "pdf", "png", "tex")]
    left = [".finished", "B", "C", *tables, "run.json"]
    assert sorted(path.name for path in out.iterdir()) == left
    found = read_json(out / "B" / "summary.json")["parameters"]
    for name in CONSTANTS:
        assert found[name]["mean"] == pytest.approx(true_value(name), rel=0.01), name


def test_in_a_pipe_too_a_command_says_how_long_it_took_and_not_where_machines_read(capsys):
    Terminal().took()
    assert capsys.readouterr() == ("", "took 0 s\n")
    Terminal(quiet=True).took()
    assert capsys.readouterr() == ("", "")
