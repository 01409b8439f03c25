"""``qlvbayes compare`` and ``predict`` on stored posteriors: files, tables, words and pairs."""

import csv
import json

import numpy as np
import pytest
from support.endtoend import call, read_json
from support.posteriors import drawn, vectors, written

PLACES = ("--depth", 1, "--rates", "1", "--frequencies", "0.3")


def folder_of(path, pads, fluids=None):
    for seed, pad in enumerate(pads):
        attrs = {"fluid": fluids[pad]} if fluids else {}
        written(path / pad, vectors(drawn(pad[0], seed)), attrs)
    return path


@pytest.fixture(scope="module")
def pads(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("pads"), "ABC")


@pytest.fixture(scope="module")
def compared(pads):
    status, out, err = call("compare", pads, "--pads", "B,C", *PLACES)
    assert (status, err) == (0, "")
    return pads / "compare" / "B-vs-C", out


def test_files_are_left_a_seed_repeats_and_json_is_all_that_is_printed(compared, pads):
    folder, _ = compared
    names = {path.name for path in folder.iterdir()}
    tables = {f"compare.{suffix}" for suffix in ("json", "csv", "tex", "txt")}
    assert names == tables | {"contrasts.png", "contrasts.pdf"}
    assert [path.name for path in folder.parent.iterdir()] == ["B-vs-C"]
    content = read_json(folder / "compare.json")
    status, out, err = call("compare", pads, "--pads", "B,C", *PLACES, "--json")
    assert (status, err) == (0, "")
    (printed,) = json.loads(out)
    assert printed == content
    assert read_json(folder / "compare.json") == content


def test_without_names_every_pair_is_compared(tmp_path):
    folder = folder_of(tmp_path, "AB")
    status, out, _ = call("compare", folder, *PLACES, "--json", "--region", 0.5)
    assert status == 0
    assert [found["names"] for found in json.loads(out)] == [["A", "B"]]
    assert json.loads(out)[0]["region"] == 0.5


def test_specimens_of_two_fluids_are_compared_as_fluids(tmp_path):
    fluids = {"B1": "oil", "B2": "oil", "C1": "glycerin", "C2": "glycerin"}
    folder = folder_of(tmp_path, fluids, fluids)
    status, out, err = call("compare", folder, *PLACES)
    assert (status, err) == (0, "")
    assert "oil and glycerin" in out
    content = read_json(folder / "compare" / "oil-vs-glycerin" / "compare.json")
    assert (content["between"], content["specimens"]) == ("fluids", [2, 2])
    status, out, _ = call("compare", folder, *PLACES, "--pads", "B1,B2", "--json")
    assert [found["between"] for found in json.loads(out)] == ["pads"]


def test_pads_of_two_folders_are_compared(pads, tmp_path):
    """Those of one name are told apart by their folders."""
    other = folder_of(tmp_path / "other", "B")
    status, out, _ = call("compare", other, pads, "--pad", "B", *PLACES, "--json")
    assert status == 0
    assert [found["names"] for found in json.loads(out)] == [["other-B", f"{pads.name}-B"]]
    assert (other / "compare" / f"other-B-vs-{pads.name}-B" / "compare.json").is_file()


PROGRAM = "ramp 1.6 mm at 20 mm/s, hold 5 s"


@pytest.fixture(scope="module")
def predicted(pads):
    status, out, err = call("predict", pads, "--pad", "B", "--program", PROGRAM)
    assert status == 0
    return pads / "B", out, err


def test_files_agree_and_bands_are_in_order(predicted):
    folder, out, err = predicted
    names = {path.name for path in folder.iterdir()}
    assert names == {"posterior.nc", *(f"prediction.{x}" for x in ("json", "csv", "png", "pdf"))}
    assert "the tests are not known" in err
    assert "largest force" in out
    assert not (folder.parent / "A" / "prediction.json").exists()
    content = read_json(folder / "prediction.json")
    assert content["prescribed"] == "displacement"
    assert content["units"] == {"displacement": "mm", "force": "N"}
    columns = {name: np.array(values) for name, values in content["columns"].items()}
    order = ["low90", "low50", "", "high50", "high90"]
    bands = np.stack([columns[f"force_N_{x}".rstrip("_")] for x in order])
    assert np.all(np.diff(bands, axis=0) >= 0.0)
    assert columns["displacement_mm"].max() == pytest.approx(1.6)
    with (folder / "prediction.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(columns)
    for name, values in columns.items():
        assert np.allclose([float(row[name]) for row in rows], values, rtol=1e-8, atol=1e-12)


def test_a_file_prescribes_the_force_of_every_pad(pads, tmp_path):
    table = tmp_path / "load.csv"
    table.write_text("time_s,force_N\n0,0\n0.1,0.5\n5,0.5\n")
    status, out, _ = call("predict", pads, "--program", table, "--json")
    found = json.loads(out)
    assert status == 0
    assert [one["pad"] for one in found] == ["A", "B", "C"]
    for one in found:
        assert one["program"] == "load.csv"
        columns = one["columns"]
        assert columns["displacement_mm"][-1] > columns["displacement_mm_low90"][-1] > 0.5
