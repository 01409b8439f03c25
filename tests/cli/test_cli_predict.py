"""``qlvbayes predict``: files, table, notices, and what is refused in one line."""

import csv
import json

import numpy as np
import pytest
from support.endtoend import call, read_json
from support.posteriors import drawn, vectors, written

PROGRAM = "ramp 1.6 mm at 20 mm/s, hold 5 s"


@pytest.fixture(scope="module")
def pads(tmp_path_factory):
    path = tmp_path_factory.mktemp("pads")
    for seed, pad in enumerate("AB"):
        written(path / pad, vectors(drawn(pad, seed)), {})
    return path


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
    folder, *_ = predicted
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
    assert [one["pad"] for one in found] == ["A", "B"]
    for one in found:
        assert one["program"] == "load.csv"
        columns = one["columns"]
        assert columns["displacement_mm"][-1] > columns["displacement_mm_low90"][-1] > 0.5
