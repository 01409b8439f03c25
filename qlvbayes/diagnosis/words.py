"""The verdict in plain language: where, what, how sure, why not another, and what to test next."""

from __future__ import annotations

from qlvbayes.diagnosis.gate import Bend
from qlvbayes.diagnosis.samples import CellError
from qlvbayes.diagnosis.verdict import Diagnosis, Ranked, Stage
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.units import UnitSystem
from qlvbayes.wording import joined, plain

_PHASE = {"ramp": "ramp", "hold": "hold", "unload": "unloading", "recovery": "recovery"}
_MOST_BENDS = 3
_LINEAR = 0.5  # relative change up to which slopes tell how far a constant moves
_MOST_CELLS = 4
_LIKELY = 0.5  # probability of nothing, from which the text says so without ifs
_LITTLE = 0.01  # probability of all explanations that are not listed, up to which they go unsaid
_NOTHING = "nothing is missing that these tests can show"
_UNLISTED = {
    "free_spring": (
        "A spring of free form beside the pad, a force that depends on depth alone,",
        "a second contact or a stiffer core",
    ),
    "free_offsets": (
        "An offset of its own in every test, a force that depends on the clock alone,",
        "a cell zeroed anew, or a part of the rig that gave way",
    ),
}
_MAYBE = "nothing is named, although something may be missing"


def paragraphs(diagnosis: Diagnosis) -> list[str]:
    """A few short paragraphs, the verdict first."""
    verdict = {
        "adequate": _adequate,
        "missing_effect": _missing,
        "ambiguous": _ambiguous,
        "unexplained": _unexplained,
    }[diagnosis.verdict]
    text = [verdict(diagnosis)]
    if diagnosis.verdict != "adequate":
        text.insert(1, _where(diagnosis))
        text += _runner_up(diagnosis)
    text += _not_ruled_out(diagnosis)
    text += _honest(diagnosis)
    text += _next_test(diagnosis)
    text += _unseen(diagnosis)
    text += _bent(diagnosis)
    return text + [f"{one[0].upper()}{one[1:]}." for one in diagnosis.notices]


def _units(diagnosis: Diagnosis) -> UnitSystem:
    return diagnosis.work.experiment.units


def _adequate(d: Diagnosis) -> str:
    unit, stage = _units(d).force, d.stages[0]
    none = next(r for r in d.ranking if r.effect == "none")
    hidden = {unseen.effect for unseen in d.not_identifiable}
    best = next((r for r in d.ranking if r.effect not in {"none", *hidden}), None)
    text = (
        f"Pad {d.pad}: {_NOTHING if none.probability >= _LIKELY else _MAYBE}. The model leaves "
        f"{plain(stage.rmse)} {unit}, the noise floor is {plain(d.noise)} {unit}"
        f"{_left(d, 'no phase of any test shows structure', '; ')}"
    )
    if best is not None:
        text += (
            f" Probability that nothing of the list is missing: {_percent(none.probability)}; "
            f"of the effects that they could show, {best.effect} is the likeliest "
            f"({_percent(best.probability)})."
        )
    return text


def _missing(d: Diagnosis) -> str:
    unit, last = _units(d).force, d.stages[-1]
    named = joined([_with_value(d, effect, last) for effect in d.effects])
    seen = " ".join(f"{_effect(d, e).seen[0].upper()}{_effect(d, e).seen[1:]}." for e in d.effects)
    return (
        f"Pad {d.pad}: missing {'effect' if len(d.effects) == 1 else 'effects'}: {named}. {seen} "
        f"{_own_form(d)}{_sureness(d)} With it the error on tests left out {_change(d)} (noise "
        f"floor {plain(d.noise)} {unit})"
        f"{_left(d, 'no phase of any test shows structure any more', ', and ')}"
    )


