"""The verdict in plain language: where, what, how sure, why not another, and what to test next."""

from __future__ import annotations

from qlvbayes.diagnosis.result import DiagnosisResult, ParameterBias
from qlvbayes.diagnosis.telling.work import Work
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import joined, plain
from qlvbayes.preprocess.phases import NAMES

_MOST_BIASES = 3
_LINEAR = 0.5  # relative change up to which slopes tell how far a constant moves
_MOST_CELLS = 4
_HANDFUL = 10  # block means: what half of the evidence rests on, below which it is said
_SURE = 0.95  # probability of a base law, from which it goes unsaid
_LIKELY = 0.5  # probability of nothing, from which the text says so without ifs
_LITTLE = 0.01  # probability of all explanations that are not listed, up to which they go unsaid
_NOTHING = "nothing is missing that these tests can show"
_MAYBE = "nothing is named, although something may be missing"


def paragraphs(d: DiagnosisResult, work: Work) -> list[str]:
    """A few short paragraphs, the verdict first."""
    verdict = {
        "adequate": _adequate,
        "missing_effect": _missing,
        "ambiguous": _ambiguous,
        "partly_explained": _partly,
        "unexplained": _unexplained,
    }[d.verdict]
    text = [verdict(d, work), *_base(d)]
    if d.verdict != "adequate":
        text.insert(1, _where(d))
        text += _runner_up(d)
    text += _few_readings(d)
    text += _not_ruled_out(d)
    text += _refused(d)
    text += _honest(d)
    text += _next_test(d)
    text += _unseen(d)
    text += _bent(d)
    return text + [f"{_upper(one)}." for one in d.notices]


def _adequate(d: DiagnosisResult, work: Work) -> str:
    unit, stage = d.units.force, d.stages[-1]
    none = d.probability_of("none")
    hidden = {unseen.effect for unseen in d.not_identifiable}
    best = next((r for r in d.ranking if r.effect not in {"none", *hidden}), None)
    text = (
        f"Pad {d.pad}: {_NOTHING if none >= _LIKELY else _MAYBE}. The model leaves "
        f"{plain(stage.rmse)} {unit}, the noise floor is {plain(d.noise)} {unit}"
        f"{_left(d, work, 'no phase of any test shows structure', '; ')}"
    )
    if best is not None:
        text += (
            f" Probability that nothing of the list is missing: {_percent(none)}; "
            f"of the effects that they could show, {best.effect} is the likeliest "
            f"({_percent(best.inclusion)})."
        )
    return text


def _missing(d: DiagnosisResult, work: Work) -> str:
    return (
        f"Pad {d.pad}: missing {'effect' if len(d.effects) == 1 else 'effects'}: {_named(d, work)} "
        f"{_sureness(d)} {_change(d)}"
        f"{_left(d, work, 'no phase of any test shows structure any more', ', and ')}"
    )


def _named(d: DiagnosisResult, work: Work) -> str:
    """Effects with their values, and what one sees of them."""
    effects = work.search.density.space.effects
    named = joined([_with_value(d, effect) for effect in d.effects])
    seen = " ".join(f"{_upper(effects[d.forms.get(e, e)].seen)}." for e in d.effects)
    return f"{named}. {seen}"


def _ambiguous(d: DiagnosisResult, work: Work) -> str:
    before, constants = d.effects[:-1], [f"{name} = {e}" for name, e in d.constants.items()]
    besides = f" besides {joined(list(before))}" if before else ""
    return (
        f"Pad {d.pad}: something is missing{besides}, and these tests cannot tell which of "
        f"{joined(_with_probability(d, d.group), 'or')} it is. {_change(d, 'With the first')}."
        f"{'' if _is_sound(d, work) else f' {_small(d, work)}'} "
        f"Averaged over all that the tests do not rule out, {joined(constants)}."
    )


def _partly(d: DiagnosisResult, work: Work) -> str:
    """Some of it has a name."""
    share = d.remainder.share_of_error if d.remainder else None
    taken = f" They take {_share(1.0 - share)} of the error." if share is not None else ""
    taken = taken.replace("They take", "It takes") if len(d.effects) == 1 else taken
    what = "An effect is" if len(d.effects) == 1 else "Effects are"
    return (
        f"Pad {d.pad}: partly explained. {what} missing: {_named(d, work)} {_sureness(d)} "
        f"{_change(d)}.{taken} Something is there too that no effect of the list explains: "
        f"{_structure(d, work)}"
    )


