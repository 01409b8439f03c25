"""The verdict in plain language: what is missing, what to do next, and what that rests on."""

from __future__ import annotations

import math
from functools import partial

from qlvbayes.diagnosis.candidate import STIFFNESS
from qlvbayes.diagnosis.certainty import calibration
from qlvbayes.diagnosis.decision import Verdict
from qlvbayes.diagnosis.phrases import LIKELY, paragraph_lead, parts, varying
from qlvbayes.diagnosis.result import DiagnosisResult, ParameterBias
from qlvbayes.diagnosis.summary.law import fit_command, law_paragraphs, law_step
from qlvbayes.diagnosis.summary.work import DiagnosisWork
from qlvbayes.effects.catalogue import FORMS
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import capitalized, joined, pad_title, percent, plain, to_noise
from qlvbayes.motion.phases import NAMES
from qlvbayes.motion.specimen import pull_notices

_MOST_BIASES = 3  # effects hidden in the constants that are reported
_LINEAR = 0.5  # relative change of a constant up to which slopes predict it
_MOST_CELLS = 4  # phases that are listed by name
_HANDFUL = 10  # block means: half of the evidence in fewer of them is reported
_SURE = 0.95  # probability of the base laws from which they are not mentioned
_LITTLE = 0.01  # probability of all other explanations up to which they are not mentioned


def paragraphs(d: DiagnosisResult, work: DiagnosisWork) -> list[str]:
    """Return the verdict in one line, what to do next, and what that rests on, as paragraphs."""
    grounds = {
        Verdict.ADEQUATE: _adequate_grounds,
        Verdict.MISSING_EFFECT: _missing_effect_grounds,
        Verdict.AMBIGUOUS: _ambiguous_grounds,
        Verdict.PARTLY_EXPLAINED: _partly_explained_grounds,
        Verdict.UNEXPLAINED: _unexplained_grounds,
    }[d.verdict]
    pulls = pull_notices(work.experiment, bonded=work.search.density.space.bonded)
    text = [
        f"{capitalized(pad_title(d.pad))}: {paragraph_lead(d, partial(_seen, d, work))}",
        f"What to do next: {_first(d, pulls)}{_next(d, work)}",
        *(f"{capitalized(_own(d, one))}." for one in d.notices if one not in pulls),
        grounds(d, work),
        *law_paragraphs(d),
        *_measured(d, work),
        *_certainty(d),
        *_strengths(d),
        *_scatter(d),
    ]
    if d.verdict != Verdict.ADEQUATE:
        text += [_where(d), *_runner_up(d)]
    return [
        *text,
        *_base(d),
        *_few_readings(d),
        *_not_ruled_out(d),
        *_unnamed(d, work),
        *_refused(d),
        *_discrepancy(d),
        *_unseen(d),
        *_biases(d, work),
    ]


def _seen(d: DiagnosisResult, work: DiagnosisWork, effect: str) -> str:
    """Return what one sees of an effect."""
    return work.search.density.space.effects[d.forms.get(effect, effect)].seen


def _first(d: DiagnosisResult, pulls: tuple[str, ...]) -> str:
    """Return what comes before the step that the verdict asks for: a loose pad cannot pull."""
    if not pulls or "adhesion" in (*d.stages[0].effects, *d.effects):
        return ""
    return f"say first how the specimen is held, for {_own(d, pulls[0])}. Then "


def _own(d: DiagnosisResult, notice: str) -> str:
    """Return a notice without the pad's name, which the first line has."""
    return notice.removeprefix(f"pad {d.pad}: ")


def _next(d: DiagnosisResult, work: DiagnosisWork) -> str:
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
    worst = d.stages[-1].worst
    return (
        f"look at the {NAMES[worst.phase]} of {worst.test} in the figure forces_before_after. "
        "Its cause may be the rig, the record, or an effect that is not on the list "
        "(--effects-file). Until it is known, the constants are those of a wrong model."
        f"{law_step(d, work)}"
    )


