"""The verdict in plain language: what to do next, where, what, how sure, and why not another."""

from __future__ import annotations

from qlvbayes.diagnosis.certainty import calibration
from qlvbayes.diagnosis.result import DiagnosisResult, ParameterBias
from qlvbayes.diagnosis.telling.work import Work
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import joined, percent, plain, to_noise
from qlvbayes.model.choices import Choices
from qlvbayes.motion.phases import NAMES
from qlvbayes.motion.pulling import pull_notices

_MOST_BIASES = 3
_LINEAR = 0.5  # relative change up to which slopes tell how far a constant moves
_MOST_CELLS = 4
_HANDFUL = 10  # block means: what half of the evidence rests on, below which it is said
_SURE = 0.95  # probability of a base law, from which it goes unsaid
_LIKELY = 0.5  # probability of nothing, from which the text says so without ifs
_LITTLE = 0.01  # probability of all explanations that are not listed, up to which they go unsaid


def paragraphs(d: DiagnosisResult, work: Work) -> list[str]:
    """A few short paragraphs: the verdict in a line, what to do next, and what that rests on."""
    grounds = {
        "adequate": _of_adequate,
        "missing_effect": _of_missing,
        "ambiguous": _of_ambiguous,
        "partly_explained": _of_partly,
        "unexplained": _of_unexplained,
    }[d.verdict]
    pulls = pull_notices(work.experiment, bonded=work.search.density.space.bonded)
    text = [
        f"Pad {d.pad}: {_verdict(d, work)}",
        f"What to do next: {_first(d, pulls)}{_next(d, work)}",
        *(f"{_upper(_own(d, one))}." for one in d.notices if one not in pulls),
        grounds(d, work),
        *_certain(d),
    ]
    if d.verdict != "adequate":
        text += [_where(d), *_runner_up(d)]
    return [
        *text,
        *_base(d),
        *_few_readings(d),
        *_not_ruled_out(d),
        *_refused(d),
        *_honest(d),
        *_unseen(d),
        *_bent(d, work),
    ]


def _verdict(d: DiagnosisResult, work: Work) -> str:
    """In one line."""
    if d.verdict == "adequate":
        none = percent(d.probability_of("none"))
        if d.probability_of("none") < _LIKELY:
            return (
                "nothing is named, although something may be missing (probability that nothing "
                f"is: {none})."
            )
        return f"nothing is missing that these tests can show (probability {none})."
    if d.verdict == "ambiguous":
        besides = f" besides {joined(list(d.effects[:-1]))}" if d.effects[:-1] else ""
        return (
            f"something is missing{besides}, and these tests cannot tell which of "
            f"{joined(_with_probability(d, d.group), 'or')} it is."
        )
    if d.verdict == "unexplained":
        return "unexplained: something is missing that no effect of the list explains."
    named = joined([_seen(d, work, effect) for effect in d.effects])
    many = len(d.effects) > 1
    if d.verdict == "missing_effect":
        return f"missing effect{'s' * many}: {named}."
    return (
        f"partly explained: {named} {'are' if many else 'is'} missing, and something else that no "
        "effect of the list explains."
    )


def _seen(d: DiagnosisResult, work: Work, effect: str) -> str:
    """An effect, what one sees of it, and how sure it is."""
    kind = work.search.density.space.effects[d.forms.get(effect, effect)]
    return f"{effect} ({kind.seen}; probability {percent(d.probability_of(effect))})"


def _first(d: DiagnosisResult, pulls: tuple[str, ...]) -> str:
    """What comes before the step that the verdict asks for: a loose pad that pulls is none."""
    if not pulls or "adhesion" in (*d.stages[0].effects, *d.effects):
        return ""
    return f"say first how the specimen is held, for {_own(d, pulls[0])}. Then "


def _own(d: DiagnosisResult, notice: str) -> str:
    """A notice without the pad's name, which the first line has."""
    return notice.removeprefix(f"pad {d.pad}: ")