def _unexplained(d: DiagnosisResult, work: Work) -> str:
    listed = [name for name in d.tried if name not in work.search.families.outside]
    tried = f" The best that the list offers, {joined(listed)}, is not enough." if listed else ""
    return (
        f"Pad {d.pad}: unexplained.{tried} {_upper(_structure(d, work))} No effect is named: "
        "take the constants as those of a model that is wrong."
    )


def _structure(d: DiagnosisResult, work: Work) -> str:
    """Where structure is left, and how large it is."""
    unit, last = d.units.force, d.stages[-1]
    if d.base.elastic not in work.search.listed and _is_sound(d, work):
        return (
            f"the elasticity is that of no law of the list. With a free curve of stiffness over "
            f"depth ({d.base.elastic}) nothing is left but noise ({_p(last.p_value)})."
        )
    worst = last.worst
    cells = list(dict.fromkeys(f"{NAMES[at.phase]} of {at.test}" for at in last.failing))
    more = f" and {len(cells) - _MOST_CELLS} more" if len(cells) > _MOST_CELLS else ""
    where = f", in the {joined(cells[:_MOST_CELLS])}{more}" if cells else ""
    sign = "above" if worst.bias > 0.0 else "below"
    return (
        f"structure remains beyond the noise floor of {plain(d.noise)} {unit} "
        f"({_p(last.p_value)}){where}. The largest error left is {plain(worst.rmse)} {unit} in the "
        f"{NAMES[worst.phase]} of {worst.test}, where the measured force lies "
        f"{plain(abs(worst.bias))} {unit} {sign} the model on average.{_size(d, work)}"
    )


def _base(d: DiagnosisResult) -> list[str]:
    """Which laws the tests ask for, where they are not the ones chosen or not sure."""
    chosen = d.stages[0].base
    others = [base for base in d.bases if base.pair != d.base.pair]
    if d.base.pair == chosen.pair and d.base.probability >= _SURE:
        return []
    said = f"Base laws: {d.base} ({_percent(d.base.probability)})"
    if d.base.pair != chosen.pair:
        said += f" in the place of {chosen}"
    rest = [f"{base} ({_percent(base.probability)})" for base in others[:2]]
    return [f"{said}; else {joined(rest, 'or')}." if rest else f"{said}."]


def _with_probability(d: DiagnosisResult, names: tuple[str, ...]) -> list[str]:
    return [f"{name} ({_percent(d.probability_of(name))})" for name in names]


def _change(d: DiagnosisResult, with_it: str = "With it") -> str:
    """What laws and effects do to the error on tests left out."""
    first, last = d.stages[0].heldout_rmse, d.stages[-1].heldout_rmse
    unit = d.units.force
    if first is None or last is None:
        first, last = d.stages[0].rmse, d.stages[-1].rmse
        return (
            f"{with_it} the fitted error goes from {plain(first)} to {plain(last)} {unit} (noise "
            f"floor {plain(d.noise)} {unit}; one test alone leaves none out)"
        )
    verb = "falls" if last < first else "goes"
    return (
        f"{with_it} the error on tests left out {verb} from {plain(first)} to {plain(last)} {unit} "
        f"(noise floor {plain(d.noise)} {unit})"
    )


def _left(d: DiagnosisResult, work: Work, nothing: str, joint: str) -> str:
    """The end of a sentence on the last model: no structure, or little, with its size and place."""
    last = d.stages[-1]
    if _is_sound(d, work):
        return f"{joint}{nothing} ({_p(last.p_value)})."
    if not last.testable and not (d.remainder and d.remainder.small):
        return (
            f". What is left is largest, {_measure(d, work)}; it may be correlated noise, which no "
            "hold of these tests shows: that is not testable."
        )
    return f". {_small(d, work)}"


def _small(d: DiagnosisResult, work: Work) -> str:
    """Structure that is sure but does not matter."""
    p = _p(d.stages[-1].p_value)
    if d.remainder is not None and d.remainder.excess == d.remainder.rms == 0.0:
        return f"There is structure that is sure but too small to be measured ({p})."
    return (
        f"There is structure that is sure but small: {_measure(d, work)} ({p}). "
        f"The tolerance is {_share(d.tolerance or 0.0)} of the peak."
    )


def _size(d: DiagnosisResult, work: Work) -> str:
    """How large structure that matters is."""
    if d.remainder is None or d.remainder.rms == 0.0:
        return ""
    return f" Without the noise, what is left is largest, {_measure(d, work)}."


def _measure(d: DiagnosisResult, work: Work) -> str:
    """The structured part where it is largest, else what all samples hold beyond the noise."""
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


