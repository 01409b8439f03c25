"""Settings: keys of one file and options of the commands, which say the same."""

import pytest
from support.endtoend import PADS, call, one_line

from qlvbayes.cli.main import application
from qlvbayes.cli.settings import FILE, KEYS, PARTS, StudySettings, expanded, relaxation_of
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.model.choices import Choices

GIVEN = (
    "elastic=hertz", "relaxation=prony:3", "noise=white", "prior=v[1]=lognormal(1.8,0.5)",
    "fix=n=1.5", "fix=v[3]=0.01", "add=friction", "bonded=true", "rested=true",
    "leave_out=B-20:30..45s", "tolerance=2%", "walkers=40", "max-steps=200", "area=3.5",
)  # fmt: skip


def settings(*options, file=None):
    return StudySettings.from_options(file, options)


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("--sign force -o out", "--set sign=force -o out"),
        ("--fix v[2]=0.14 --fix=b=1", "--set fix=v[2]=0.14 --set fix=b=1"),
        ("--rested --loose --bonded", "--set rested=true --set bonded=false --set bonded=true"),
        ("--test slow,fast --modes 3", "--set tests=slow,fast --set modes=3"),
        ("--seed 3 -- --sign", "--seed 3 -- --sign"),
        ("a.csv --elastic", "a.csv --elastic"),
    ],
)
def test_an_option_is_a_setting(words, wanted):
    assert expanded("study", words.split()) == wanted.split()


def test_commands_take_the_settings_that_they_use_and_are_few():
    assert expanded("diagnose", ["--walkers", "8"]) == ["--walkers", "8"]
    assert expanded("compare", ["--sign", "force"]) == ["--sign", "force"]
    assert {key.part for key in KEYS.values()} == {*PARTS["study"], *PARTS["fit"]}
    assert call("diagnose", PADS, "-o", "nowhere", "--walkers", "8")[0] == 2
    import typer

    commands = typer.main.get_command(application()).commands
    assert len(commands) <= 13
    assert sum(len(command.params) for command in commands.values()) <= 110


def test_what_a_study_writes_is_read_as_the_same(tmp_path):
    given = settings(*GIVEN)
    given.write(tmp_path, [PADS], "B", 3)
    again = settings(file=tmp_path / FILE)
    assert again["files"] == (PADS.resolve(),)
    assert (again["pads"], again["seed"]) == ("B", 3)
    study = read_measurements(PADS)
    choices = again.choices(study)
    assert choices == given.choices(study)
    assert choices == Choices(
        elastic="hertz", modes=3, noise="white", priors=["v[1]=lognormal(1.8,0.5)"],
        fixed=["n=1.5", "v[3]=0.01"], effects="friction", bonded=True, rested=True,
        leave_out="B-20:30..45s",
    )  # fmt: skip
    assert again.thresholds().tolerance == 0.02
    assert (again.sampler(5).walkers, again.sampler(5).max_steps) == (40, 200)
    assert again.arguments() == ["--area", "3.5"]
    again.write(tmp_path, [PADS, PADS], "C", 4)  # what was read does not come before what is said
    third = settings(file=tmp_path / FILE)
    assert (third["pads"], len(third["files"]), third.seed(None), third.seed(7)) == ("C", 2, 4, 7)
    assert settings("elastic=linear", file=tmp_path / FILE)["elastic"] == "linear"
    file = tmp_path / "mine.toml"  # whose paths count from its folder
    file.write_text('files = ["a.csv"]\nlaws_file = "laws.py"\nadd = ["inertia"]\n')
    found = settings(file=file)
    assert (found["files"], found["laws-file"]) == ((tmp_path / "a.csv",), tmp_path / "laws.py")


@pytest.mark.parametrize(
    ("text", "key"),
    [("elastic = 3 =", "TOML"), ("colour = 'red'", "colour"), ("walkers = 'many'", "walkers"),
     ("add = 'friction'", "add"), ("seed = -1", "seed")],
)  # fmt: skip
def test_a_bad_file_is_refused_in_one_line(tmp_path, text, key):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    status, out, err = call("fit", PADS, "-o", tmp_path / "out", "--settings", file)
    assert (status, out) == (2, "")
    assert one_line(err).startswith(f"{file}: ")
    assert key in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "wanted"),
    [((), ("prony", 2)), (("modes=3",), ("prony", 3)), (("relaxation=fung",), ("fung", 2)),
     (("relaxation=prony", "modes=4"), ("prony", 4)),
     (("modes=3", "relaxation=prony:3"), ("prony", 3))],
)  # fmt: skip
def test_relaxation_and_modes_say_one_thing(options, wanted):
    assert relaxation_of(settings(*options)["relaxation"]) == wanted


@pytest.mark.parametrize(
    "words",
    ["relaxation=fung modes=3", "modes=3 relaxation=prony:2", "relaxation=prony:0", "modes=7",
     "relaxation=fung:2", "area=wide", "rested=perhaps", "elastic", "max-steps=3",
     "tolerance=much"],
)  # fmt: skip
def test_what_cannot_be_set_is_refused(words):
    with pytest.raises(InputError):  # noqa: PT012
        given = settings(*words.split())
        relaxation_of(given["relaxation"])
        given.sampler(0)
        given.thresholds()
