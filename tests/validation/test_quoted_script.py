"""Figures that pages quote agree with each other; `quoted.py` compares them with a fresh run."""

import pytest
from quoted import BEFORE, ERRORS, FIT, TABLE, Cell, cells, inconsistent, numbers_of

from qlvbayes.fitting.summary import Constant

PAPER = TABLE.read_text(encoding="utf-8")
LIMITS = ERRORS.read_text(encoding="utf-8")


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
