"""The other questions in words: constants, whether pads differ, and what an effect looks like."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

from qlvbayes.comparison.contrast import Comparison
from qlvbayes.effects.catalogue import find
from qlvbayes.effects.effect import Level
from qlvbayes.fitting.summary import Constant, FitSummary
from qlvbayes.io import wording
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import NBSP, joined, number, percent_unbroken, with_unit
from qlvbayes.laws.catalogue import find_elastic, find_relaxation
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import NOISES
from qlvbayes.report.collect import PadResults

_INDEXED = re.compile(r"([cv])\[(\d+)\]")
_SMALLEST_CHANGE = 0.005  # smallest relative change that is worth a word
KINDS = {"greater": "differs", "less": "differs", "equal": "equal", "cannot tell": "open"}
"""Every answer of a comparison as the page marks it."""


def seen(name: str) -> str:
    """Return what one would see of an effect; nothing for a user's own."""
    try:
        return find(name).seen
    except InputError:
        return ""


def constant_names(pads: Sequence[PadResults]) -> list[str]:
    """Return every constant that any of the pads has: the material's, the effects', the noise's."""
    return sorted(dict.fromkeys(name for pad in pads for name in pad.parameters), key=_rank)


def constants_in_units(pads: Sequence[PadResults]) -> list[tuple[str, str]]:
    """Return every constant of the pads with its unit; one of several units is several times in it.

    Pads may be in other units, and a constant of the same name has another unit in another law.
    """
    every = [(name, c.unit) for pad in pads for name, c in pad.parameters.items()]
    names = constant_names(pads)
    return sorted(dict.fromkeys(every), key=lambda one: names.index(one[0]))


def meanings(pads: Sequence[PadResults]) -> dict[str, str]:
    """Return what each constant of the pads means."""
    kinds = NOISES.values()
    known = {kind.prefix + name: text for kind in kinds for name, text in kind.meanings.items()}
    acting: dict[str, list[str]] = {}
    for pad in pads:
        known |= _of_laws(pad)
        own = joined(sorted(filter(_reshapes, pad.final.effects)))
        acting.setdefault(own, []).append(pad.title)
    acts = [
        f"{added} acts{f' in {joined(titles)}' * (len(acting) > 1)}"
        for added, titles in acting.items()
        if added
    ]
    before = f", before {joined(acts)}" if acts else ""
    return {name: _meaning(name, known, before) for name in constant_names(pads)}


def constants_words(pad: PadResults) -> str | None:
    """Return one sentence of what is known of a pad's constants and from what."""
    summary = pad.final.summary
    if summary is None:
        return None
    m, v = (_in_words(name, summary.parameters) for name in ("m", "v[1]"))
    constants = [m, _lasting(summary), v]
    added = f", with {joined(pad.final.effects)} in the model" if pad.final.effects else ""
    return f"{'; '.join(text for text in constants if text)}{added}.{_doubt(pad)}"


def _doubt(pad: PadResults) -> str:
    # the diagnosis looks at all tests together: where it finds no structure, a phase that is off by
    # more than its own noise shifts no constant beyond its error
    check, found = pad.final.check, pad.diagnosis
    if check is None or not check.failing:
        return ""
    if found is not None and not found.verdict.has_unmodelled:
        phases = f"{len(check.failing)} of {len(check.cells)} phases"
        return f" In {phases} the error is larger than noise makes it (question 3)."
    return " But the model fails (question 3): these are constants of a wrong model."


def shifts_of(pad: PadResults) -> dict[str, Any] | None:
    """Return how the constants moved when the named effects came in.

    ``rows`` has each constant before and after with its relative change in words.
    """
    if pad.baseline is None or pad.baseline.effects == pad.final.effects:
        return None
    came = [e for e in pad.final.effects if e not in pad.baseline.effects]
    reshaped = any(map(_reshapes, came))
    before, after = (_alike(one.summary, reshaped) for one in (pad.baseline, pad.final))
    names = [n for n in sorted(before, key=_rank) if n in after and before[n].unit == after[n].unit]
    if not names:
        return None
    changes = {n: before[n].median / after[n].median - 1.0 for n in names}
    rows = [
        (n, before[n], after[n], f"{100.0 * changes[n]:+.1f}{NBSP}%".replace("-", "−"))
        for n in names
    ]
    added = joined(came)
    top = sorted(names, key=lambda n: -abs(changes[n]))[:2]
    changed = [
        f"{n} {100.0 * abs(changes[n]):.0f}{NBSP}% {'higher' if changes[n] > 0 else 'lower'}"
        for n in top
        if abs(changes[n]) > _SMALLEST_CHANGE
    ]
    words = f"The model without {added} has {joined(changed)}" if changed else ""
    few = ". It was fitted to fewer tests, so that a part of this may be chance"
    fewer = pad.baseline.facts.get("all_tests") != pad.final.facts.get("all_tests")
    return {"effects": added, "rows": rows, "words": f"{words}{few * fewer}." if words else ""}


