"""The verdict in words: the same facts as a sentence, a line or a heading.

The summary, the page, the figures and the terminal state one verdict at different lengths. All take
their phrases from here, so that they agree.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from qlvbayes.diagnosis.decision import Verdict
from qlvbayes.diagnosis.result import DiagnosisResult, LawPair, Stage
from qlvbayes.io.wording import joined, pad_title, percent, percent_unbroken, plain

LIKELY = 0.5  # probability that nothing is missing from which the text says so
_BASELINE = "plain model"  # the laws that were chosen, without any added effect

BADGES = {
    Verdict.ADEQUATE: "adequate",
    Verdict.MISSING_EFFECT: "effect found",
    Verdict.AMBIGUOUS: "ambiguous",
    Verdict.PARTLY_EXPLAINED: "partly explained",
    Verdict.UNEXPLAINED: "unexplained",
}
"""Every verdict in one or two words."""


def model_name(effects: Sequence[str], laws: Sequence[str] = ()) -> str:
    """Return 'plain model', 'with viscous_drag + friction' or 'by hertz with friction'."""
    words = [_by(laws)] if laws else []
    words += [f"with {' + '.join(effects)}"] if effects else []
    return " ".join(words) or _BASELINE


def stage_name(stage: Stage, chosen: LawPair) -> str:
    """Return a step's laws, where they are not those chosen, and its effects."""
    return " + ".join((", ".join(stage.base.others(chosen)) or _BASELINE, *stage.effects))


def parts(d: DiagnosisResult) -> str:
    """Return what is left out in turn: tests, or the phases of a single one."""
    return "phases" if len({cell.test for cell in d.stages[0].cells}) == 1 else "tests"


def varying(d: DiagnosisResult) -> str:
    """Return between what a strength differs: tests, or the phases of a single one."""
    one = parts(d).removesuffix("s")
    return f"From {one} to {one}"


def shown_effects(d: DiagnosisResult) -> tuple[str, ...]:
    """Return the effects that a verdict shows: the group of an ambiguous one, else those named."""
    return d.group or d.effects


def paragraph_lead(d: DiagnosisResult, seen: Callable[[str], str]) -> str:
    """Return the sentence that the summary begins with."""
    if d.verdict == Verdict.ADEQUATE:
        none = percent(d.probability_of("none"))
        if d.probability_of("none") < LIKELY:
            return (
                "nothing is named, although something may be missing (probability that nothing "
                f"is: {none})."
            )
        return f"nothing is missing that these tests can show (probability {none})."
    if d.verdict == Verdict.AMBIGUOUS:
        group = [f"{name} ({percent(d.probability_of(name))})" for name in d.group]
        return (
            f"something is missing{_besides(d)}, and these tests cannot tell which of "
            f"{joined(group, 'or')} it is."
        )
    if d.verdict == Verdict.UNEXPLAINED:
        return "unexplained: something is missing that no effect of the list explains."
    named = joined(
        [f"{e} ({seen(e)}; probability {percent(d.probability_of(e))})" for e in d.effects]
    )
    many = len(d.effects) > 1
    if d.verdict == Verdict.MISSING_EFFECT:
        return f"missing effect{'s' * many}: {named}."
    return (
        f"partly explained: {named} {'are' if many else 'is'} missing, and something else that no "
        "effect of the list explains."
    )


def box_line(d: DiagnosisResult) -> str:
    """Return the sentence of the page's box; the effects that it shows follow it."""
    many = len(d.effects) > 1
    laws = f", with other laws than were chosen: {joined(d.changed)}" if d.changed else ""
    probabilities = [percent_unbroken(d.probability_of(name)) for name in d.effects]
    sure = f" (probability {probabilities[0]})" if len(probabilities) == 1 else ""
    return {
        Verdict.ADEQUATE: f"Nothing is missing that these tests can show{laws}.",
        Verdict.MISSING_EFFECT: f"The plain model lacks {'these effects' if many else 'one effect'}"
        f"{sure}:",
        Verdict.AMBIGUOUS: f"Something is missing{_besides(d)}, and these tests cannot tell which "
        "of these it is:",
        Verdict.PARTLY_EXPLAINED: "The plain model lacks "
        f"{'these effects' if many else 'this effect'}{sure}, and something that none of the known "
        "effects explains:",
        Verdict.UNEXPLAINED: "Something is missing that none of the known effects explains."
        f"{_law(d)}",
    }[d.verdict]


def answer(d: DiagnosisResult, seen: Callable[[str], str]) -> str:
    """Return the answer to the question which effect is missing."""
    if d.verdict == Verdict.ADEQUATE:
        return "nothing that these tests can show."
    if d.verdict == Verdict.UNEXPLAINED:
        return f"something that none of the known effects explains.{_law(d)}"
    if d.verdict == Verdict.AMBIGUOUS:
        return f"one of {joined(list(d.group), 'or')}{_besides(d)}; these tests cannot tell which."
    rest = ", and something that none of them explains" * d.verdict.has_unmodelled
    named = [f"{name} ({what})" if (what := seen(name)) else name for name in d.effects]
    return f"{joined(named)}{rest}.{_law(d)}"


def _law(d: DiagnosisResult) -> str:
    """Return a sentence on the law that describes what is left; empty where there is none."""
    law, unit = d.description, d.units.force
    if law is None:
        return ""
    before, after = plain(law.heldout_before, 2), plain(law.heldout_after, 2)
    return (
        f" It is described, and not explained, by {law.formula}: the error on {parts(d)} left out "
        f"falls from {before} to {after} {unit}."
    )


def heading(d: DiagnosisResult) -> str:
    """Return the verdict as the heading of a figure has it."""
    laws = f", {_by(d.changed)}" if d.changed else ""
    if d.verdict == Verdict.ADEQUATE:
        return f"nothing missing that these tests show{laws}"
    if d.verdict == Verdict.UNEXPLAINED:
        return (
            f"unexplained, also {model_name(d.tried)}" if d.tried else "unexplained by any effect"
        )
    if d.verdict == Verdict.AMBIGUOUS:
        certain = [name for name in d.effects if name not in d.group]
        return "missing " + " + ".join([*certain, f"one of {', '.join(d.group)}"])
    rest = ", and something unlisted" if d.verdict == Verdict.PARTLY_EXPLAINED else ""
    return f"missing {' + '.join(d.effects)}{rest}{laws}"


def terminal_line(d: DiagnosisResult) -> str:
    """Return the line of one pad of many: its verdict with the effects that it shows."""
    named = ", ".join(shown_effects(d))
    return f"{pad_title(d.pad)}: {d.verdict.replace('_', ' ')}{': ' + named if named else ''}"


def _besides(d: DiagnosisResult) -> str:
    """Return what an ambiguous verdict is sure of; the last effect stands for the group."""
    sure = list(d.effects[:-1])
    return f" besides {joined(sure)}" if sure else ""


def _by(laws: Sequence[str]) -> str:
    return f"by {' and '.join(laws)}"
