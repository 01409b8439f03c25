"""The verdict on each pad in a box, and the four questions, each answered in a line."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

from qlvbayes.diagnosis.phrases import BADGES, answer, box_line, model_name, parts, shown_effects
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import capitalized, number, percent_unbroken, with_unit
from qlvbayes.model.choices import Choices
from qlvbayes.report.collect import PadResults, Results
from qlvbayes.report.errors import ErrorTable, where
from qlvbayes.report.questions import constants_words, in_a_line, seen


def verdict_box(pad: PadResults) -> dict[str, Any]:
    """Return the box of one pad, which the page begins with.

    ``bars`` has the label, the share of the longest, the value and the kind of each error.
    """
    d, warnings = pad.diagnosis, list(_warnings(pad))
    if d is None:
        check, line = pad.final.check, "Fitted, but neither checked nor diagnosed."
        if check is not None:
            line = f"Not diagnosed. {ErrorTable(check).in_words(pad.force_unit)}"
        return {
            "kind": "open", "badge": "not diagnosed", "line": line, "effects": (), "bars": [],
            "warnings": warnings,
        }  # fmt: skip
    left_out = f"on {parts(d)} left out" if _heldout(d) else "of the fit"
    return {
        "kind": d.verdict, "badge": BADGES[d.verdict], "line": box_line(d),
        "effects": shown_effects(d), "bars": _bars(d, pad.force_unit),
        "bars_title": f"Error {left_out} (root mean square)", "warnings": warnings,
    }  # fmt: skip


def answers(results: Results, remedies: dict[str, str]) -> list[tuple[str, str, list[str]]]:
    """Return question, section and answers; a step that was not done names its command."""
    differ = [in_a_line(one.comparison) for one in results.comparisons]
    if len(results.pads) < 2 and not differ:  # one may be compared with a pad of another folder
        differ = ["There is only one pad here."]
    undone = f"not diagnosed yet: {remedies['diagnose']}"

    def of_each(words: Callable[[PadResults], str]) -> list[str]:
        return [f"{capitalized(pad.title)}: {words(pad)}" for pad in results.pads]

    constants = of_each(lambda pad: constants_words(pad) or "not fitted.")
    missing = of_each(lambda pad: answer(pad.diagnosis, seen) if pad.diagnosis else undone)
    return [
        ("What are the constants, and how sure?", "constants", constants),
        ("Do the pads differ?", "compare", differ or [f"Not compared yet: {remedies['compare']}"]),
        ("Where does the model fail?", "fails", of_each(lambda pad: _fails(pad, remedies))),
        ("Which effect is missing?", "effects", missing),
    ]


def _fails(pad: PadResults, remedies: dict[str, str]) -> str:
    """Return where the last model fails, and the plain one where effects were added."""
    tables = pad.errors
    if not tables:
        return f"not checked yet: {remedies['check']}"
    words = []
    for table in reversed(tables):
        check, worst = table.check, table.check.worst
        count = f"fails in {len(check.failing) or 'none'} of {len(check.cells)} phases"
        most = f", worst in {where(worst, check.noise, pad.force_unit)}" if worst else ""
        name = f"the {'model ' if check.effects else ''}{model_name(check.effects)}"
        words.append(f"{table.basis}, {name} {count}{most}")
    return f"{'; '.join(words)}."


def _heldout(d: DiagnosisResult) -> list[float] | None:
    """Return the errors on tests left out, by stage; None where there is only one test."""
    known = [stage.heldout_rmse for stage in d.stages if stage.heldout_rmse is not None]
    return known if len(known) == len(d.stages) else None


def _bars(d: DiagnosisResult, unit: str) -> list[tuple[str, float, str, str]]:
    first, last = d.stages[0], d.stages[-1]
    errors = _heldout(d) or [stage.rmse for stage in d.stages]
    changed = [*d.changed, *(e for e in last.effects if e not in first.effects)]
    kind = "after" if d.verdict == "adequate" else "before"
    rows = [(model_name(first.effects), errors[0], kind)]
    rows += [(model_name(changed), errors[-1], "after")] if changed else []
    rows.append(("noise alone", d.noise, "noise"))
    longest = max(value for _, value, _ in rows) or 1.0
    return [
        (label, value / longest, with_unit(number(value, zeros=True), unit), kind)
        for label, value, kind in rows
    ]


def _warnings(pad: PadResults) -> Iterator[str]:
    """Yield what to know before anything is believed: sampling, notices, small errors, laws."""
    summary, d = pad.final.summary, pad.diagnosis
    for text in summary.troubles if summary and not summary.converged else ():
        yield f"The sampling has not converged: {text}."
    for text in pad.notices:
        yield f"{capitalized(text.removeprefix(f'pad {pad.name}: '))}."
    left = d.remainder if d else None
    if d and left and left.sure and d.verdict not in ("unexplained", "partly_explained"):
        yield (
            "In the diagnosis's fit to all tests a systematic error is left that is certain but "
            f"small: {percent_unbroken(left.share_of_peak)} of the peak force "
            f"({with_unit(number(left.rms, 2), pad.force_unit)}) in the {left.phase} of "
            f"{left.test}."
        )
    yield from _other_laws(pad)


def _other_laws(pad: PadResults) -> Iterator[str]:
    """Yield a sentence where the fit lacks the laws that the diagnosis asks for."""
    d, chosen = pad.diagnosis, pad.final.facts.get("choices")
    if d is None or chosen is None or d.verdict == "unexplained":
        return
    try:
        own = Choices.from_dict(json.loads(chosen))
    except InputError:  # a law's file that has gone
        return
    if (own.elastic, own.relaxing) != d.base.pair:
        words = ["--elastic", d.base.elastic, "--relaxation", d.base.relaxation]
        words += [word for name in own.effects for word in ("--add", name)]
        yield (
            "These tests ask for other laws than the fit has (probability "
            f"{percent_unbroken(d.base.probability)}): fit again with {' '.join(words)}."
        )
