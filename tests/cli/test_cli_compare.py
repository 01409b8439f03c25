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
        few = {name: draws[:, :25] for name, draws in drawn(pad[0], seed).items()}
        written(path / pad, vectors(few), attrs)
    return path


@pytest.fixture(scope="module")
def pads(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("pads"), "ABC")


def test_files_are_left_a_seed_repeats_json_is_all_that_is_printed_and_pairs_are_all(pads):
    folder, written_now = pads / "compare" / "B-vs-C", []
    for more in ((), ("--json",)):
        status, out, err = call("compare", pads, "--pads", "B,C", *PLACES, *more)
        assert (status, err) == (0, "")
        written_now.append(read_json(folder / "compare.json"))
    assert json.loads(out) == written_now[1:] == written_now[:1]
    tables = {f"compare.{suffix}" for suffix in ("json", "csv", "tex", "txt")}
    assert {path.name for path in folder.iterdir()} == tables | {"contrasts.png", "contrasts.pdf"}
    assert [path.name for path in folder.parent.iterdir()] == ["B-vs-C"]
    status, out, _ = call("compare", pads, *PLACES, "--json", "--region", 0.5)
    assert status == 0
    pairs = [["A", "B"], ["A", "C"], ["B", "C"]]
    assert [(x["names"], x["region"]) for x in json.loads(out)] == [(pair, 0.5) for pair in pairs]


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


def test_predicted_files_agree_and_bands_are_in_order(pads):
    program, folder = "ramp 1.6 mm at 20 mm/s, hold 5 s", pads / "B"
    status, out, err = call("predict", pads, "--pad", "B", "--program", program)
    assert status == 0
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