def _next(d: DiagnosisResult, work: Work) -> str:
    """The step that follows from the verdict."""
    if d.verdict == "adequate" and d.probability_of("none") < _LIKELY:
        return "another test, as qlvbayes design OUT --for cause proposes, would tell more."
    if d.verdict == "adequate" and not d.changed:
        return "use the constants; no effect has to be added."
    if d.verdict in ("adequate", "missing_effect"):
        with_it = " with it" if len(d.effects) == 1 else " with them" if d.effects else ""
        return (
            f"use the constants of a fit to all tests{with_it}. qlvbayes study makes this fit; "
            f"after qlvbayes diagnose type {_command(d)}"
        )
    if d.verdict == "ambiguous":
        if not d.suggestions:
            return "a test that tells them apart: qlvbayes design OUT --for cause proposes one."
        best = d.suggestions[0]
        return (
            f"this test would tell them apart: {best.test} (expected 2 ln Bayes factor "
            f"{best.evidence:.0f}; 10 is very strong evidence)."
        )
    if _is_free_elasticity(d, work):
        return (
            "take --elastic spline, or a law of your own (--laws-file), as no listed elastic law "
            "fits these tests."
        )
    worst = d.stages[-1].worst
    return (
        f"look at the {NAMES[worst.phase]} of {worst.test} in the figure forces_before_after. "
        "Its cause may be the rig, the record, or an effect that is not on the list "
        "(--effects-file). Until it is known, the constants are those of a wrong model."
    )


def _command(d: DiagnosisResult) -> str:
    """That fits the hypothesis told to all tests."""
    usual, base = Choices(), d.base
    words = ["qlvbayes fit FILE -o OUT --all-tests"]
    words += [f"--elastic {base.elastic}"] * (base.elastic != usual.law)
    words += [f"--relaxation {base.relaxation}"] * (base.relaxation != usual.relaxing)
    added = (*d.stages[0].effects, *(d.forms.get(name, name) for name in d.effects))
    return " ".join([*words, *(f"--add {name}" for name in added)])


def _of_adequate(d: DiagnosisResult, work: Work) -> str:
    hidden = {unseen.effect for unseen in d.not_identifiable}
    best = next((r for r in d.ranking if r.effect not in {"none", *hidden}), None)
    text = (
        f"The model leaves an error of {_error(d, d.stages[-1].rmse)}; the noise floor is "
        f"{_noise(d)}{_left(d, work, '; ')}"
    )
    if best is not None:
        text += (
            f" Of the effects that these tests could show, {best.effect} is the likeliest "
            f"({percent(best.inclusion)})."
        )
    return text


def _certain(d: DiagnosisResult) -> list[str]:
    """How often names with such evidence were right in blind studies."""
    known = {one.effect: one.certainty for one in d.ranking}
    names = [name for name in dict.fromkeys((*d.effects, *d.group)) if name in known]
    rated = [(name, one) for name in names if (one := known[name]) is not None]
    text, learnt = [], calibration()
    if rated:
        said = joined([f"{name} {percent(one)}" for name, one in rated])
        bins = sorted({learnt.bin_of(one) for _, one in rated}, reverse=True)
        counts = [
            f"{100.0 * low:.0f} to {100.0 * high:.0f} % were there in {k} of {n} cases"
            for low, high, n, k in bins
        ]
        text.append(
            f"Certainty by experience: {said}. In {learnt.studies} blind studies on other rigs, "
            f"effects with a certainty of {joined(counts, 'and with')}."
        )
    if new := [name for name in names if known[name] is None]:
        text.append(
            f"No blind study had evidence like that for {joined(new)}: the probability is that of "
            "the compared hypotheses alone."
        )
    return text


def _of_missing(d: DiagnosisResult, work: Work) -> str:
    return f"Constants: {_named(d)}. {_change(d)}{_left(d, work, ', and ')}"


def _named(d: DiagnosisResult) -> str:
    """Effects with their values."""
    return joined([_with_value(d, effect) for effect in d.effects])


def _of_ambiguous(d: DiagnosisResult, work: Work) -> str:
    constants = [f"{name} = {e}" for name, e in d.constants.items()]
    return (
        f"{_change(d, 'With the first')}.{'' if _is_sound(d, work) else f' {_small(d, work)}'} "
        f"Averaged over all that the tests do not rule out, {joined(constants)}."
    )


