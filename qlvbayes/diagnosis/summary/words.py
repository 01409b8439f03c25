"""The verdict in plain language: what is missing, what to do next, and what that rests on."""

from __future__ import annotations

import math

from qlvbayes.diagnosis.candidate import STIFFNESS
from qlvbayes.diagnosis.certainty import calibration
from qlvbayes.diagnosis.phrases import paragraph_lead, parts, varying
from qlvbayes.diagnosis.result import DiagnosisResult, Verdict
from qlvbayes.diagnosis.summary.grounds import (
    Work,
    force_words,
    grounds,
    law_words,
    next_step,
    worst_words,
)
from qlvbayes.effects.catalogue import FORMS
from qlvbayes.io.wording import capitalized, joined, pad_title, percent, plain
from qlvbayes.motion.phases import NAMES
from qlvbayes.motion.specimen import pull_notices

_MOST_BIASES = 3  # effects hidden in the constants that are reported
_LINEAR = 0.5  # relative change of a constant up to which slopes predict it
_HANDFUL = 10  # block means: half of the evidence in fewer of them is reported
_SURE = 0.95  # probability of the base laws from which they are not mentioned
_LITTLE = 0.01  # probability of all other explanations up to which they are not mentioned


def paragraphs(d: DiagnosisResult, work: Work) -> list[str]:
    """Return the verdict in one line, what to do next, and what that rests on, as paragraphs."""
    space = work.search.density.space
    known = (*d.stages[0].effects, *d.effects)
    pulls = pull_notices(work.experiment, bonded=space.bonded, effects=known)

    def seen(effect: str) -> str:
        return space.effects[d.forms.get(effect, effect)].seen

    held = f"say first how the specimen is held, for {_own(d, pulls[0])}. Then " if pulls else ""
    text = [
        f"{capitalized(pad_title(d.pad))}: {paragraph_lead(d, seen)}",
        f"What to do next: {held}{next_step(d, work)}",
        *(f"{capitalized(_own(d, one))}." for one in d.notices if one not in pulls),
        grounds(d, work),
        *law_words(d),
        *_measured(d, work),
        *_certainty(d),
        *_strengths(d),
        *_scatter(d),
    ]
    if d.verdict != Verdict.ADEQUATE:
        text += [_where(d), *_runner_up(d)]
    text += [*_base(d), *_few_readings(d), *_not_ruled_out(d)]
    for name in sorted(work.search.families.unmodelled):
        text += _unnamed(d, name, seen(name))
    return [*text, *_refused(d), *_discrepancy(d), *_unseen(d), *_biases(d, work)]


def _own(d: DiagnosisResult, notice: str) -> str:
    """Return a notice without the pad's name, which the first line has."""
    return notice.removeprefix(f"pad {d.pad}: ")


def _measured(d: DiagnosisResult, work: Work) -> list[str]:
    """Return what the readings show of effects without any model, beyond doubt."""
    trials = work.experiment.trials
    coarse = [one.name for one in trials if not one.trajectory.acceleration_resolved]
    stays = (
        f" In {joined(coarse)} the readings do not give the acceleration: the mass is that of its "
        "impulses, and the error at starts and stops need not fall."
    )
    return [
        f"The readings show {one.effect} without any model: {one.sentence.rstrip('.')}."
        f"{stays if coarse and one.effect == 'inertia' else ''}"
        for one in d.direct_evidence
        if one.beyond_doubt
    ]


def _certainty(d: DiagnosisResult) -> list[str]:
    """Return how often effects with such evidence were there in blind studies."""
    ranked = [one for name in d.in_verdict if (one := d.ranked(name))]
    rated = [(one.effect, one.certainty) for one in ranked if one.certainty is not None]
    if not rated:
        return []
    learnt = calibration()
    listed = joined([f"{name} {percent(one)}" for name, one in rated])
    counts = [
        f"{100.0 * low:.0f} to {100.0 * high:.0f} % were there in {k} of {n} cases"
        for low, high, n, k in sorted({learnt.bin_of(one) for _, one in rated}, reverse=True)
    ]
    return [
        f"Certainty by experience: {listed}. In {learnt.studies} blind studies on other rigs, "
        f"effects with a certainty of {joined(counts, 'and with')}."
    ]


