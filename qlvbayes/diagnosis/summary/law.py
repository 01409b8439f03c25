"""The described law in words: what it removes, how it is added, and what it is not."""

from __future__ import annotations

from qlvbayes.diagnosis.phrases import parts, varying
from qlvbayes.diagnosis.result import Description, DiagnosisResult
from qlvbayes.diagnosis.summary.work import DiagnosisWork
from qlvbayes.io.wording import as_typed, joined, plain, to_noise
from qlvbayes.model.choices import Choices

_NOTABLE = 0.02  # share of the error below which it is not said what a kind of terms could remove


def law_step(d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return how the described law is added, as what to do next; empty where there is none."""
    if d.description is None:
        return ""
    command = fit_command(d, work, d.description)
    return f" To predict all the same, add the described law: {command}"


def law_paragraphs(d: DiagnosisResult) -> list[str]:
    """Return what the described law removes, or what no law could."""
    if d.description is not None:
        return [_found(d, d.description), *_closest(d, d.description)]
    notable = [one for one in d.could_remove if one.share >= _NOTABLE]
    if not notable:
        return []
    shares = joined([f"{one.family} {100.0 * one.share:.0f} %" for one in notable])
    return [
        f"No law of one or two terms was found that predicts {parts(d)} left out better. Of the "
        f"fit's error the best single terms could remove at most: {shares}."
    ]


def _found(d: DiagnosisResult, law: Description) -> str:
    unit = d.units.force
    before, after = (f"{to_noise(x, d.noise)}" for x in (law.heldout_before, law.heldout_after))
    others = f" beside {joined(list(law.effects))}" if law.effects else ""
    count = len(law.parameters)
    constants = joined([f"{name} = {one}" for name, one in law.parameters.items()])
    nothing = "No listed effect can be named for these tests: what they show"
    lead = "What is left" if law.effects else nothing
    differs = ""
    if law.strengths is not None and law.strengths.spread > 0.0:
        low, high = law.strengths.range
        differs = (
            f" {varying(d)} its strength is {plain(low, 2)} to {plain(high, 2)} times its mean."
        )
    return (
        f"{lead}{others} is described by {law.formula}, with {constants} ({count} "
        f"constant{'s' if count > 1 else ''}). By least squares the error on {parts(d)} left out "
        f"falls from {before} to {after} {unit}.{differs} This law describes the tests and does "
        "not name a cause."
    )


def _closest(d: DiagnosisResult, law: Description) -> list[str]:
    if not law.closest:
        return []
    some = [
        f"{one.effect} (cosine of the forces {one.cosine:.2f}, they differ most in "
        f"{one.differs_most_in}; with it instead the error on {parts(d)} left out is "
        f"{to_noise(one.heldout, d.noise)} {d.units.force})"
        for one in law.closest
    ]
    return [f"The closest listed effects: {joined(some)}."]


def fit_command(d: DiagnosisResult, work: DiagnosisWork, law: Description | None = None) -> str:
    """Return the command that fits the selected hypothesis, or one with a law, to all tests."""
    default, base = Choices(), law.base if law else d.base
    typed = work.typed
    words = [as_typed("qlvbayes", "fit", typed.file, "-o", typed.out, "--all-tests")]
    bonded = work.search.density.space.bonded
    words += ["--bonded" if bonded else "--loose"] * (bonded != d.units.bonded_default)
    words += [as_typed("--effects-file", typed.law)] * (law is not None)
    words += [f"--elastic {base.elastic}"] * (base.elastic != default.elastic)
    words += [f"--relaxation {base.relaxation}"] * (base.relaxation != default.relaxing)
    added = [*d.stages[0].effects]
    added += [d.forms.get(name, name) for name in (law.effects if law else d.effects)]
    added += [law.effect] if law else []
    return " ".join([*words, *(f"--add {name}" for name in added)])