def _of_partly(d: DiagnosisResult, work: Work) -> str:
    """Some of it has a name."""
    share = d.remainder.share_of_error if d.remainder else None
    taken = f" They take {_share(1.0 - share)} of the error." if share is not None else ""
    taken = taken.replace("They take", "It takes") if len(d.effects) == 1 else taken
    return f"Constants: {_named(d)}. {_change(d)}.{taken} {_structure(d, work)}"


def _of_unexplained(d: DiagnosisResult, work: Work) -> str:
    listed = [name for name in d.tried if name not in work.search.families.outside]
    tried = f" The best that the list offers, {joined(listed)}, is not enough." if listed else ""
    return f"No effect is named.{tried} {_structure(d, work)}"


def _is_free_elasticity(d: DiagnosisResult, work: Work) -> bool:
    """Whether a free curve of stiffness over depth, and no listed law, leaves noise alone."""
    return d.base.elastic not in work.search.listed and _is_sound(d, work)


def _structure(d: DiagnosisResult, work: Work) -> str:
    """Where a systematic error is left, and how large it is."""
    last = d.stages[-1]
    if _is_free_elasticity(d, work):
        return (
            "The elasticity is that of no law of the list. With a free curve of stiffness over "
            f"depth ({d.base.elastic}) nothing is left but noise ({_p(last.p_value)})."
        )
    worst = last.worst
    cells = list(dict.fromkeys(f"the {NAMES[at.phase]} of {at.test}" for at in last.failing))
    if (more := len(cells) - _MOST_CELLS) > 0:
        cells = [*cells[:_MOST_CELLS], f"{more} more"]
    where = f", in {joined(cells)}" if cells else ""
    return (
        f"A systematic error remains beyond the noise floor of {_noise(d)} "
        f"({_p(last.p_value)}){where}. It is largest in the {NAMES[worst.phase]} of {worst.test}: "
        f"{_error(d, worst.rmse)} root mean square, where the measured force lies "
        f"{_offset(d, worst.bias)} the model on average.{_size(d, work)}"
    )


def _base(d: DiagnosisResult) -> list[str]:
    """Which laws the tests ask for, where they are not the ones chosen or not sure."""
    chosen = d.stages[0].base
    others = [base for base in d.bases if base.pair != d.base.pair]
    if d.base.pair == chosen.pair and d.base.probability >= _SURE:
        return []
    said = f"The likeliest laws are {d.base} ({percent(d.base.probability)})"
    if d.base.pair != chosen.pair:
        said += f" instead of {chosen}"
    rest = [f"{base} ({percent(base.probability)})" for base in others[:2]]
    return [f"{said}; next come {joined(rest)}." if rest else f"{said}."]


def _with_probability(d: DiagnosisResult, names: tuple[str, ...]) -> list[str]:
    return [f"{name} ({percent(d.probability_of(name))})" for name in names]


def _change(d: DiagnosisResult, with_it: str = "With it") -> str:
    """What laws and effects do to the error on tests left out."""
    with_it = "With them" if with_it == "With it" and len(d.effects) > 1 else with_it
    first, last = d.stages[0].heldout_rmse, d.stages[-1].heldout_rmse
    if first is None or last is None:
        first, last = d.stages[0].rmse, d.stages[-1].rmse
        return (
            f"{with_it} the fitted error goes from {_error(d, first)} to {_error(d, last)} (noise "
            f"floor {_noise(d)}; there is no other test to predict)"
        )
    verb = "falls" if last < first else "goes"
    return (
        f"{with_it} the error on tests left out {verb} from {_error(d, first)} to "
        f"{_error(d, last)} (noise floor {_noise(d)})"
    )


