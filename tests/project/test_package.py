"""Check an installation: the wheel's content, the version's one value, completion of words."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from support.endtoend import COMMAND, call, one_line
from support.exported_pad import write_fit

import qlvbayes

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
_BUILD = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
_NO_SOURCE = shutil.ignore_patterns("__pycache__", "*.pyc", "*.library")


def test_the_top_of_the_repository_and_the_version_are_as_they_should_be():
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("no clone: what is committed cannot be listed")
    top = {name.split("/")[0] for name in listed.stdout.split("\0") if name}
    folders = {"qlvbayes", "tests", "docs", "data", "notebooks", "validation", "benchmarks", ".ci"}
    files = {"README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "LICENSE"}
    built = {"pyproject.toml", "setup.py", "Makefile", "MANIFEST.in", ".gitignore"}
    assert top == folders | files | built
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert PROJECT["version"] == qlvbayes.__version__
    assert re.search(r"^version: (\S+)$", cited, re.M)[1] == qlvbayes.__version__
    assert qlvbayes.__version__ in re.findall(r"^## (\d\S+)", changes, re.M)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The names in a wheel built from a copy of the package."""
    pytest.importorskip("setuptools", "77", reason="no setuptools that reads this pyproject.toml")
    copy, built = tmp_path_factory.mktemp("copy"), tmp_path_factory.mktemp("built")
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    for name in ("qlvbayes", "data"):
        shutil.copytree(ROOT / name, copy / name, ignore=_NO_SOURCE)
    subprocess.run(
        [sys.executable, "-c", _BUILD, built],
        cwd=copy,
        check=True,
        capture_output=True,
        timeout=300,
    )
    (file,) = built.glob("*.whl")
    return file.name, set(zipfile.ZipFile(file).namelist())


@pytest.mark.integration
def test_a_wheel_holds_every_file_of_the_package_alone_and_suits_any_python(wheel):
    """The recursion is compiled in it for this machine, where there is a compiler."""
    name, files = wheel
    version, python, abi, _ = name.removesuffix(".whl").split("-", 1)[1].split("-")
    assert (version, python, abi) == (qlvbayes.__version__, "py3", "none")
    assert ("qlvbayes/laws/recursion.library" in files) == (shutil.which("cc") is not None)
    package = ROOT / "qlvbayes"
    own = {
        f"qlvbayes/{path.relative_to(package).as_posix()}"
        for path in package.rglob("*")
        if path.is_file()
        and path.suffix not in (".pyc", ".library")
        and path.parent != package / "data"
    }
    assert {"qlvbayes/diagnosis/certainty.json", "qlvbayes/report/static/page.css"} <= own
    assert own - files == set()
    assert {name.split("/")[0].partition("-")[0] for name in wheel[1]} == {"qlvbayes"}


def completed(shell, *words):
    """Return the program's answer to a shell that asks how a line goes on."""
    line = " ".join(["qlvbayes", *words])
    asked = {
        "bash": {"COMP_WORDS": line, "COMP_CWORD": str(len(words))},
        "zsh": {"_TYPER_COMPLETE_ARGS": line},
        "fish": {"_TYPER_COMPLETE_ARGS": line, "_TYPER_COMPLETE_FISH_ACTION": "get-args"},
    }[shell]
    environment = {**os.environ, **asked, "_QLVBAYES_COMPLETE": f"complete_{shell}"}
    done = subprocess.run([COMMAND], env=environment, capture_output=True, text=True, timeout=60)
    return done.stdout


@pytest.mark.integration
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
@pytest.mark.parametrize(
    ("words", "there", "gone"),
    [(["di"], "diagnose", "study"), (["effects", "--laws"], "--laws-file", "--seed")],
)
def test_a_shell_completes_commands_and_options(shell, words, there, gone):
    found = completed(shell, *words)
    assert there in found
    assert gone not in found


def test_export_takes_the_only_pad_and_asks_which_of_several(tmp_path):
    write_fit(tmp_path)
    status, out, err = call("export", tmp_path, "--to", "json")
    assert (status, err) == (0, "")
    assert "B/export/json" in out
    write_fit(tmp_path, pad="C")
    status, _, err = call("export", tmp_path, "--to", "json")
    assert status == 2
    assert "several pads are in this folder: B, C; name one, as --pad B" in one_line(err)
