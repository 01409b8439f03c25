"""The fluid of a pad: one for all its rows, carried along, refused where it changes."""

import pytest

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.motion.experiment import prepare

ROWS = [f"{k / 100:.2f},{min(k, 12) / 10:.2f},{min(k, 12) / 20:.5f}" for k in range(20)]


def file(folder, *parts, header="pad,test,fluid"):
    """A file whose tests each have the same first cells in every row."""
    lines = [f"{header},time_s,displacement_mm,force_N"]
    lines += [f"{part},{row}" for part in parts for row in ROWS]
    path = folder / "pads.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("name", ["fluid", "group", "Fluid", "GROUP"])
def test_a_column_names_the_fluid_of_each_pad(tmp_path, name):
    path = file(tmp_path, "B1,x,oil", "B2,x,oil", "C,x,glycerin", header=f"pad,test,{name}")
    study = read_measurements(path)
    assert [(pad.name, pad.fluid) for pad in study.pads] == [
        ("B1", "oil"), ("B2", "oil"), ("C", "glycerin")
    ]  # fmt: skip
    assert study.notices == ()


def test_without_the_column_or_with_an_empty_cell_there_is_none(tmp_path):
    assert read_measurements(file(tmp_path, "B,x", header="pad,test")).pad("B").fluid is None
    study = read_measurements(file(tmp_path, "B,x,", "C,x,oil"))
    assert [pad.fluid for pad in study.pads] == [None, "oil"]


def test_it_travels_to_the_experiment(tmp_path):
    pad = read_measurements(file(tmp_path, "B,x,oil")).pad("B")
    assert prepare(pad).fluid == "oil"


@pytest.mark.parametrize(
    ("parts", "line", "problem", "remedy"),
    [
        (["B,x,oil", "B,y,water"], 22, "fluid changes from 'oil' to 'water'", "one fluid for all"),
        (["B,x,oil", "B,y,"], 22, "fluid changes from 'oil' to ''", "one fluid for all"),
        (["B,x,a/b"], 2, "the fluid's name 'a/b' cannot name a folder", "without /"),
    ],
)
def test_a_pad_has_one_fluid(tmp_path, parts, line, problem, remedy):
    path = file(tmp_path, *parts)
    with pytest.raises(InputError) as caught:
        read_measurements(path)
    text = str(caught.value)
    assert text.startswith(f"{path}, line {line}: {problem}")
    assert remedy in text


def test_a_fluid_does_not_change_within_a_test(tmp_path):
    path = file(tmp_path, "B,x,oil")
    lines = path.read_text().splitlines()
    lines[15:] = [line.replace("oil", "water") for line in lines[15:]]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="line 16: fluid changes from 'oil' to 'water'"):
        read_measurements(path)


def test_fluid_and_group_are_one_too_many(tmp_path):
    path = file(tmp_path, "B,x,oil,1", header="pad,test,fluid,group")
    with pytest.raises(InputError, match="two columns for fluid: 'fluid' and 'group'"):
        read_measurements(path)