def _ambiguous(d: Diagnosis) -> str:
    unit = _units(d).force
    before, constants = d.effects[:-1], [f"{name} = {e}" for name, e in d.constants.items()]
    besides = f" besides {joined(list(before))}" if before else ""
    return (
        f"Pad {d.pad}: something is missing{besides}, and these tests cannot tell which of "
        f"{joined(list(d.group), 'or')} it is: each explains them about equally well. With the "
        f"first the error on tests left out {_change(d)} (noise floor {plain(d.noise)} {unit})."
        f"{'' if d.stages[-1].sound else f' {_small(d)}'} "
        f"Allowing for all that the tests do not rule out, {joined(constants)}."
    )


def _change(d: Diagnosis) -> str:
    """What the effects do to the error on tests left out."""
    first, last = d.stages[0].heldout_rmse, d.stages[-1].heldout_rmse
    if last < first:
        return f"falls from {plain(first)} to {plain(last)} {_units(d).force}"
    return (
        f"goes from {plain(first)} to {plain(last)} {_units(d).force}, yet they are predicted "
        "better if noise that lasts from sample to sample is allowed for"
    )


def _unexplained(d: Diagnosis) -> str:
    unit, last = _units(d).force, d.stages[-1]
    outside = f" {_outside(d, d.outside)}" if d.outside else ""
    if last.sound:
        return (
            f"Pad {d.pad}: unexplained. {joined(list(last.effects))} would leave nothing "
            f"structured, but something outside the list is likelier: none is named.{outside}"
        )
    tried = f" The best that the list offers, {joined(list(last.effects))}, is not enough:" * bool(
        last.effects
    )
    worst = max(last.cells, key=lambda cell: cell.rmse)
    cells = list(dict.fromkeys(f"{_PHASE[phase]} of {test}" for test, phase in last.failing))
    more = f" and {len(cells) - _MOST_CELLS} more" if len(cells) > _MOST_CELLS else ""
    where = f", in the {joined(cells[:_MOST_CELLS])}{more}" if cells else ""
    return (
        f"Pad {d.pad}: unexplained.{tried} structure remains beyond the noise floor of "
        f"{plain(d.noise)} {unit} ({_p(last.p_value)}){where}. The largest error left is "
        f"{plain(worst.rmse)} {unit} in the {_PHASE[worst.phase]} of {worst.test}.{_size(d)}"
        f"{outside} No effect is named: take the constants as those of a model that is wrong."
    ).replace(". structure", ". Structure")


def _left(d: Diagnosis, nothing: str, joint: str) -> str:
    """The end of a sentence on the last model: no structure, or little, with its size and place."""
    last = d.stages[-1]
    return f"{joint}{nothing} ({_p(last.p_value)})." if last.sound else f". {_small(d)}"


def _small(d: Diagnosis) -> str:
    """Structure that is sure but does not matter."""
    return (
        f"There is structure that is sure but small: {_measure(d)} ({_p(d.stages[-1].p_value)}). "
        f"The tolerance is {_share(d.remainder.tolerance if d.remainder else 0.0)} of the peak."
    )


def _size(d: Diagnosis) -> str:
    """How large structure that matters is."""
    left = d.remainder
    if left is None or left.worst is None or left.worst.rms == 0.0:
        return ""
    return f" Without the noise, what is left is largest, {_measure(d)}."


def _measure(d: Diagnosis) -> str:
    """The structured part where it is largest, else what all samples hold beyond the noise."""
    left, unit = d.remainder, _units(d).force
    worst = left.worst if left else None
    if left is None or worst is None:
        return ""
    if worst.rms > 0.0:
        size, place = worst.rms, f"in the {_PHASE[worst.phase]} of {worst.test}"
        most = f", {worst.upper:.2g} {unit} at most"
    else:
        size, place, most = left.excess, "over all tests", ""
    return f"{_share(size / left.peak)} of the peak force ({size:.2g} {unit}{most}) {place}"


def _share(value: float) -> str:
    return f"{100.0 * value:.2g} %"


def _outside(d: Diagnosis, rival: str) -> str:
    """A rival that no list holds explains the tests better."""
    what, cause = _UNLISTED[rival]
    than = joined(list(d.tried)) or "the plain model"
    return (
        f"{what} explains the tests better than {than} (log Bayes factor "
        f"{d.unlisted[rival]:.3g}): perhaps {cause}."
    )


