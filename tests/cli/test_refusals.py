"""What a command cannot do it refuses: status 2, one plain line, nothing printed or written."""

import shlex

import pytest
from support.endtoend import PADS, call, one_line
from support.exported_pad import write_fit
from support.machine_files import of_layout
from support.posteriors import drawn, vectors, written

HIDDEN = PADS.with_name("hidden.csv")
TABLE = {  # command: what is typed after it, and a word of the refusal
    "fit": [
        ("PADS -o OUT --pads Z", "no pad 'Z'; name one of: A, B, C"),
        ("PADS -o OUT --pads B --method guess", "'guess'; use one of emcee"),
        ("PADS -o OUT --pads B --noise pink", "noise"),
        ("PADS -o OUT --pads B --elastic rubber", "use one of exponential, linear, hertz"),
        ("PADS -o OUT --pads B --relaxation pony", "'pony'; use"),
        ("PADS -o OUT --pads B --prior v[1]=banana(1,2)", "no prior is called 'banana'"),
        ("PADS -o OUT --pads B --fix v[1]=0.1 --fix v[2]=5", "rates must fall"),
        ("PADS -o OUT --pads B --fix noise.pink=1", "no constant is called 'noise.pink'"),
        ("HIDDEN -o OUT --add magic", "no effect 'magic'; use one of viscous_drag"),
        ("nowhere.csv -o OUT", "nowhere.csv: no such file"),
    ],
    "diagnose": [
        ("HIDDEN -o OUT --add magic", "no effect 'magic'"),
        ("PADS -o OUT --walkers 8", "--walkers"),
    ],
    "study": [("HIDDEN -o OUT --add magic", "no effect 'magic'"), ("", "hidden.csv -o hidden")],
    "check": [
        ("EMPTY", "run qlvbayes fit first"),
        ("EMPTY/nowhere", "run qlvbayes fit first"),
        ("FITS --program 'rump 1 mm in 1 s'", "'rump' is not understood"),
        ("FITS --program nowhere.csv", "nowhere.csv: "),
        ("FITS", "does not say where its measurements are; say where they are with --data FILE"),
        ("FITS --program 'ramp 1.6 mm at 20 mm/s' --pad Z", "no fit of pad 'Z'; name of A, B, C"),
    ],
    "compare": [
        ("FITS --pads B,D", "no fit of pad 'D'; name of A, B, C"),
        ("FITS --pads B", "fit another pad"),
        ("FITS --fluids", "no two fluids have two specimens"),
        ("FITS --rates 1,fast", "'1,fast' are not numbers above 0"),
        ("EMPTY", "no fit in this folder; run qlvbayes fit first"),
    ],
    "design": [("EMPTY", "no results in this folder; run qlvbayes study")],
    "benchmark": [
        ("-o OUT --size 200%", "give a share of the peak force"),
        ("-o OUT --effects rust", "no effect 'rust'"),
        ("-o OUT --specimen X", "no pad 'X'"),
        ("-o OUT --noise pink", "no noise 'pink'"),
        ("PADS -o OUT", "several pads: A, B, C"),
        ("-o OUT --programme 'jump 1 mm'", "'jump' is not understood"),
    ],
    "export": [
        ("FIT --pad B --to patran", "'patran'; use one of c, fmu, mujoco"),
        ("FIT --pad B --to abaqus", "give --height MM and --area MM2"),
        ("FIT --pad B --to abaqus --height 3", "give both"),
        ("FIT --pad B --to abaqus --height 3 --area 0", "above 0"),
        ("FIT --pad X --to c", "'X'"),
        ("FIT --pad B --to ,", "--to c|fmu"),
        ("BROKEN --pad B --to c", "summary.json"),
        ("EMPTY --to c", "run qlvbayes fit first"),
    ],
    "simulate": [
        ("-o OUT.csv --noise pink", "use one of correlated, white, none"),
        ("-o OUT.csv --pads Q", "no pad 'Q'"),
        ("-o OUT.csv --rates fast", "not a list of rates"),
        ("-o OUT.csv --rates -1", "not a list of rates"),
        ("-o OUT.csv --max-rows 0", "too few"),
        ("-o OUT.csv --hide drag", "viscous_drag"),
        ("-o OUT.csv --hide viscous_drag:k=1", "no parameter"),
        ("-o OUT.csv --hide viscous_drag:eta=x", "not a number"),
        ("-o OUT.csv --hide friction:reach=1", "lacks strength"),
        ("-o OUT.csv --protocol creep", "retraction"),
        ("-o nowhere/OUT.csv --pads finger:400", "nowhere: no such"),  # would take minutes
    ],
    "look": [
        ("MACHINE -o OUT.csv --pad A,B", "the number of files is 1, that of tests 1 (pad B)"),
        ("MACHINE -o OUT.csv --test a,b", "--test names 2 tests and there are 1 (pad B)"),
        ("MACHINE -o OUT.csv --pad a/b", "the name 'a/b' cannot be used; write it as 'a-b'"),
        ("MACHINE -o OUT.csv --sign down", "use one of none, displacement, force, both"),
        ("MACHINE -o OUT.csv --contact here", "no position of contact 'here'"),
        ("MACHINE -o OUT.csv --units s,mm", "are not three units"),
        ("MACHINE -o OUT.csv --area -1", "the area -1 is not positive"),
        ("MACHINE -o OUT.csv --formats-file no.py", "no such Python file"),
        ("PADS -o OUT.csv", "tidy already"),
    ],
}
CASES = [(command, words, says) for command, rows in TABLE.items() for words, says in rows]


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


@pytest.mark.parametrize(("command", "words", "says"), CASES)
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
