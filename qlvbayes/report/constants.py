"""The first question: the constants of each pad, and how sure they are."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

from qlvbayes.fitting.summary import Constant
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import DASH, NBSP, joined, number, to_sd, with_unit
from qlvbayes.laws.catalogue import find_elastic, find_relaxation
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import NOISES
from qlvbayes.report.boxes import seen
from qlvbayes.report.collect import FitResults, PadResults

_INDEXED = re.compile(r"([cv])\[(\d+)\]")
_SMALLEST_CHANGE = 0.005  # smallest relative change that is worth a word


@dataclass(frozen=True)
class Value:
    """A constant of one pad: median and 90 % interval; a dash where it has none."""

    median: str
    interval: str


@dataclass(frozen=True)
class Row:
    """A constant of all pads."""

    name: str
    unit: str
    meaning: str
    values: tuple[Value, ...]


@dataclass(frozen=True)
class Shift:
    """A constant without and with the effects that the verdict names."""

    name: str
    unit: str
    before: str
    after: str
    change: str


@dataclass(frozen=True)
class Shifts:
    """Changes of one pad's constants where the effects are left out."""

    pad: str
    effects: str
    rows: tuple[Shift, ...]
    words: str


def constants_rows(pads: Sequence[PadResults]) -> tuple[Row, ...]:
    """Return every constant that any of the pads has: the material's, the effects', the noise's."""
    units: dict[str, str] = {}
    for pad in pads:
        units |= {name: c.unit for name, c in _parameters(pad.final).items()}
    names = sorted(units, key=_rank)
    meanings = _of_noises() | {n: text for pad in pads for n, text in _of_laws(pad).items()}
    return tuple(
        Row(
            name,
            "" if units[name] == "1" else units[name],
            _meaning(name, meanings),
            tuple(_value(_parameters(pad.final).get(name)) for pad in pads),
        )
        for name in names
    )


def constants_words(pad: PadResults) -> str | None:
    """Return one sentence of what is known of a pad's constants and from what."""
    summary = pad.final.summary
    if summary is None:
        return None
    shown = ("m", "c[0]", "c0", "v[1]")
    constants = [_in_words(name, summary.parameters) for name in shown]
    added = f", with {joined(pad.final.effects)} in the model" if pad.final.effects else ""
    doubt = " But the model fails (question 3): these are constants of a wrong model."
    wrong = bool(pad.final.check and pad.final.check.failing)
    return f"{'; '.join(text for text in constants if text)}{added}.{doubt * wrong}"


def shifts_of(pad: PadResults) -> Shifts | None:
    """Return how the constants moved when the named effects came in."""
    if pad.baseline is None or pad.baseline.effects == pad.final.effects:
        return None
    before, after = _parameters(pad.baseline), _parameters(pad.final)
    names = [n for n in sorted(before, key=_rank) if n in after and not n.startswith("noise.")]
    if not names:
        return None
    changes = {n: before[n].median / after[n].median - 1.0 for n in names}
    rows = tuple(
        Shift(
            name,
            "" if before[name].unit == "1" else before[name].unit,
            to_sd(before[name].median, before[name].sd),
            to_sd(after[name].median, after[name].sd),
            f"{100.0 * changes[name]:+.1f}{NBSP}%".replace("-", "−"),
        )
        for name in names
    )
    added = [e for e in pad.final.effects if e not in pad.baseline.effects]
    top = sorted(names, key=lambda n: -abs(changes[n]))[:2]
    changed = [
        f"{n} {100.0 * abs(changes[n]):.0f}{NBSP}% {'higher' if changes[n] > 0 else 'lower'}"
        for n in top
        if abs(changes[n]) > _SMALLEST_CHANGE
    ]
    words = f"The model without {joined(added)} has {joined(changed)}" if changed else ""
    few = ". It was fitted to fewer tests, so that a part of this may be chance"
    fewer = pad.baseline.facts.get("all_tests") != pad.final.facts.get("all_tests")
    return Shifts(pad.name, joined(added), rows, f"{words}{few * fewer}." if words else "")


def _in_words(name: str, parameters: dict[str, Constant]) -> str:
    c = parameters.get(name)
    if c is None:
        return ""
    if name in ("c[0]", "c0"):
        middle, low, high = (f"{100.0 * x:.1f}" for x in (c.median, *c.hdi90))
        return f"{middle}{NBSP}% of the force never relaxes ({low} to {high}{NBSP}%)"
    if name == "v[1]" and c.median > 0.0:
        time = f"{number(1.0 / c.median, 2)}{NBSP}s"
        return f"the quickest relaxation has a time constant of {time} (1/v[1])"
    low, high = (to_sd(x, c.sd) for x in c.hdi90)
    text = with_unit(to_sd(c.median, c.sd), c.unit)
    return f"{name} = {text} (with 90 % probability {low} to {high})"


def _parameters(model: FitResults) -> dict[str, Constant]:
    return model.summary.parameters if model.summary else {}


def _value(c: Constant | None) -> Value:
    if c is None:
        return Value(DASH, "")
    low, high = (to_sd(x, c.sd) for x in c.hdi90)
    return Value(to_sd(c.median, c.sd), "fixed" if c.fixed else f"{low} to {high}")


def _of_noises() -> dict[str, str]:
    """Return the meanings of the constants of all noise models."""
    kinds = NOISES.values()
    return {kind.prefix + name: text for kind in kinds for name, text in kind.meanings.items()}


def _of_laws(pad: PadResults) -> dict[str, str]:
    """Return the meanings of the constants of a pad's laws, none if the user's file is gone."""
    try:
        given = Choices.from_dict(json.loads(pad.final.facts.get("choices", "{}")))
        laws = (
            find_elastic(given.elastic, given.laws),
            find_relaxation(given.relaxation, given.laws),
        )
    except InputError:
        return {}
    return laws[0].meanings | laws[1].meanings


def _meaning(name: str, meanings: dict[str, str]) -> str:
    """Return the meaning of a constant in words."""
    match = _INDEXED.fullmatch(name)
    if match and match[1] == "c":
        index = int(match[2])
        return f"share that relaxes at v[{index}]" if index else "share that never relaxes"
    if match:
        return f"rate at which c[{match[2]}] relaxes"
    if name in meanings:
        return meanings[name]
    effect = name.partition(".")[0]
    what = seen(effect)
    return f"of {effect}: {what}" if what else ""


def _rank(name: str) -> tuple[int, str, int]:
    """Return the rank of a constant in the paper's order: m, b, c, v; effects; noise."""
    match = _INDEXED.fullmatch(name)
    if match:
        return ("cv".index(match[1]) + 2, "", int(match[2]))
    if name in ("m", "b"):
        return ("mb".index(name), "", 0)
    return (6 if name.startswith("noise.") else 5 if "." in name else 4, "", 0)
