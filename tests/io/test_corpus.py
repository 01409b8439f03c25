"""Stored files are read to the digits that were read, or refused with the same place."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import convert
from qlvbayes.io.data import read_measurements
from qlvbayes.io.loading import Answers

CORPUS = Path(__file__).parents[1] / "corpus"
CASES = [json.loads(line) for line in (CORPUS / "read.jsonl").read_text("utf-8").splitlines()]
CLOSE = 2e-3  # of a number
WORDS = 5  # of a refusal


def span(values):
    return float(values.max() - values.min())


def described(test):
    """What both readers give of a test."""
    lasts = float(test.time[-1] - test.time[0])
    size = {"rows": len(test.time), "lasts": lasts}
    return size | {"force": span(test.force), "way": span(test.displacement)}


def given(**facts):
    """The facts that are there."""
    return {name: value for name, value in facts.items() if value not in (None, "", 0)}


def of_a_machine(files, said):
    names = ("sign", "contact", "units", "area", "pads", "tests", "pad_from", "columns")
    words = {name: said[name] for name in names if name in said}
    answers = Answers.from_words(**words)
    faulty = bool(said.get("without_faulty"))
    found = convert(files, answers, without_faulty=faulty)
    return found.units, [
        {"name": test.test, "format": test.format.name, "signs": [test.signs.way, test.signs.load]}
        | {"zero": [test.zero, test.zero_sd]}
        | given(start=test.start_s)
        | given(pad=test.pad if test.pad != "pad" else None, dropped=sum(test.dropped.values()))
        | described(test)
        for test in found.tests
    ]


def of_a_study(file):
    found = read_measurements(file)
    return found.units, [
        {"name": test.name}
        | given(start=test.start_s)
        | given(pad=test.pad if test.pad != "pad" else None, role=test.role, rate=test.rate)
        | given(control=test.control and str(test.control), contact_sd=test.contact_sd)
        | given(fluid=pad.fluid, sd=None if test.force_sd is None else float(test.force_sd[0]))
        | described(test)
        for pad in found.pads
        for test in pad.tests
    ]


def as_read(files, by, said):
    """What comes of the files, or the place and the first words of the refusal."""
    try:
        units, tests = of_a_machine(files, said) if by == "convert" else of_a_study(*files)
    except InputError as error:
        place = given(line=error.line, option=getattr(error, "option", None))
        place |= given(file=Path(str(error.file)).name if error.file else None)
        return {"refused": place | {"says": " ".join(error.message.split()[:WORDS])}} | {
            "plain": "\n" not in str(error) and bool(error.remedy)
        }
    return {"units": [units.displacement, units.force], "tests": tests}


def assert_same(found, kept):
    assert found.keys() == kept.keys()
    for name, value in kept.items():
        wide = 0.3 * value[1] if name == "zero" and value[1] else 1e-9
        ours, theirs = (np.ravel(np.array(x, object)) for x in (found[name], value))
        for a, b in zip(ours, theirs, strict=True):
            near = pytest.approx(b, rel=CLOSE, abs=wide) if isinstance(a, float) else b
            assert a == near, (name, ours, value)


@pytest.mark.parametrize("case", CASES, ids=lambda case: next(iter(case["files"])))
def test_a_stored_file_is_read_as_it_was(case, tmp_path, in_this_process):
    """What a file is called is the name of its test."""
    files = []
    for stored, name in case["files"].items():
        if name.endswith(".xlsx"):
            pytest.importorskip("python_calamine")
        files.append(tmp_path / name)
        files[-1].write_bytes((CORPUS / "read" / stored).read_bytes())
    found = as_read(files, case["by"], case.get("said", {}))
    assert found.keys() >= case.keys() - {"files", "by", "said"}
    if "refused" in case:
        assert found == {"refused": case["refused"], "plain": True}  # one line, with a remedy
        return
    assert found["units"] == case["units"]
    assert len(found["tests"]) == len(case["tests"])
    for ours, theirs in zip(found["tests"], case["tests"], strict=True):
        assert_same(ours, theirs)


def test_every_stored_file_is_a_case():
    """And none is stored that no case reads."""
    stored = [name for case in CASES for name in case["files"]]
    assert {path.name for path in (CORPUS / "read").iterdir()} == set(stored)
    assert all(re.fullmatch(r"[\w.-]+", name) for name in stored)


if __name__ == "__main__":
    paths = [Path(word) for word in sys.argv[1:]]
    by = "read" if len(paths) == 1 and b"time_s" in paths[0].read_bytes()[:200] else "convert"
    kept = {"files": {path.name: path.name for path in paths}, "by": by}
    found = as_read(paths, by, {})
    found.pop("plain", None)
    print(json.dumps(kept | found, ensure_ascii=False))