def _left(d: DiagnosisResult, work: Work, joint: str) -> str:
    """The end of a sentence on the last model: noise alone, or little, with its size and place."""
    last = d.stages[-1]
    if _is_sound(d, work):
        return f"{joint}no phase of any test is off by more than noise ({_p(last.p_value)})."
    if not last.testable and not (d.remainder and d.remainder.small):
        return (
            f". What is left is largest, {_measure(d, work)}; it may be correlated noise, which no "
            "hold of these tests shows, so that this cannot be tested."
        )
    return f". {_small(d, work)}"


def _small(d: DiagnosisResult, work: Work) -> str:
    """A systematic error that is certain but does not matter."""
    p = _p(d.stages[-1].p_value)
    if d.remainder is not None and d.remainder.excess == d.remainder.rms == 0.0:
        return f"A systematic error is certain but too small to be measured ({p})."
    return (
        f"A systematic error is left that is certain but small: {_measure(d, work)} ({p}). "
        f"The tolerance is {_share(d.tolerance or 0.0)} of the peak force."
    )


def _size(d: DiagnosisResult, work: Work) -> str:
    """How large an error that matters is."""
    if d.remainder is None or d.remainder.rms == 0.0:
        return ""
    return f" Without the noise it amounts to {_measure(d, work)}."


def _measure(d: DiagnosisResult, work: Work) -> str:
    """The systematic part where it is largest, else what all samples hold beyond the noise."""
    left, unit = d.remainder, d.units.force
    if left is None:
        return ""
    if left.rms > 0.0:
        place, most = f"in the {NAMES[left.phase]} of {left.test}", f", {left.upper95:.2g} {unit}"
        return (
            f"{_share(left.share_of_peak)} of the peak force ({left.rms:.2g} {unit}{most} at most) "
            f"{place}"
        )
    share = _share(left.excess / work.experiment.scales.force)
    return f"{share} of the peak force ({left.excess:.2g} {unit}) over all tests"


def _is_sound(d: DiagnosisResult, work: Work) -> bool:
    """Whether the hypothesis told passes the adequacy test."""
    return d.stages[-1].p_value >= work.search.settings.false_alarms


def _share(value: float) -> str:
    return f"{100.0 * value:.2g} %"


def _p(value: float) -> str:
    return f"p = {value:.2g}" if value > 1e-12 else "p below 1e-12"


def _noise(d: DiagnosisResult) -> str:
    return f"{plain(d.noise)} {d.units.force}"


def _error(d: DiagnosisResult, value: float) -> str:
    """With the digits that the noise allows."""
    return f"{to_noise(value, d.noise)} {d.units.force}"


def _offset(d: DiagnosisResult, bias: float) -> str:
    return f"{_error(d, abs(bias))} {'above' if bias > 0.0 else 'below'}"


def _where(d: DiagnosisResult) -> str:
    worst = d.stages[0].worst
    return (
        f"The plain model fails worst in the {NAMES[worst.phase]} of {worst.test} "
        f"({_rate(worst.rate, d.units)}): {_error(d, worst.rmse)} root mean square, where the "
        f"measured force lies {_offset(d, worst.bias)} the model on average."
    )


def _rate(rate: float | None, units: UnitSystem) -> str:
    return "no rate" if rate is None else f"{plain(rate)} {units.speed}"


def _few_readings(d: DiagnosisResult) -> list[str]:
    """Names that rest on a handful of readings."""
    few = [
        (one.effect, one.half)
        for one in d.ranking
        if one.effect in {*d.tried, *d.group} and one.half and one.half.blocks < _HANDFUL
    ]
    return [
        f"Half of the evidence for {effect} lies in {half.blocks} of {half.of} averages of "
        f"neighbouring readings, the most of it in the {NAMES[half.phase]} of {half.test} at "
        f"{half.time:.4g} s: look at these readings before you believe the name."
        for effect, half in few
    ]


def _runner_up(d: DiagnosisResult) -> list[str]:
    """The likeliest effect that is not named, of those that the tests could show."""
    taken = {*d.tried, *d.group, "none", *(one.effect for one in d.not_identifiable)}
    rival = next((r for r in d.ranking if r.effect not in taken), None)
    if rival is None:
        return []
    without, with_it = (_error(d, rmse) for rmse in (d.stages[-1].rmse, rival.rmse))
    same = f"leave the error at {without}"
    change = same if without == with_it else f"change the error from {without} to {with_it}"
    return [
        f"Of the effects that are not named, but that these tests can show, {rival.effect} is the "
        f"likeliest ({percent(rival.inclusion)}); to add it would {change}."
    ]


