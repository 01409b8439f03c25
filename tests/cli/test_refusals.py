"""What a command cannot do it refuses: status 2, one plain line, nothing printed or written."""

import shlex

import pytest
from support.endtoend import PADS, call, one_line
from support.exported_pad import write_fit
from support.machine_files import of_layout, refusals
from support.posteriors import drawn, vectors, written

HIDDEN = PADS.with_name("hidden.csv")


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """Folders with fits of three pads, with an exportable one, a broken one, and none."""
    folders = {name: tmp_path_factory.mktemp(name) for name in ("FITS", "FIT", "BROKEN", "EMPTY")}
    for seed, pad in enumerate("ABC"):
        written(folders["FITS"] / pad, vectors(drawn(pad, seed)), {})
    for name in ("FIT", "BROKEN"):
        write_fit(folders[name])
    (folders["BROKEN"] / "B" / "summary.json").write_text('{"parameters": {"m": {}}}')
    files = {"PADS": PADS, "HIDDEN": HIDDEN, "MACHINE": of_layout("bluehill-3-a.csv")}
    return folders | files


def everything(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


@pytest.mark.parametrize(("command", "words", "says"), refusals("refusals"))
def test_a_command_refuses_in_one_line(places, command, words, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    typed = shlex.split(words)
    for name, place in places.items():
        typed = [str(place) + x[len(name) :] if x.split("/")[0] == name else x for x in typed]
    folders = [place for place in places.values() if place.is_dir()]
    before = [everything(folder) for folder in folders]
    status, out, err = call(command, *typed)
    assert (status, out) == (2, "")
    if not err.startswith(("Usage", "\x1b")):  # what typer refuses, it draws in a box
        one_line(err)
    assert says in err
    assert not list(tmp_path.iterdir())
    assert [everything(folder) for folder in folders] == before


@pytest.mark.parametrize("words", [["fit", "--bogus"], ["nonsense"], ["fit"], ["check", "--seed"]])
def test_usage_errors_end_with_status_2(words):
    status, out, err = call(*words)
    assert (status, out) == (2, "")
    assert "Traceback" not in err
