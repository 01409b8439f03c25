"""Figures that pages quote agree with each other; `quoted.py` compares them with a fresh run."""

import json
import re

import pytest
from quoted import BEFORE, ERRORS, FIT, ROOT, TABLE, Cell, cells, inconsistent, numbers_of

from qlvbayes.fitting.summary import Constant

PAPER = TABLE.read_text(encoding="utf-8")
LIMITS = ERRORS.read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
RELIABILITY = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
RUNS = ("bounds", "beam", "support")  # the columns of the table of runs away from the rig


def test_every_constant_of_three_pads_is_quoted_by_three_methods():
    found = cells(PAPER)
    assert len(found) == 3 * 7 * 3
    assert {cell.pad for cell in found} == {"A", "B", "C"}


def test_marks_and_counts_follow_from_the_numbers():
    assert list(inconsistent(PAPER)) == []


def test_a_wrong_mark_and_a_wrong_count_are_told():
    row = next(line for line in PAPER.splitlines() if "**" in line and line.startswith("| A |"))
    unmarked = PAPER.replace(row, row.replace("**", ""))
    assert len(list(inconsistent(unmarked))) == row.count("**") / 2
    miscounted = PAPER.replace("those of two-step 14", "those of two-step 13")
    assert len(list(inconsistent(miscounted))) == 1


def test_the_sentences_that_are_checked_are_there():
    ratio, fit, squares, _ = numbers_of(FIT, LIMITS)
    assert ratio == pytest.approx(fit / squares, abs=0.01)
    before, least = numbers_of(BEFORE, LIMITS)
    assert before == pytest.approx(least, rel=0.05)  # the curve follows the readings
    with pytest.raises(ValueError, match="not there"):
        numbers_of(FIT, "nothing")


@pytest.mark.parametrize(("shift", "agrees"), [(0.01, True), (0.02, False)])
def test_an_interval_agrees_to_what_a_chain_leaves_open(shift, agrees):
    cell = Cell("A", "m", "emcee", 0.5, 0.5, 0.45, 0.55, marked=False)
    own = Constant("N/mm", 0.5, 0.03, 0.5 + shift, (0.45, 0.55 + shift), None, None)
    assert cell.agrees(own) == agrees


def rates(page):
    """Return the rates of a run of blind studies, as counted."""
    return json.loads((ROOT / "docs" / f"{page}.json").read_text(encoding="utf-8"))["rates"]


def counted(rate):
    """As a table has it."""
    return f"{rate['hits']} of {rate['n']}"


def test_the_readme_quotes_the_published_runs():
    for run in (rates("wide_support"), rates("rig_studies")):
        for key in ("right", "single_named", "none_adequate"):
            assert f"{counted(run[key])} (at least {100 * run[key]['bound95']:.0f} %)" in README
        assert f"{counted(run['wrong'])} (at most {100 * run['wrong']['bound95']:.0f} %)" in README


def test_every_rate_of_the_page_on_reliability_is_that_of_its_run():
    away = RELIABILITY[RELIABILITY.index("## Away from the paper's rig") :]
    rows = dict(re.findall(r"^\| ([^|]+?) \| (.+?) \|$", away, re.M))
    columns = {
        "nothing hidden: called adequate": "none_adequate",
        "one effect: named": "single_named",
        "two effects: both named": "double_named",
        "another form: its family's name": "form_kin",
        "something outside the list, alone: left open": "outside_open",
        "a listed effect with something outside: named": "beside_named",
    }
    for words, key in columns.items():
        found = [cell.partition(" (")[0] for cell in rows[words].split(" | ")]
        assert found == [counted(rates(f"wide_{name}")[key]) for name in RUNS]


def test_every_rate_on_the_papers_rig_is_that_of_its_run():
    home = RELIABILITY[: RELIABILITY.index("## Away from the paper's rig")]
    rows = {
        words: (result, bound)
        for words, result, bound in re.findall(
            r"^\| ([^|]+): [^|]+ \| (\d+ of \d+) \(\d+ %\) \| at (?:least|most) (\d+) % \|",
            home,
            re.M,
        )
    }
    columns = {
        "nothing": "none_adequate",
        "one effect": "single_named",
        "two effects": "double_named",
        "another form": "form_kin",
        "something unmodelled, alone": "outside_open",
        "a candidate effect with something unmodelled": "beside_named",
    }
    found = rates("rig_studies")
    for words, key in columns.items():
        assert rows[words] == (counted(found[key]), f"{100 * found[key]['bound95']:.0f}")
