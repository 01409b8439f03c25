"""The first paragraphs of the verdict in words: what to do next, and what the verdict rests on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from qlvbayes.diagnosis.phrases import LIKELY, parts, varying
from qlvbayes.diagnosis.result import Description, DiagnosisResult, Verdict
from qlvbayes.diagnosis.search import Search
from qlvbayes.io.files import DESCRIBED
from qlvbayes.io.wording import as_typed, joined, percent, plain, to_noise
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.phases import NAMES

_MOST_CELLS = 4  # phases that are listed by name
_NOTABLE = 0.02  # share of the error below which it is not said what a kind of terms could remove


@dataclass(frozen=True)
class Typed:
    """Paths in commands, as they are typed: the tests, the folder of results, the described law."""

    file: str = "FILE"
    out: str = "OUT"
    law: str = DESCRIBED

    @property
    def design(self) -> str:
        """The command that proposes a test which tells causes apart."""
        return as_typed("qlvbayes", "design", self.out, "--for", "cause")


PLACEHOLDERS = Typed()
"""What commands hold where no paths are known."""


class Work(Protocol):
    """A finished diagnosis, of which the words use more than its result."""

    @property
    def experiment(self) -> Experiment:
        """The tests."""

    @property
    def search(self) -> Search:
        """The search, with the laws and effects that it knows."""

    @property
    def typed(self) -> Typed:
        """Paths in commands."""


def next_step(d: DiagnosisResult, work: Work) -> str:
    """Return the step that follows from the verdict."""
    if d.verdict == Verdict.ADEQUATE and d.probability_of("none") < LIKELY:
        return f"another test, as {work.typed.design} proposes, would show more."
    if d.verdict == Verdict.ADEQUATE and not d.changed:
        return "use the constants; no effect has to be added."
    if d.verdict in (Verdict.ADEQUATE, Verdict.MISSING_EFFECT):
        with_it = " with it" if len(d.effects) == 1 else " with them" if d.effects else ""
        return (
            f"use the constants of a fit to all tests{with_it}. qlvbayes study makes this fit; "
            f"after qlvbayes diagnose type {fit_command(d, work)}"
        )
    if d.verdict == Verdict.AMBIGUOUS:
        if not d.suggestions:
            return f"a test that distinguishes them: {work.typed.design} proposes one."
        best = d.suggestions[0]
        return (
            f"this test would distinguish them: {best.test} (expected 2 ln Bayes factor "
            f"{best.evidence:.0f}; 10 is very strong evidence)."
        )
    if _is_free_elasticity(d, work):
        return (
            "take --elastic spline, or a law of your own (--laws-file), as no listed elastic law "
            "fits these tests."
        )
    worst, law = d.stages[-1].worst, ""
    if d.description is not None:
        command = fit_command(d, work, d.description)
        law = f" To predict all the same, add the described law: {command}"
    return (
        f"look at the {NAMES[worst.phase]} of {worst.test} in the figure forces_before_after. "
        "Its cause may be the rig, the record, or an effect that is not on the list "
        f"(--effects-file). Until it is known, the constants are those of a wrong model.{law}"
    )


def fit_command(d: DiagnosisResult, work: Work, law: Description | None = None) -> str:
    """Return the command that fits the selected hypothesis, or one with a law, to all tests."""
    default, base, typed = Choices(), law.base if law else d.base, work.typed
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


def grounds(d: DiagnosisResult, work: Work) -> str:
    """Return what the verdict rests on: constants, errors, and what is left."""
    named = f"Constants: {joined([_with_value(d, effect) for effect in d.effects])}. "
    if d.verdict == Verdict.ADEQUATE:
        hidden = {"none", *(unseen.effect for unseen in d.not_identifiable)}
        best = next((one for one in d.ranking if one.effect not in hidden), None)
        likeliest = best and (
            f" Of the effects that these tests could show, {best.effect} is the likeliest "
            f"({percent(best.inclusion)})."
        )
        return (
            f"The model leaves an error of {force_words(d, d.stages[-1].rmse)}; the noise floor is "
            f"{_noise(d)}{_left(d, work, '; ')}{likeliest or ''}"
        )
    if d.verdict == Verdict.MISSING_EFFECT:
        return f"{named}{_change(d)}{_left(d, work, ', and ')}"
    if d.verdict == Verdict.AMBIGUOUS:
        constants = [f"{name} = {e}" for name, e in d.constants.items()]
        return (
            f"{_change(d, 'With the first')}.{'' if _is_sound(d, work) else f' {_small(d, work)}'} "
            f"Averaged over all that the tests do not rule out, {joined(constants)}."
        )
    if d.verdict == Verdict.PARTLY_EXPLAINED:
        share, taken = d.remainder.share_of_error if d.remainder else None, ""
        if share is not None and share < 1.0:
            they = "It takes" if len(d.effects) == 1 else "They take"
            taken = f" {they} {_share(1.0 - share)} of the error."
        return f"{named}{_change(d)}.{taken} {_structure(d, work)}"
    offered = [name for name in d.tried if name not in work.search.families.unmodelled]
    tried = f" The best that the list offers, {joined(offered)}, is not enough." if offered else ""
    return f"No effect is named.{tried} {_structure(d, work)}"


def _is_sound(d: DiagnosisResult, work: Work) -> bool:
    """Return whether the selected hypothesis passes the adequacy test."""
    return d.stages[-1].p_value >= work.search.settings.false_alarms


def _is_free_elasticity(d: DiagnosisResult, work: Work) -> bool:
    """Return whether only a free curve of stiffness over depth leaves nothing but noise."""
    return d.base.elastic not in work.search.nameable_laws and _is_sound(d, work)


def _change(d: DiagnosisResult, with_it: str = "With it") -> str:
    """Return what the laws and effects do to the error on tests left out."""
    with_it = "With them" if with_it == "With it" and len(d.effects) > 1 else with_it
    before, after = d.stages[0], d.stages[-1]
    what, first, last = f"error on {parts(d)} left out", before.heldout_rmse, after.heldout_rmse
    verb, noise = "falls", f"noise floor {_noise(d)}"
    if first is None or last is None:
        what, first, last = "fitted error", before.rmse, after.rmse
        verb, noise = "goes", f"{noise}; there is no other test to predict"
    verb = verb if last < first else "goes"
    errors = f"from {force_words(d, first)} to {force_words(d, last)}"
    return f"{with_it} the {what} {verb} {errors} ({noise})"


def _structure(d: DiagnosisResult, work: Work) -> str:
    """Return where a systematic error is left, and how large it is."""
    last = d.stages[-1]
    if _is_free_elasticity(d, work):
        return (
            "The elasticity is that of no law of the list. With a free curve of stiffness over "
            f"depth ({d.base.elastic}) nothing is left but noise ({_p(last.p_value)})."
        )
    cells = [f"the {NAMES[at.phase]} of {at.test}" for at in last.failing]
    if (more := len(cells) - _MOST_CELLS) > 0:
        cells = [*cells[:_MOST_CELLS], f"{more} more"]
    where = f", in {joined(cells)}" if cells else ""
    amounts = d.remainder is not None and d.remainder.rms > 0.0
    size = f" Without the noise it amounts to {_measure(d, work)}." if amounts else ""
    return (
        f"A systematic error remains beyond the noise floor of {_noise(d)} "
        f"({_p(last.p_value)}){where}. It is largest in {worst_words(d, -1)}{size}"
    )


def worst_words(d: DiagnosisResult, stage: int, rate: str = "") -> str:
    """Return where the model of one step has its largest error, and how large it is."""
    worst = d.stages[stage].worst
    rms, bias = force_words(d, worst.rmse), force_words(d, abs(worst.bias))
    side = "above" if worst.bias > 0.0 else "below"
    return (
        f"the {NAMES[worst.phase]} of {worst.test}{rate}: {rms} root mean square, where the "
        f"measured force lies {bias} {side} the model on average."
    )


def _left(d: DiagnosisResult, work: Work, joint: str) -> str:
    """Return the end of a sentence: what the selected model leaves is noise, or how large it is."""
    last = d.stages[-1]
    if _is_sound(d, work):
        return f"{joint}no phase of any test holds a systematic error ({_p(last.p_value)})."
    if not last.testable and not (d.remainder and d.remainder.small):
        return (
            f". What is left is largest, {_measure(d, work)}; it may be correlated noise, which no "
            "hold of these tests shows, so that this cannot be tested."
        )
    return f". {_small(d, work)}"


def _small(d: DiagnosisResult, work: Work) -> str:
    """Return a sentence on a systematic error that is certain but does not matter."""
    p = _p(d.stages[-1].p_value)
    if d.remainder is not None and d.remainder.excess == d.remainder.rms == 0.0:
        return f"A systematic error is certain but too small to be measured ({p})."
    return (
        f"A systematic error is left that is certain but small: {_measure(d, work)} ({p}). "
        f"The tolerance is {_share(d.tolerance or 0.0)} of the peak force."
    )


def _measure(d: DiagnosisResult, work: Work) -> str:
    """Return the size of the systematic error in the cell where it is largest."""
    rest, unit = d.remainder, d.units.force
    if rest is None:
        return ""
    if rest.rms > 0.0:
        return (
            f"{_share(rest.share_of_peak)} of the peak force ({plain(rest.rms, 2)} {unit}, "
            f"{plain(rest.upper95, 2)} {unit} at most) in the {NAMES[rest.phase]} of {rest.test}"
        )
    share = _share(rest.excess / work.experiment.scales.force)
    return f"{share} of the peak force ({plain(rest.excess, 2)} {unit}) over all tests"


def law_words(d: DiagnosisResult) -> list[str]:
    """Return what the described law removes and which effects are like it, or what no law could."""
    law, unit = d.description, d.units.force
    if law is None:
        notable = [one for one in d.could_remove if one.share >= _NOTABLE]
        shares = joined([f"{one.family} {100.0 * one.share:.0f} %" for one in notable])
        return [
            f"No law of one or two terms was found that predicts {parts(d)} left out better. Of "
            f"the fit's error the best single terms could remove at most: {shares}."
        ] * bool(notable)
    before, after = (f"{to_noise(x, d.noise)}" for x in (law.heldout_before, law.heldout_after))
    count = len(law.parameters)
    constants = joined([f"{name} = {one}" for name, one in law.parameters.items()])
    lead = "No listed effect can be named for these tests: what they show"
    if law.effects:
        lead = f"What is left beside {joined(list(law.effects))}"
    differs = ""
    if law.strengths is not None and law.strengths.spread > 0.0:
        low, high = law.strengths.range
        differs = (
            f" {varying(d)} its strength is {plain(low, 2)} to {plain(high, 2)} times its mean."
        )
    closest = [
        f"{one.effect} (cosine of the forces {one.cosine:.2f}, they differ most in "
        f"{one.differs_most_in}; with it instead the error on {parts(d)} left out is "
        f"{force_words(d, one.heldout)})"
        for one in law.closest
    ]
    return [
        f"{lead} is described by {law.formula}, with {constants} ({count} "
        f"constant{'s' if count > 1 else ''}). By least squares the error on {parts(d)} left out "
        f"falls from {before} to {after} {unit}.{differs} This law describes the tests and does "
        "not name a cause.",
        *[f"The closest listed effects: {joined(closest)}."] * bool(closest),
    ]


def _with_value(d: DiagnosisResult, effect: str) -> str:
    """Return an effect with the values of its constants."""
    form = d.forms.get(effect, effect)
    own = {n: e for n, e in d.stages[-1].parameters.items() if n.startswith(f"{form}.")}
    values = ", ".join(f"{name.partition('.')[2]} = {e}" for name, e in own.items())
    name = effect if form == effect else f"{effect} by the law of {form}"
    return f"{name} ({values})" if values else name


def _share(value: float) -> str:
    return f"{plain(100.0 * value, 2)} %"


def _p(value: float) -> str:
    return f"p = {value:.2g}" if value > 1e-12 else "p below 1e-12"


def _noise(d: DiagnosisResult) -> str:
    return f"{plain(d.noise)} {d.units.force}"


def force_words(d: DiagnosisResult, value: float) -> str:
    """Return a force with the digits that the noise allows."""
    return f"{to_noise(value, d.noise)} {d.units.force}"