def _refused(d: DiagnosisResult) -> list[str]:
    """Effects that are likely by the fit alone."""
    return [f"{one.effect} is likely by the fit, but not named: {one.reason}." for one in d.refused]


def _upper(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}"


def _not_ruled_out(d: DiagnosisResult) -> list[str]:
    """Explanations besides the verdict's own."""
    own = [{*d.effects[:-1], name} for name in d.group] if len(d.group) > 1 else [set(d.effects)]
    others = [one for one in d.not_ruled_out if set(one.effects) not in own]
    if not others or d.verdict in ("adequate", "unexplained"):
        return []
    said = [
        f"{joined(list(o.effects), 'with') or 'nothing'} ({percent(o.probability)})" for o in others
    ]
    rest = 1.0 - sum(one.probability for one in d.not_ruled_out)
    if rest > _LITTLE:
        said.append(f"others ({percent(rest)} together)")
    return [
        f"The tests do not rule out other explanations: {joined(said)}. The constants in "
        "diagnosis.json are averaged over all of these."
    ]


def _honest(d: DiagnosisResult) -> list[str]:
    if d.verdict not in ("partly_explained", "unexplained") or d.discrepancy == 0.0:
        return []
    return [
        "What is left was described by a smooth function of time, depth and speed (discrepancy.csv)"
        f", of typically {plain(d.discrepancy, 2)} {d.units.force}. It widens the predictions and "
        "explains nothing."
    ]


def _unseen(d: DiagnosisResult) -> list[str]:
    """By reason, in one sentence each."""
    reasons: dict[str, list[str]] = {}
    for entry in d.not_identifiable:
        if entry.effect not in d.tried:
            reasons.setdefault(entry.reason.partition(" (")[0], []).append(entry.effect)
    if not reasons:
        return []
    said = "; ".join(f"{joined(effects)} ({reason})" for reason, effects in reasons.items())
    return [f"These tests cannot show {said}."]


def _bent(d: DiagnosisResult, work: Work) -> list[str]:
    """Effects that would hide in the constants, the invisible ones first."""
    hidden = [bias for bias in d.biases if not bias.visible and bias.effect not in d.tried]
    return [_bias(bias, _unit(bias.amplitude, d, work)) for bias in hidden[:_MOST_BIASES]]


def _unit(name: str, d: DiagnosisResult, work: Work) -> str:
    """Of an effect's constant; empty for a pure number."""
    effect, _, constant = name.partition(".")
    unit = d.units.of(work.search.density.space.effects[effect].units[constant.partition("[")[0]])
    return "" if unit == "1" else f" {unit}"


def _bias(bias: ParameterBias, unit: str) -> str:
    (first, change), *others = sorted(bias.changes.items(), key=lambda item: -abs(item[1]))[:2]
    said = joined([f"{first} would be {_off(change)}", *(f"{n} {_off(x)}" for n, x in others)])
    constant = bias.amplitude.partition(".")[2]
    return (
        f"If {bias.effect} were there ({constant} = {bias.size:.2g}{unit}), {said}, and these "
        "tests would not show it."
    )


def _off(change: float) -> str:
    """A relative change in words."""
    by = "more than half" if abs(change) > _LINEAR else f"{100.0 * abs(change):.0f} %"
    return f"{by} too {'high' if change > 0.0 else 'low'}"


def _with_value(d: DiagnosisResult, effect: str) -> str:
    form = d.forms.get(effect, effect)
    own = {n: e for n, e in d.stages[-1].parameters.items() if n.startswith(f"{form}.")}
    values = ", ".join(f"{name.partition('.')[2]} = {e}" for name, e in own.items())
    said = effect if form == effect else f"{effect} by the law of {form}"
    return f"{said} ({values})" if values else said
