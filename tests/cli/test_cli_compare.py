"""``qlvbayes compare`` on fits of three pads: files, words, pairs, fluids and what is refused."""

import json

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


def test_files_are_left(compared):
    folder, _ = compared
    names = {path.name for path in folder.iterdir()}
    tables = {f"compare.{suffix}" for suffix in ("json", "csv", "tex", "txt")}
    assert names == tables | {"contrasts.png", "contrasts.pdf"}
    assert [path.name for path in folder.parent.iterdir()] == ["B-vs-C"]


def test_a_seed_repeats_and_json_is_all_that_is_printed(compared, pads):
    folder, _ = compared
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
