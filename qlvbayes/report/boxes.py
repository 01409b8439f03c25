"""The verdict on each pad in a box: one line, what was named, and the error on tests left out."""

from __future__ import annotations

import json
from dataclasses import dataclass

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.effects.catalogue import find
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import joined
from qlvbayes.model.choices import Choices
from qlvbayes.report.collect import PadResults
from qlvbayes.report.numbers import number, percent, with_unit


@dataclass(frozen=True)
class Named:
    """An effect of the verdict and what one sees of it."""

    name: str
    seen: str


@dataclass(frozen=True)
class Bar:
    """An error as a bar: its share of the longest, and its number."""

    label: str
    share: float
    text: str
    kind: str


@dataclass(frozen=True)
class Box:
    """What the reader is told first about one pad."""

    pad: str
    fluid: str | None
    kind: str
    badge: str
    line: str
    effects: tuple[Named, ...]
    bars: tuple[Bar, ...]
    bars_title: str
    warnings: tuple[str, ...]
    remedy: str | None


BADGES = {
    "adequate": "adequate",
    "missing_effect": "effect found",
    "ambiguous": "ambiguous",
    "partly_explained": "partly explained",
    "unexplained": "unexplained",
}


def verdict_box(pad: PadResults, remedy: str) -> Box:
    """Return the box of one pad; ``remedy`` is the command that would diagnose it."""
    diagnosis = pad.diagnosis
    verdict = diagnosis.verdict if diagnosis else ""
    shown = (diagnosis.group or diagnosis.effects) if diagnosis else ()
    return Box(
        pad.name,
        pad.fluid,
        verdict or "open",
        BADGES.get(verdict, verdict or "not diagnosed"),
        verdict_line(diagnosis) if diagnosis else _undiagnosed(pad),
        tuple(Named(name, seen(name)) for name in shown),
        _bars(diagnosis, pad.force_unit) if diagnosis else (),
        f"Error {_of_what(diagnosis)} (root mean square)" if diagnosis else "",
        tuple(_warnings(pad)),
        None if diagnosis else remedy,
    )


def seen(name: str) -> str:
    """Return what one would see of an effect; nothing for a user's own."""
    try:
        return find(name).seen
    except InputError:
        return ""


def verdict_line(diagnosis: DiagnosisResult) -> str:
    """Return the verdict in one line; named effects follow it."""
    many = len(diagnosis.effects) > 1
    return {
        "adequate": f"Nothing is missing that these tests can show{_on_laws(diagnosis)}.",
        "missing_effect": f"The plain model lacks {'these effects' if many else 'one effect'}"
        f"{_sure(diagnosis)}:",
        "ambiguous": f"Something is missing{besides(diagnosis)}, and these tests cannot tell which of "
        "these it is:",
        "partly_explained": f"The plain model lacks {'these effects' if many else 'this effect'}"
        f"{_sure(diagnosis)}, and something that none of the known effects explains:",
        "unexplained": "Something is missing that none of the known effects explains.",
    }.get(diagnosis.verdict, diagnosis.verdict)


def besides(diagnosis: DiagnosisResult) -> str:
    """Return what an ambiguous verdict is sure of; the last effect stands for the group."""
    sure = list(diagnosis.effects[:-1])
    return f" besides {joined(sure)}" if sure else ""


def _on_laws(diagnosis: DiagnosisResult) -> str:
    """Return the base laws, where they are not those chosen."""
    if not diagnosis.changed:
        return ""
    return f", with other laws than were chosen: {joined(diagnosis.changed)}"


def _sure(diagnosis: DiagnosisResult) -> str:
    if len(diagnosis.effects) != 1:
        return ""
    return f" (probability {percent(diagnosis.probability_of(diagnosis.effects[0]))})"


def _undiagnosed(pad: PadResults) -> str:
    check = pad.final.check
    if check is None:
        return "Fitted, but neither checked nor diagnosed."
    fails = len(check.failing)
    if not fails:
        return "Not diagnosed. The fit is off by more than noise in no phase of any test."
    return f"Not diagnosed. The fit fails in {fails} of {len(check.cells)} phases of its tests."


def _of_what(diagnosis: DiagnosisResult) -> str:
    return "of the fit" if _heldout(diagnosis) is None else "on tests left out"


def _heldout(diagnosis: DiagnosisResult) -> list[float] | None:
    """Errors on tests left out, stage by stage; None for one test alone, which leaves none out."""
    known = [stage.heldout_rmse for stage in diagnosis.stages if stage.heldout_rmse is not None]
    return known if len(known) == len(diagnosis.stages) else None


def _bars(diagnosis: DiagnosisResult, unit: str) -> tuple[Bar, ...]:
    first, last = diagnosis.stages[0], diagnosis.stages[-1]
    errors = _heldout(diagnosis) or [stage.rmse for stage in diagnosis.stages]
    kind = "after" if diagnosis.verdict == "adequate" else "before"
    rows = [("plain model", errors[0], kind)]
    added = [e for e in last.effects if e not in first.effects]
    changed = [*diagnosis.changed, *added]
    if changed:
        rows.append((f"with {' + '.join(changed)}", errors[-1], "after"))
    if first.effects:
        rows[0] = (f"with {' + '.join(first.effects)}", *rows[0][1:])
    rows.append(("noise alone", diagnosis.noise, "noise"))
    longest = max(value for _, value, _ in rows) or 1.0
    return tuple(
        Bar(label, value / longest, with_unit(number(value, zeros=True), unit), kind)
        for label, value, kind in rows
    )


def _warnings(pad: PadResults) -> list[str]:
    summary = pad.final.summary
    troubles = summary.troubles if summary and not summary.converged else ()
    warnings = [f"The sampling has not converged: {text}." for text in troubles]
    warnings += _notices(pad)
    return warnings + _other_laws(pad)


def _other_laws(pad: PadResults) -> list[str]:
    """Return a sentence where the fit lacks the laws that the diagnosis asks for."""
    diagnosis, chosen = pad.diagnosis, pad.final.facts.get("choices")
    if diagnosis is None or chosen is None or diagnosis.verdict == "unexplained":
        return []
    try:
        own = Choices.from_dict(json.loads(chosen))
    except InputError:  # a law's file that has gone
        return []
    base = diagnosis.base
    if (own.law, own.relaxing) == base.pair:
        return []
    words = ["--elastic", base.elastic, "--relaxation", base.relaxation]
    words += [word for name in own.effects for word in ("--add", name)]
    return [
        f"These tests ask for other laws than the fit has (probability "
        f"{percent(base.probability)}): fit again with {' '.join(words)}."
    ]


def _notices(pad: PadResults) -> list[str]:
    """About the measurements, and a systematic error that is certain but small."""
    parts = (pad.final.summary, pad.final.check, pad.diagnosis)
    notices = dict.fromkeys(text for part in parts if part for text in part.notices)
    said = [text.removeprefix(f"pad {pad.name}: ") for text in notices]
    return [f"{text[0].upper()}{text[1:]}." for text in said] + _small(pad)


def _small(pad: PadResults) -> list[str]:
    """Return a sentence on a remainder that the verdict does not count."""
    diagnosis = pad.diagnosis
    left = diagnosis.remainder if diagnosis else None
    if diagnosis is None or left is None or not left.sure:
        return []
    if diagnosis.verdict in ("unexplained", "partly_explained"):
        return []
    size = with_unit(number(left.rms, 2), pad.force_unit)
    return [
        f"A systematic error is left that is certain but small: {percent(left.share_of_peak)} of "
        f"the peak force ({size}) in the {left.phase} of {left.test}."
    ]