def _p(value: float) -> str:
    return f"p = {value:.2g}" if value > 1e-12 else "p below 1e-12"


def _where(d: Diagnosis) -> str:
    units, worst = _units(d), d.worst
    sign = "above" if worst.bias > 0.0 else "below"
    return (
        f"Where the plain model fails worst: the {_PHASE[worst.phase]} of {worst.test} "
        f"({_rate(worst, units)}), by {plain(worst.rmse)} {units.force} root mean square; the "
        f"measured force lies {plain(abs(worst.bias))} {units.force} {sign} the model on average."
    )


def _rate(cell: CellError, units: UnitSystem) -> str:
    return f"{plain(cell.rate)} {units.speed}"


def _own_form(d: Diagnosis) -> str:
    """How the effect differs from the list's law."""
    shape = d.stages[-1].shape
    if shape is None:
        return ""
    if shape.over_delay:
        return _spread_lag(shape.over_delay)
    adds, drains = f"what {shape.effect} adds", "the rate at which the pressure drains"
    spread = {
        (adds, "no depth", "full depth"): shape.over_depth,
        (adds, "the first test", "the last"): shape.over_clock,
        (adds, "no force", "the largest force"): shape.over_force,
        (drains, "a fifth of its largest value", "the largest"): shape.over_pressure,
    }
    what, values = max(spread.items(), key=lambda item: _range([y for _, y in item[1]]))
    first, last = values[0][1], values[-1][1]
    return (
        f"But not by the list's law: {what[0]} must be taken times {first:.2g} at "
        f"{what[1]} and {last:.2g} at {what[2]} (other_form in diagnosis.json); the constants "
        "below are those of the law so changed, and an effect of your own would do it justice. "
    )


def _spread_lag(delays: tuple[tuple[float, float], ...]) -> str:
    mean = sum(delay * weight for delay, weight in delays)
    sd = sum(weight * (delay - mean) ** 2 for delay, weight in delays) ** 0.5
    return (
        "But not by the list's law: the force is not late by one delay but averaged over the past, "
        f"by delays of {mean:.3g} s in the mean and {sd:.3g} s about it (other_form in "
        "diagnosis.json; as much as the mean: a filter of first order); the constants below are "
        "those of the law so changed, and an effect of your own would do it justice. "
    )


def _range(values: list[float]) -> float:
    return max(values, default=0.0) - min(values, default=0.0)


def _sureness(d: Diagnosis) -> str:
    """Of the first effect, from the first round; of a form of its own, against the list's."""
    if len(d.effects) == 1:
        listed = next(r for r in d.ranking if r.effect == d.effects[0])
        if d.own_form is None:
            likely = _percent(listed.probability)
            return f"Probability {likely} among nothing and the effects of the list."
        by_law, changed = listed.log_bayes_factor, d.own_form.log_bayes_factor
        return (
            f"So changed its log Bayes factor against the plain model is {changed:.3g}, by the "
            f"list's law {f'{by_law:.3g}' if by_law > 0.0 else 'below 0'}."
        )
    gains = [b.log_evidence - a.log_evidence for a, b in zip(d.stages, d.stages[1:], strict=False)]
    said = joined([f"{gain:.3g}" for gain in gains])
    return f"Each step raised the log evidence decisively (by {said})."


