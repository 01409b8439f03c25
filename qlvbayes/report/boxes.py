"""The verdict on each pad in a box: one line, what was named, and the error on tests left out."""

from __future__ import annotations

import json
from dataclasses import dataclass

from qlvbayes.diagnosis.phrases import BADGES, box_line, model_name, shown_effects
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.effects.catalogue import find
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import capitalized, number, percent_unbroken, with_unit
from qlvbayes.model.choices import Choices
from qlvbayes.report.collect import PadResults


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
    """The verdict on one pad, which the page begins with."""

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


def verdict_box(pad: PadResults, remedy: str) -> Box:
    """Return the box of one pad; ``remedy`` is the command that would diagnose it."""
    diagnosis = pad.diagnosis
    shown = shown_effects(diagnosis) if diagnosis else ()
    return Box(
        pad.name,
        pad.fluid,
        diagnosis.verdict if diagnosis else "open",
        BADGES[diagnosis.verdict] if diagnosis else "not diagnosed",
        box_line(diagnosis) if diagnosis else _undiagnosed(pad),
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
    """Return the errors on tests left out, by stage; None where there is only one test."""
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
        rows.append((model_name(changed), errors[-1], "after"))
    if first.effects:
        rows[0] = (model_name(first.effects), *rows[0][1:])
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
    if (own.elastic, own.relaxing) == base.pair:
        return []
    words = ["--elastic", base.elastic, "--relaxation", base.relaxation]
    words += [word for name in own.effects for word in ("--add", name)]
    return [
        f"These tests ask for other laws than the fit has (probability "
        f"{percent_unbroken(base.probability)}): fit again with {' '.join(words)}."
    ]


def _notices(pad: PadResults) -> list[str]:
    """Return notices on the measurements, and on a systematic error that is certain but small."""
    parts = (pad.final.summary, pad.final.check, pad.diagnosis)
    notices = dict.fromkeys(text for part in parts if part for text in part.notices)
    sentences = [text.removeprefix(f"pad {pad.name}: ") for text in notices]
    return [f"{capitalized(text)}." for text in sentences] + _small(pad)


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
        "A systematic error is left that is certain but small: "
        f"{percent_unbroken(left.share_of_peak)} of the peak force ({size}) in the {left.phase} of "
        f"{left.test}."
    ]