def _adequate_grounds(d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return the error that is left, and the most probable effect that is not needed."""
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


def _certainty(d: DiagnosisResult) -> list[str]:
    """Return how often effects with such evidence were there in blind studies."""
    known = {one.effect: one.certainty for one in d.ranking}
    names = [name for name in dict.fromkeys((*d.effects, *d.group)) if name in known]
    rated = [(name, one) for name in names if (one := known[name]) is not None]
    text, learnt = [], calibration()
    if rated:
        listed = joined([f"{name} {percent(one)}" for name, one in rated])
        bins = sorted({learnt.bin_of(one) for _, one in rated}, reverse=True)
        counts = [
            f"{100.0 * low:.0f} to {100.0 * high:.0f} % were there in {k} of {n} cases"
            for low, high, n, k in bins
        ]
        text.append(
            f"Certainty by experience: {listed}. In {learnt.studies} blind studies on other rigs, "
            f"effects with a certainty of {joined(counts, 'and with')}."
        )
    return text


def _measured(d: DiagnosisResult, work: DiagnosisWork) -> list[str]:
    """Return what the readings show of effects without any model, beyond doubt."""
    trials = work.experiment.trials
    coarse = [one.name for one in trials if not one.trajectory.acceleration_resolved]
    stays = (
        f" In {joined(coarse)} the readings do not give the acceleration: the mass is that of its "
        "impulses, and the error at starts and stops need not fall"
    )
    return [
        f"The readings show {one.effect} without any model: {one.sentence.rstrip('.')}."
        f"{f'{stays}.' if coarse and one.effect == 'inertia' else ''}"
        for one in d.direct_evidence
        if one.beyond_doubt
    ]


def _strengths(d: DiagnosisResult) -> list[str]:
    """Return how much of the error each named effect removes, and how its strength differs."""
    text = []
    for name in dict.fromkeys((*d.effects, *d.group)):
        ranked = d.ranked(name)
        own = ranked.support if ranked is not None else None
        if own is None:
            continue
        removed = 1.0 - math.exp(-own.heldout_gain)
        if removed > 0.0 and own.heldout is not None:
            text.append(
                f"Where it acts, {name} removes {percent(removed)} of the error on {parts(d)} left "
                f"out; {_error(d, own.heldout)} remain."
            )
        if (differing := d.strengths.get(name)) is not None:
            low, high = differing.range
            trend = f" and {differing.grows_with}" if differing.grows_with else ""
            text.append(
                f"{varying(d)} the strength of {name} is {plain(low, 2)} to {plain(high, 2)} "
                f"times its mean{trend}; {percent(differing.agreement)} of its force is that "
                "of one strength."
            )
    return text


def _scatter(d: DiagnosisResult) -> list[str]:
    """Return by how much the stiffness differs from test to test."""
    size = d.scatter.get(STIFFNESS, 0.0)
    if size == 0.0:
        return []
    return [
        f"The stiffness differs from test to test by about {percent(size)} (one sd) in addition to "
        "all that the model says: that of a new test is known no better."
    ]


def _missing_effect_grounds(d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return the constants of the effects, and what they do to the error."""
    return f"Constants: {_named(d)}. {_change(d)}{_left(d, work, ', and ')}"


def _named(d: DiagnosisResult) -> str:
    """Return the named effects with their values."""
    return joined([_with_value(d, effect) for effect in d.effects])


def _ambiguous_grounds(d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return what the first of the group does to the error, and the averaged constants."""
    constants = [f"{name} = {e}" for name, e in d.constants.items()]
    return (
        f"{_change(d, 'With the first')}.{'' if _is_sound(d, work) else f' {_small(d, work)}'} "
        f"Averaged over all that the tests do not rule out, {joined(constants)}."
    )


def _partly_explained_grounds(d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return the share of the error that the named effects take, and what is left."""
    share = d.remainder.share_of_error if d.remainder else None
    taken = (
        f" They take {_share(1.0 - share)} of the error."
        if share is not None and share < 1.0
        else ""
    )
    taken = taken.replace("They take", "It takes") if len(d.effects) == 1 else taken
    return f"Constants: {_named(d)}. {_change(d)}.{taken} {_structure(d, work)}"


def _unexplained_grounds(d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return the effects that were not enough, and the structure that is left."""
    known = [name for name in d.tried if name not in work.search.families.unmodelled]
    tried = f" The best that the list offers, {joined(known)}, is not enough." if known else ""
    return f"No effect is named.{tried} {_structure(d, work)}"


def _is_free_elasticity(d: DiagnosisResult, work: DiagnosisWork) -> bool:
    """Return whether only a free curve of stiffness over depth leaves nothing but noise."""
    return d.base.elastic not in work.search.nameable_laws and _is_sound(d, work)


def _structure(d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return where a systematic error is left, and how large it is."""
    last = d.stages[-1]
    if _is_free_elasticity(d, work):
        return (
            "The elasticity is that of no law of the list. With a free curve of stiffness over "
            f"depth ({d.base.elastic}) nothing is left but noise ({_p(last.p_value)})."
        )
    worst = last.worst
    cells = [f"the {NAMES[at.phase]} of {at.test}" for at in last.failing]
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
    """Return which laws the tests ask for, where these are not the chosen ones or not certain."""
    chosen = d.stages[0].base
    others = [base for base in d.bases if base.pair != d.base.pair]
    if d.base.pair == chosen.pair and d.base.probability >= _SURE:
        return []
    likelier = any(base.probability > d.base.probability for base in others)
    head = "The likeliest hypothesis has the laws" if likelier else "The likeliest laws are"
    over = "with no effect but those that are named" if d.refused else "over all sets of effects"
    text = f"{head} {d.base} ({percent(d.base.probability)} {over})"
    if d.base.pair != chosen.pair:
        text += f" instead of {chosen}"
    rest = [f"{base} ({percent(base.probability)})" for base in others[:2]]
    return [f"{text}; of the others {joined(rest)} are likeliest." if rest else f"{text}."]


def _change(d: DiagnosisResult, with_it: str = "With it") -> str:
    """Return what the laws and effects do to the error on tests left out."""
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
        f"{with_it} the error on {parts(d)} left out {verb} from {_error(d, first)} to "
        f"{_error(d, last)} (noise floor {_noise(d)})"
    )


def _left(d: DiagnosisResult, work: DiagnosisWork, joint: str) -> str:
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


def _small(d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return a sentence on a systematic error that is certain but does not matter."""
    p = _p(d.stages[-1].p_value)
    if d.remainder is not None and d.remainder.excess == d.remainder.rms == 0.0:
        return f"A systematic error is certain but too small to be measured ({p})."
    return (
        f"A systematic error is left that is certain but small: {_measure(d, work)} ({p}). "
        f"The tolerance is {_share(d.tolerance or 0.0)} of the peak force."
    )


def _size(d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return a sentence on the size of an error that matters."""
    if d.remainder is None or d.remainder.rms == 0.0:
        return ""
    return f" Without the noise it amounts to {_measure(d, work)}."


def _measure(d: DiagnosisResult, work: DiagnosisWork) -> str:
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


def _is_sound(d: DiagnosisResult, work: DiagnosisWork) -> bool:
    """Return whether the selected hypothesis passes the adequacy test."""
    return d.stages[-1].p_value >= work.search.settings.false_alarms


def _share(value: float) -> str:
    return f"{plain(100.0 * value, 2)} %"


def _p(value: float) -> str:
    return f"p = {value:.2g}" if value > 1e-12 else "p below 1e-12"


def _noise(d: DiagnosisResult) -> str:
    return f"{plain(d.noise)} {d.units.force}"


def _error(d: DiagnosisResult, value: float) -> str:
    """Return a force with the digits that the noise allows."""
    return f"{to_noise(value, d.noise)} {d.units.force}"


def _offset(d: DiagnosisResult, bias: float) -> str:
    return f"{_error(d, abs(bias))} {'above' if bias > 0.0 else 'below'}"


def _where(d: DiagnosisResult) -> str:
    """Return where the baseline model has its largest error."""
    worst = d.stages[0].worst
    return (
        f"Fitted to all tests, the plain model is worst in the {NAMES[worst.phase]} of "
        f"{worst.test} ({_rate(worst.rate, d.units)}): {_error(d, worst.rmse)} root mean square, "
        f"where the measured force lies {_offset(d, worst.bias)} the model on average."
    )


def _rate(rate: float | None, units: UnitSystem) -> str:
    return "no rate" if rate is None else f"{plain(rate)} {units.speed}"


def _few_readings(d: DiagnosisResult) -> list[str]:
    """Return a warning for each effect whose evidence lies in a handful of readings."""
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
    """Return the most probable effect that is not named, of those that the tests could show."""
    taken = {*d.tried, *d.effects, *d.group, "none", *(one.effect for one in d.not_identifiable)}
    taken |= {kind.family() for kind in FORMS if kind.name in taken}  # named through a form
    rival = next((r for r in d.ranking if r.effect not in taken), None)
    if rival is None:
        return []
    without, with_it = (_error(d, rmse) for rmse in (d.stages[-1].rmse, rival.rmse))
    same = f"leave the error at {without}"
    change = same if without == with_it else f"change the error from {without} to {with_it}"
    added = f"to add it would {change}"
    more = 0 if rival.support is None else rival.support.effects - len(d.tried) - 1
    if more > 0:
        count = "one more effect" if more == 1 else f"{more} more effects"
        added = f"to add it with {count}, as in its likeliest hypothesis, would {change}"
    return [
        f"Of the effects that are not named, but that these tests can show, {rival.effect} is the "
        f"likeliest ({percent(rival.inclusion)}); {added}."
    ]


def _refused(d: DiagnosisResult) -> list[str]:
    """Return the effects that are probable by the fit but were refused."""
    text = [
        f"{one.effect} is likely by the fit, but not named: {one.reason}.{_varies(d, one.effect)}"
        for one in d.refused
    ]
    known = {"none", *d.effects, *d.group, *(one.effect for one in d.refused)}
    likely = [one.effect for one in d.ranking if one.inclusion >= _SURE and one.effect not in known]
    if d.refused and likely:
        others = joined([one.effect for one in d.refused], "or")
        text.append(f"{joined(likely)} would be likely with {others} only, and is not named.")
    return text


def _varies(d: DiagnosisResult, effect: str) -> str:
    """Return between which tests the strength of a refused effect differs most; empty if none."""
    ranked = d.ranked(effect)
    own = ranked.support.strengths if ranked and ranked.support else None
    if own is None or own.spread == 0.0:
        return ""
    some = [one for one in own.parts if one.share > _LITTLE]
    if len(some) < 2:
        return ""
    least, most = (pick(some, key=lambda one: one.ratio) for pick in (min, max))
    return (
        f" Its strength would be {plain(least.ratio, 2)} times its mean in {least.test}, and "
        f"{plain(most.ratio, 2)} times in {most.test}."
    )


def _not_ruled_out(d: DiagnosisResult) -> list[str]:
    """Return the explanations that remain possible in addition to the verdict's own."""
    own = [{*d.effects[:-1], name} for name in d.group] if len(d.group) > 1 else [set(d.effects)]
    others = [one for one in d.not_ruled_out if set(one.effects) not in own]
    if not others or d.verdict in (Verdict.ADEQUATE, Verdict.UNEXPLAINED):
        return []
    listed = [
        f"{joined(list(o.effects), 'with') or 'nothing'} ({percent(o.probability)})" for o in others
    ]
    refused = {one.effect for one in d.refused}
    if all(refused.intersection(one.effects) for one in others):
        return [
            f"By the fit alone, with effects that are not named, the likeliest sets are "
            f"{joined(listed)}. The constants in diagnosis.json are averaged over all of these."
        ]
    rest = 1.0 - sum(one.probability for one in d.not_ruled_out)
    if rest > _LITTLE:
        listed.append(f"others ({percent(rest)} together)")
    return [
        f"The tests do not rule out other explanations: {joined(listed)}. The constants in "
        "diagnosis.json are averaged over all of these."
    ]


def _unnamed(d: DiagnosisResult, work: DiagnosisWork) -> list[str]:
    """Return what names nothing and is in the hypotheses over which predictions are averaged."""
    text = []
    for name in sorted(work.search.families.unmodelled):
        share = sum(one.probability for one in d.alternatives if name in one.effects)
        if share >= _LITTLE:
            text.append(
                f"Hypotheses with a probability of {percent(min(share, 1.0))} also hold {name} "
                f"({_seen(d, work, name)}), which stands for something unlisted and is not named. "
                "Predictions that are averaged over the hypotheses (check --program) hold it too."
            )
    return text


def _discrepancy(d: DiagnosisResult) -> list[str]:
    """Return how the unmodelled part was described, where there is one."""
    if not d.verdict.has_unmodelled or d.discrepancy == 0.0:
        return []
    return [
        "What is left was described by a smooth function of time, depth and speed (discrepancy.csv)"
        f", of typically {plain(d.discrepancy, 2)} {d.units.force}. It widens the predictions and "
        "explains nothing."
    ]


def _unseen(d: DiagnosisResult) -> list[str]:
    """Return which effects the tests cannot show, grouped by the reason."""
    reasons: dict[str, list[str]] = {}
    for entry in d.not_identifiable:
        if entry.effect not in d.tried:
            reasons.setdefault(entry.reason.partition(" (")[0], []).append(entry.effect)
    if not reasons:
        return []
    listed = "; ".join(f"{joined(effects)} ({reason})" for reason, effects in reasons.items())
    return [f"These tests cannot show {listed}."]


def _biases(d: DiagnosisResult, work: DiagnosisWork) -> list[str]:
    """Return the effects that would hide in the constants without being seen."""
    hidden = [bias for bias in d.biases if not bias.visible and bias.effect not in d.tried]
    return [_bias(bias, _unit(bias.amplitude, d, work)) for bias in hidden[:_MOST_BIASES]]


def _unit(name: str, d: DiagnosisResult, work: DiagnosisWork) -> str:
    """Return the unit of an effect's constant, empty for a pure number."""
    effect, _, constant = name.partition(".")
    unit = d.units.of(work.search.density.space.effects[effect].units[constant.partition("[")[0]])
    return "" if unit == "1" else f" {unit}"


def _bias(bias: ParameterBias, unit: str) -> str:
    (first, change), *others = sorted(bias.changes.items(), key=lambda item: -abs(item[1]))[:2]
    changes = joined([f"{first} would be {_off(change)}", *(f"{n} {_off(x)}" for n, x in others)])
    constant = bias.amplitude.partition(".")[2]
    return (
        f"If {bias.effect} were there ({constant} = {plain(bias.size, 2)}{unit}), {changes}, "
        "and these tests would not show it."
    )


def _off(change: float) -> str:
    """Return a relative change in words."""
    by = "more than half" if abs(change) > _LINEAR else f"{100.0 * abs(change):.0f} %"
    return f"{by} too {'high' if change > 0.0 else 'low'}"


def _with_value(d: DiagnosisResult, effect: str) -> str:
    """Return an effect with the values of its constants."""
    form = d.forms.get(effect, effect)
    own = {n: e for n, e in d.stages[-1].parameters.items() if n.startswith(f"{form}.")}
    values = ", ".join(f"{name.partition('.')[2]} = {e}" for name, e in own.items())
    name = effect if form == effect else f"{effect} by the law of {form}"
    return f"{name} ({values})" if values else name