def _alike(summary: FitSummary | None, reshaped: bool) -> dict[str, Constant]:
    # where the relaxation was reshaped, the share of the whole model that never relaxes is among
    # them instead of the law's own shares, which mean something else in the other model
    if summary is None:
        return {}
    own = {n: c for n, c in summary.parameters.items() if not n.startswith("noise.")}
    if reshaped:
        own = {n: c for n, c in own.items() if n != "c0" and not n.startswith("c[")}
        own |= {"never relaxes": summary.never_relaxes} if summary.never_relaxes else {}
    return own


def _in_words(name: str, parameters: dict[str, Constant]) -> str:
    c = parameters.get(name)
    if c is None:
        return ""
    if name == "v[1]" and c.median > 0.0:
        time = f"{number(1.0 / c.median, 2)}{NBSP}s"
        return f"the quickest relaxation has a time constant of {time} (1/v[1])"
    median, low, high = wording.ends(c.median, *c.hdi90)
    return f"{name} = {with_unit(median, c.unit)} (with 90 % probability {low} to {high})"


def _lasting(summary: FitSummary) -> str:
    """Return which share of the force never relaxes, effects that change it included."""
    c = summary.never_relaxes
    if c is None and not any(map(_reshapes, summary.effects)):  # a file that does not state it
        c = summary.parameters.get("c[0]", summary.parameters.get("c0"))
    if c is None:
        return ""
    middle, low, high = (f"{100.0 * x:.1f}" for x in (c.median, *c.hdi90))
    return f"{middle}{NBSP}% of the force never relaxes ({low} to {high}{NBSP}%)"


def _reshapes(effect: str) -> bool:
    """Return whether an effect changes the relaxation; false for a user's own, not known here."""
    try:
        return find(effect).level == Level.MATERIAL
    except InputError:
        return False


def _of_laws(pad: PadResults) -> dict[str, str]:
    """Return the meanings of the constants of a pad's laws, none if the user's file is gone."""
    try:
        given = Choices.from_dict(json.loads(pad.final.facts.get("choices", "{}")))
        elastic = find_elastic(given.elastic, given.laws)
        return elastic.meanings | find_relaxation(given.relaxation, given.laws).meanings
    except InputError:
        return {}


def _meaning(name: str, known: dict[str, str], before: str) -> str:
    """Return the meaning of a constant in words; shares are those ``before`` effects act."""
    match = _INDEXED.fullmatch(name)
    if match and match[1] == "c":
        index = int(match[2])
        what = f"relaxes at v[{index}]" if index else "never relaxes"
        return f"share that {what}{before}"
    if match:
        return f"rate at which c[{match[2]}] relaxes"
    effect = name.partition(".")[0]
    return known.get(name) or (f"of {effect}: {what}" if (what := seen(effect)) else "")


def _rank(name: str) -> tuple[int, str, int]:
    """Return the rank of a constant in the paper's order: m, b, c, v; effects; noise."""
    match = _INDEXED.fullmatch(name)
    if match:
        return ("cv".index(match[1]) + 2, "", int(match[2]))
    if name in ("m", "b"):
        return ("mb".index(name), "", 0)
    return (6 if name.startswith("noise.") else 5 if "." in name else 4, "", 0)


def in_a_line(comparison: Comparison) -> str:
    """Return whether they differ, and in which constants, or quantities if there are none."""
    pair, by_answer = " and ".join(comparison.names), dict[str, list[str]]()
    for one in comparison.of_group("constants") or comparison.contrasts:
        by_answer.setdefault(KINDS.get(one.answer, "open"), []).append(one.quantity)
    within = f"equal within {percent_unbroken(comparison.region)} in"
    words = {"differs": "different in", "equal": within, "open": "undecided in"}
    where = "; ".join(f"{words[k]} {joined(by_answer[k])}" for k in words if k in by_answer)
    if comparison.omnibus is None and comparison.differ is None:
        return f"{pair} share no constant that a joint test could compare; one by one: {where}."
    if comparison.differ and where.startswith("different "):
        return f"{pair} differ {where.removeprefix('different ')}."
    head = {
        True: f"{pair} differ",
        False: f"No difference between {pair} is shown",
        None: f"These tests cannot tell whether {pair} differ",
    }[comparison.differ]
    return f"{head}: {where}."


def compared_words(comparison: Comparison, written: Sequence[str]) -> list[str]:
    """Return the paragraphs of a comparison's answer, without its notices."""
    notices = [text.lower() for text in comparison.notices]
    words = comparison.words or written or (in_a_line(comparison),)
    return [text for text in words if text.rstrip(".").lower() not in notices]


def diagnosis_words(pad: PadResults) -> list[str]:
    """Return the paragraphs of diagnosis.txt below a heading that names the pad."""
    heads = (f"Pad {pad.name}: ", "The pad: ")
    own = [text.replace("+-", "±") for text in pad.words]
    for head in heads:
        own = [text.removeprefix(head) for text in own]
    return [wording.capitalized(text) for text in own]
