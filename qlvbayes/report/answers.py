"""The four questions, each with an answer in a line or two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qlvbayes.diagnosis.phrases import answer, model_name
from qlvbayes.fitting.residuals import Cell, CheckResult
from qlvbayes.io.wording import NBSP
from qlvbayes.report.boxes import seen
from qlvbayes.report.collect import PadResults, Results
from qlvbayes.report.comparing import Comparing
from qlvbayes.report.constants import constants_words
from qlvbayes.report.failing import where


@dataclass(frozen=True)
class Answer:
    """A question, the anchor of its section, and the answer in short lines."""

    number: int
    question: str
    anchor: str
    lines: tuple[str, ...]


def answers(results: Results, compared: Sequence[Comparing], remedies: dict) -> tuple[Answer, ...]:
    """Return the answers in the order of the sections; a missing step names its command."""
    pads = results.pads
    return (
        Answer(
            1,
            "What are the constants, and how sure?",
            "constants",
            tuple(f"Pad {pad.name}: {constants_words(pad) or 'not fitted.'}" for pad in pads),
        ),
        Answer(2, "Do the pads differ?", "compare", _differ(results, compared, remedies)),
        Answer(
            3,
            "Where does the model fail?",
            "fails",
            tuple(f"Pad {pad.name}: {_fails(pad, remedies)}" for pad in pads),
        ),
        Answer(
            4,
            "Which effect is missing?",
            "effects",
            tuple(f"Pad {pad.name}: {_missing(pad, remedies)}" for pad in pads),
        ),
    )


def split_first(text: str) -> tuple[str, str]:
    """Return the first sentence, and the rest; no line breaks within a share."""
    for sign in (" %", "> 99.9", "< 0.1"):
        text = text.replace(sign, sign.replace(" ", NBSP))
    head, stop, rest = text.partition(". ")
    return (f"{head}.", rest) if stop else (text, "")


def _differ(results: Results, compared: Sequence[Comparing], remedies: dict) -> tuple[str, ...]:
    if len(results.pads) < 2:
        return ("There is only one pad here.",)
    return tuple(comparison.line for comparison in compared) or (
        f"Not compared yet: {remedies['compare']}",
    )


def _fails(pad: PadResults, remedies: dict) -> str:
    check = pad.final.check
    if check is None:
        return f"not checked yet: {remedies['check']}"
    worst = check.worst
    outcome = "fails nowhere by more than noise" if worst is None else _worst(worst, check, pad)
    baseline = pad.baseline.check if pad.baseline else None
    if pad.final.effects and baseline and (worst := baseline.worst):
        return (
            f"the model {model_name(pad.final.effects)} {outcome}; the plain model "
            f"{_worst(worst, baseline, pad)}."
        )
    return f"the model {outcome}."


def _worst(cell: Cell, check: CheckResult, pad: PadResults) -> str:
    location = where(cell, check.noise, pad.force_unit)
    return f"fails in {len(check.failing)} of {len(check.cells)} phases, worst in {location}"


def _missing(pad: PadResults, remedies: dict) -> str:
    if pad.diagnosis is None:
        return f"not diagnosed yet: {remedies['diagnose']}"
    return answer(pad.diagnosis, seen)
