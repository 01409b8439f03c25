"""Which verdicts are right: one predicate a question, on kept studies, and the rates of all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.evaluation.rate import Case, Rate

LARGEST_GROUP = 3  # of effects, that still says something


def is_right(case: Case) -> bool:
    """The verdict names what is hidden, all of it and nothing else, without a rival."""
    if case["kind"] == "none":
        return bool(case["verdict"] == "adequate")
    return case["verdict"] == "missing_effect" and set(case["effects"]) == set(case["names"])


def is_right_or_grouped(case: Case) -> bool:
    """Right, or the truth is one reading of an ambiguous verdict with at most three rivals.

    Rivals stand in the place of the effect that was added last.
    """
    if is_right(case) or case["kind"] == "none" or case["verdict"] != "ambiguous":
        return is_right(case)
    rivals, certain = case["group"], case["effects"][:-1]
    readings = [{*certain, rival} for rival in rivals]
    return len(rivals) <= LARGEST_GROUP and set(case["names"]) in readings


def is_left_open(case: Case) -> bool:
    """Right or grouped, or the truth is one of the first three explanations not ruled out.

    The verdict says so whatever it names; nothing may be one of them.
    """
    left = [set(effects) for effects in case.get("not_ruled_out", [])]
    return is_right_or_grouped(case) or set(case["names"]) in left[:LARGEST_GROUP]


def ranks_first(case: Case) -> bool:
    """The first round gives the hidden effect the highest probability, whatever the verdict."""
    return case["names"] == _ranked(case)[:1]


def ranks_high(case: Case) -> bool:
    """The hidden effect is among the three likeliest hypotheses of the first round."""
    return case["names"][0] in _ranked(case)[:LARGEST_GROUP]


def _ranked(case: Case) -> list[str]:
    found = case.get("probabilities", {})
    return sorted(found, key=lambda name: -found[name])


def names_family(case: Case) -> bool:
    """An effect of the hidden form's family is named, alone or among at most three rivals."""
    if case["verdict"] not in ("missing_effect", "ambiguous"):
        return False
    group = case["group"] if len(case["group"]) <= LARGEST_GROUP else []
    return bool({*case["effects"], *group} & set(case["family"]))


def names_anything(case: Case) -> bool:
    """An effect is named, in doubt or not."""
    return case["verdict"] in ("missing_effect", "ambiguous")


def is_confident(case: Case) -> bool:
    """Effects are named without a rival."""
    return bool(case["verdict"] == "missing_effect")


def is_unexplained(case: Case) -> bool:
    """The verdict is that no listed effect explains the data."""
    return bool(case["verdict"] == "unexplained")


def abstains(case: Case) -> bool:
    """No single answer: ambiguous or unexplained."""
    return case["verdict"] in ("ambiguous", "unexplained")


@dataclass(frozen=True)
class Question:
    """What is asked of the studies of some kinds."""

    name: str
    kinds: tuple[str, ...]
    hit: Callable[[Case], bool]
    words: str


_ALL = ("none", "single", "double", "form", "outside")
QUESTIONS = (
    Question("single_right", ("single",), is_right, "one effect: named"),
    Question(
        "single_right_or_group", ("single",), is_right_or_grouped,
        "one effect: named, or in an ambiguous verdict's group of at most three",
    ),
    Question(
        "single_left_open", ("single",), is_left_open,
        "one effect: named, or of at most three left open",
    ),
    Question("single_first", ("single",), ranks_first, "one effect: ranked first"),
    Question("single_high", ("single",), ranks_high, "one effect: ranked among the first three"),
    Question("double_both", ("double",), is_right, "two effects: both named"),
    Question(
        "double_both_or_group", ("double",), is_right_or_grouped,
        "two effects: both named, or the last among at most three",
    ),
    Question("form_family", ("form",), names_family, "other form: its family named"),
    Question("outside_unexplained", ("outside",), is_unexplained, "outside the list: unexplained"),
    Question(
        "outside_confident", ("outside",), is_confident,
        "outside the list: confidently named, wrong",
    ),
    Question("false_alarm", ("none",), names_anything, "nothing missing: an effect named"),
    Question("none_unexplained", ("none",), is_unexplained, "nothing missing: unexplained"),
    Question("abstention", _ALL, abstains, "all studies: ambiguous or unexplained"),
    Question("failed", _ALL, lambda case: case["verdict"] == "failed", "all studies: failed"),
)  # fmt: skip


def could_be_seen(cases: Sequence[Case]) -> list[Case]:
    """Studies whose hidden effects the tests could show; where nothing is missing, all."""
    return [case for case in cases if case["seen"]]


def rates(cases: Sequence[Case]) -> dict[str, dict[str, Rate]]:
    """Every question over all studies and over those that could be seen: [question][all, seen]."""
    groups = {"all": list(cases), "seen": could_be_seen(cases)}
    return {
        question.name: {
            which: Rate.of((c for c in some if c["kind"] in question.kinds), question.hit)
            for which, some in groups.items()
        }
        for question in QUESTIONS
    }


def ceiling(cases: Sequence[Case]) -> float | None:
    """Share of single effects that could be seen whose evidence the noise lets pass, expected.

    What a diagnosis that never errs would name. None without such studies.
    """
    return _mean([min(c["chance"].values()) for c in _single(cases) if "chance" in c])


def promised(cases: Sequence[Case]) -> float | None:
    """Mean probability of the first-ranked hypothesis where a single effect could be seen.

    What the probabilities themselves say that naming the likeliest would be right in.
    """
    return _mean([max(c["probabilities"].values()) for c in _single(cases) if "probabilities" in c])


def _single(cases: Sequence[Case]) -> list[Case]:
    return [c for c in could_be_seen(cases) if c["kind"] == "single"]


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def heldout(cases: Sequence[Case]) -> dict[str, dict[str, float | int | None]]:
    """Median error on left-out tests over the noise floor, by kind: plain model and last one.

    Of studies that could be seen.
    """
    found: dict[str, dict[str, float | int | None]] = {}
    for kind in _ALL:
        some = [c for c in could_be_seen(cases) if c["kind"] == kind and "stages" in c]
        ratios = [heldout_ratios(case) for case in some]
        before, after = np.median(ratios, axis=0).tolist() if ratios else (None, None)
        found[kind] = {"n": len(ratios), "plain": before, "final": after}
    return found


def heldout_ratios(case: Case) -> tuple[float, float]:
    """Error on left-out tests over the noise floor, of the plain model and of the last one."""
    first, last = case["stages"][0], case["stages"][-1]
    return first["heldout_rmse"] / case["floor"], last["heldout_rmse"] / case["floor"]