def _runner_up(d: Diagnosis) -> list[str]:
    """Why the next best single effect lost."""
    taken = set(d.tried) | set(d.group)
    best = [r for r in d.ranking if r.effect not in taken | {"none"} and r.rmse is not None]
    listed = next((r for r in d.ranking if d.tried and r.effect == d.tried[0]), None)
    first = d.own_form or listed
    if not best or first is None:
        return []
    rival: Ranked = max(best, key=lambda r: r.log_bayes_factor)
    theirs, ours = rival.rmse or 0.0, first.rmse or 0.0
    unit, gap = _units(d).force, first.log_bayes_factor - rival.log_bayes_factor
    text = (
        f"Runner-up: {rival.effect}. It leaves {plain(theirs)} {unit} where {first.effect} "
        f"leaves {plain(ours)} {unit}"
    )
    if gap > 0.0:
        against = f"against it by a log Bayes factor of {gap:.3g}."
        if theirs > ours:
            return [f"{text}, and the evidence is {against}"]
        return [
            f"{text}, but the evidence, which also counts how errors follow one another and what "
            f"each constant costs, is {against}"
        ]
    why = dict(d.refused).get(rival.effect, "a later step made it useless")
    return [f"{text}; it was not taken as {why}."]


def _not_ruled_out(d: Diagnosis) -> list[str]:
    """Explanations besides the verdict's own."""
    own = [{*d.effects[:-1], name} for name in d.group] if len(d.group) > 1 else [set(d.effects)]
    others = [one for one in d.not_ruled_out if set(one.effects) not in own]
    if not others:
        return []
    said = [f"{joined(list(o.effects)) or 'nothing'} ({_percent(o.probability)})" for o in others]
    rest = 1.0 - sum(one.probability for one in d.not_ruled_out)
    if rest > _LITTLE:
        said.append(f"others ({_percent(rest)} together)")
    return [f"The tests do not rule out {joined(said, 'or')} either; the constants allow for it."]


def _honest(d: Diagnosis) -> list[str]:
    if d.discrepancy is None:
        return []
    return [
        f"A Gaussian-process discrepancy over time, depth and rate, of typically "
        f"{plain(d.discrepancy, 2)} {_units(d).force}, keeps predictions honest (discrepancy.csv): "
        "an alarm, not an explanation."
    ]


def _next_test(d: Diagnosis) -> list[str]:
    if not d.suggestions:
        return []
    best = d.suggestions[0]
    return [f"To tell them apart: {best.test} (expected 2 ln Bayes factor {best.evidence:.0f})."]


def _unseen(d: Diagnosis) -> list[str]:
    """By reason, in one sentence each."""
    reasons: dict[str, list[str]] = {}
    for entry in d.not_identifiable:
        if entry.effect not in d.tried:
            reasons.setdefault(entry.reason.partition(" (")[0], []).append(entry.effect)
    if not reasons:
        return []
    said = "; ".join(f"{joined(effects)} ({reason})" for reason, effects in reasons.items())
    return [f"These tests cannot show {said}."]


def _bent(d: Diagnosis) -> list[str]:
    """Effects that would hide in the constants, the invisible ones first."""
    hidden = [bend for bend in d.bends if not bend.visible and bend.effect not in d.tried]
    return [_bend(bend) for bend in hidden[:_MOST_BENDS]]


def _bend(bend: Bend) -> str:
    top = sorted(bend.changes.items(), key=lambda item: -abs(item[1]))[:2]
    said = joined([f"{name} would be {_off(x)}" for name, x in top])
    return (
        f"Were there {bend.effect} ({bend.amplitude} = {bend.size:.2g}), {said}, and these tests "
        "would not show it."
    )


def _off(change: float) -> str:
    """A relative change in words."""
    by = "more than half" if abs(change) > _LINEAR else f"{abs(change):.0%}"
    return f"{by} too {'high' if change > 0.0 else 'low'}"


def _with_value(d: Diagnosis, effect: str, stage: Stage) -> str:
    own = {n: e for n, e in stage.parameters.items() if n.startswith(f"{effect}.")}
    values = ", ".join(f"{name.partition('.')[2]} = {e}" for name, e in own.items())
    return f"{effect} ({values})" if values else effect


def _effect(d: Diagnosis, name: str) -> AbstractEffect:
    return d.work.ensemble.effect(name)


def _percent(share: float) -> str:
    if share > 0.999:
        return "above 99.9 %"
    return "below 0.1 %" if share < 0.001 else f"{100.0 * share:.3g} %"