def _strengths(d: DiagnosisResult) -> list[str]:
    """Return how much of the error each named effect removes, and how its strength differs."""
    text = []
    for name in d.in_verdict:
        own = ranked.support if (ranked := d.ranked(name)) else None
        if own is None:
            continue
        removed = 1.0 - math.exp(-own.heldout_gain)
        if removed > 0.0 and own.heldout is not None:
            text.append(
                f"Where it acts, {name} removes {percent(removed)} of the error on {parts(d)} left "
                f"out; {force_words(d, own.heldout)} remain."
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
    return [
        f"The stiffness differs from test to test by about {percent(size)} (one sd) in addition to "
        "all that the model says: that of a new test is known no better."
    ] * (size != 0.0)


def _where(d: DiagnosisResult) -> str:
    """Return where the baseline model has its largest error."""
    rate = d.stages[0].worst.rate
    speed = "no rate" if rate is None else f"{plain(rate)} {d.units.speed}"
    return f"Fitted to all tests, the plain model is worst in {worst_words(d, 0, f' ({speed})')}"


def _runner_up(d: DiagnosisResult) -> list[str]:
    """Return the most probable effect that is not named, of those that the tests could show."""
    taken = {*d.tried, *d.in_verdict, "none", *(one.effect for one in d.not_identifiable)}
    taken |= {kind.family() for kind in FORMS if kind.name in taken}  # named through a form
    rival = next((r for r in d.ranking if r.effect not in taken), None)
    if rival is None:
        return []
    without, with_it = (force_words(d, rmse) for rmse in (d.stages[-1].rmse, rival.rmse))
    same = f"leave the error at {without}"
    change = same if without == with_it else f"change the error from {without} to {with_it}"
    more, company = 0 if rival.support is None else rival.support.effects - len(d.tried) - 1, ""
    if more > 0:
        count = "one more effect" if more == 1 else f"{more} more effects"
        company = f" with {count}, as in its likeliest hypothesis,"
    return [
        f"Of the effects that are not named, but that these tests can show, {rival.effect} is the "
        f"likeliest ({percent(rival.inclusion)}); to add it{company} would {change}."
    ]


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


def _few_readings(d: DiagnosisResult) -> list[str]:
    """Return a warning for each effect whose evidence lies in a handful of readings."""
    shown = {*d.tried, *d.group}
    few = [(one.effect, one.half) for one in d.ranking if one.effect in shown and one.half]
    return [
        f"Half of the evidence for {effect} lies in {half.blocks} of {half.of} averages of "
        f"neighbouring readings, the most of it in the {NAMES[half.phase]} of {half.test} at "
        f"{half.time:.4g} s: look at these readings before you believe the name."
        for effect, half in few
        if half.blocks < _HANDFUL
    ]


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
    lead = "The tests do not rule out other explanations:"
    rest = 1.0 - sum(one.probability for one in d.not_ruled_out)
    if all(refused.intersection(one.effects) for one in others):
        lead = "By the fit alone, with effects that are not named, the likeliest sets are"
    elif rest > _LITTLE:
        listed.append(f"others ({percent(rest)} together)")
    return [
        f"{lead} {joined(listed)}. The constants in diagnosis.json are averaged over all of these."
    ]


def _unnamed(d: DiagnosisResult, name: str, seen: str) -> list[str]:
    """Return that predictions hold an effect which names nothing, where that counts."""
    share = sum(one.probability for one in d.alternatives if name in one.effects)
    return [
        f"Hypotheses with a probability of {percent(min(share, 1.0))} also hold {name} ({seen}), "
        "which stands for something unlisted and is not named. Predictions that are averaged over "
        "the hypotheses (check --program) hold it too."
    ] * (share >= _LITTLE)


def _refused(d: DiagnosisResult) -> list[str]:
    """Return the effects that are probable by the fit but were refused."""
    text = [
        f"{one.effect} is likely by the fit, but not named: {one.reason}.{_varies(d, one.effect)}"
        for one in d.refused
    ]
    names = [one.effect for one in d.refused]
    known = {"none", *d.in_verdict, *names}
    likely = [one.effect for one in d.ranking if one.inclusion >= _SURE and one.effect not in known]
    if names and likely:
        others = joined(names, "or")
        text.append(f"{joined(likely)} would be likely with {others} only, and is not named.")
    return text


def _varies(d: DiagnosisResult, effect: str) -> str:
    """Return between which tests the strength of a refused effect differs most; empty if none."""
    ranked = d.ranked(effect)
    own = ranked.support.strengths if ranked and ranked.support else None
    some = [one for one in own.parts if one.share > _LITTLE] if own and own.spread else []
    if len(some) < 2:
        return ""
    some.sort(key=lambda one: one.ratio)
    return (
        f" Its strength would be {plain(some[0].ratio, 2)} times its mean in {some[0].test}, and "
        f"{plain(some[-1].ratio, 2)} times in {some[-1].test}."
    )


def _discrepancy(d: DiagnosisResult) -> list[str]:
    """Return how the unmodelled part was described, where there is one."""
    return [
        "What is left was described by a smooth function of time, depth and speed (discrepancy.csv)"
        f", of typically {plain(d.discrepancy, 2)} {d.units.force}. It widens the predictions and "
        "explains nothing."
    ] * (d.verdict.has_unmodelled and d.discrepancy != 0.0)


def _unseen(d: DiagnosisResult) -> list[str]:
    """Return which effects the tests cannot show, grouped by the reason."""
    reasons: dict[str, list[str]] = {}
    for entry in d.not_identifiable:
        if entry.effect not in d.tried:
            reasons.setdefault(entry.reason.partition(" (")[0], []).append(entry.effect)
    listed = "; ".join(f"{joined(effects)} ({reason})" for reason, effects in reasons.items())
    return [f"These tests cannot show {listed}."] * bool(reasons)


def _biases(d: DiagnosisResult, work: Work) -> list[str]:
    """Return what effects that would hide in the constants would do to them unseen."""
    effects = work.search.density.space.effects
    hidden = [bias for bias in d.biases if not bias.visible and bias.effect not in d.tried]
    text = []
    for bias in hidden[:_MOST_BIASES]:
        constant = bias.amplitude.partition(".")[2]
        unit = d.units.of(effects[bias.effect].units[constant.partition("[")[0]])
        size = plain(bias.size, 2) + ("" if unit == "1" else f" {unit}")
        (first, change), *others = sorted(bias.changes.items(), key=lambda item: -abs(item[1]))[:2]
        off = [f"{first} would be {_off(change)}", *(f"{n} {_off(x)}" for n, x in others)]
        text.append(
            f"If {bias.effect} were there ({constant} = {size}), {joined(off)}, "
            "and these tests would not show it."
        )
    return text


def _off(change: float) -> str:
    """Return a relative change in words."""
    by = "more than half" if abs(change) > _LINEAR else f"{100.0 * abs(change):.0f} %"
    return f"{by} too {'high' if change > 0.0 else 'low'}"