def _where(d: DiagnosisResult) -> str:
    units, worst = d.units, d.stages[0].worst
    sign = "above" if worst.bias > 0.0 else "below"
    return (
        f"Where the plain model fails worst: the {NAMES[worst.phase]} of {worst.test} "
        f"({_rate(worst.rate, units)}), by {plain(worst.rmse)} {units.force} root mean square; the "
        f"measured force lies {plain(abs(worst.bias))} {units.force} {sign} the model on average."
    )


def _rate(rate: float | None, units: UnitSystem) -> str:
    return "no rate" if rate is None else f"{plain(rate)} {units.speed}"


def _sureness(d: DiagnosisResult) -> str:
    """Inclusion probabilities."""
    said = [f"{_percent(d.probability_of(name))}" for name in d.effects]
    return f"Probability that {'it is' if len(said) == 1 else 'each is'} there: {joined(said)}."


def _few_readings(d: DiagnosisResult) -> list[str]:
    """Names that rest on a handful of readings."""
    few = [
        (one.effect, one.half)
        for one in d.ranking
        if one.effect in {*d.tried, *d.group} and one.half and one.half.blocks < _HANDFUL
    ]
    return [
        f"Half of the evidence for {effect} lies in {half.blocks} of {half.of} block means, the "
        f"most of it in the {NAMES[half.phase]} of {half.test} at {half.time:.4g} s: look at these "
        "readings before you believe the name."
        for effect, half in few
    ]


def _runner_up(d: DiagnosisResult) -> list[str]:
    """The likeliest effect that is not named."""
    taken = {*d.tried, *d.group, "none"}
    rival = next((r for r in d.ranking if r.effect not in taken), None)
    if rival is None:
        return []
    return [
        f"Next of the list: {rival.effect}, there with a probability of "
        f"{_percent(rival.inclusion)}; with it the model leaves {plain(rival.rmse)} "
        f"{d.units.force}, without {plain(d.stages[-1].rmse)} {d.units.force}."
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
    said = [f"{joined(list(o.effects)) or 'nothing'} ({_percent(o.probability)})" for o in others]
    rest = 1.0 - sum(one.probability for one in d.not_ruled_out)
    if rest > _LITTLE:
        said.append(f"others ({_percent(rest)} together)")
    return [f"The tests do not rule out {joined(said, 'or')} either; the constants allow for it."]


def _honest(d: DiagnosisResult) -> list[str]:
    if d.verdict not in ("partly_explained", "unexplained") or d.discrepancy == 0.0:
        return []
    return [
        f"A discrepancy smooth over time, depth and rate, of typically "
        f"{plain(d.discrepancy, 2)} {d.units.force}, keeps predictions honest (discrepancy.csv): "
        "an alarm, not an explanation."
    ]


def _next_test(d: DiagnosisResult) -> list[str]:
    if not d.suggestions:
        return []
    best = d.suggestions[0]
    return [f"To tell them apart: {best.test} (expected 2 ln Bayes factor {best.evidence:.0f})."]


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


def _bent(d: DiagnosisResult) -> list[str]:
    """Effects that would hide in the constants, the invisible ones first."""
    hidden = [bias for bias in d.biases if not bias.visible and bias.effect not in d.tried]
    return [_bias(bias) for bias in hidden[:_MOST_BIASES]]


def _bias(bias: ParameterBias) -> str:
    top = sorted(bias.changes.items(), key=lambda item: -abs(item[1]))[:2]
    said = joined([f"{name} would be {_off(x)}" for name, x in top])
    return (
        f"Were there {bias.effect} ({bias.amplitude} = {bias.size:.2g}), {said}, and these tests "
        "would not show it."
    )


def _off(change: float) -> str:
    """A relative change in words."""
    by = "more than half" if abs(change) > _LINEAR else f"{abs(change):.0%}"
    return f"{by} too {'high' if change > 0.0 else 'low'}"


def _with_value(d: DiagnosisResult, effect: str) -> str:
    form = d.forms.get(effect, effect)
    own = {n: e for n, e in d.stages[-1].parameters.items() if n.startswith(f"{form}.")}
    values = ", ".join(f"{name.partition('.')[2]} = {e}" for name, e in own.items())
    said = effect if form == effect else f"{effect} by the law of {form}"
    return f"{said} ({values})" if values else said


def _percent(share: float) -> str:
    if share > 0.999:
        return "above 99.9 %"
    return "below 0.1 %" if share < 0.001 else f"{100.0 * share:.3g} %"
