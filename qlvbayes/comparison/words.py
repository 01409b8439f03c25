"""Sentences of a comparison."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import log

from qlvbayes.comparison.contrast import BY_CHANCE, Comparison, Contrast, with_interval, written
from qlvbayes.comparison.readings import Reading, ReadingSettings
from qlvbayes.comparison.side import Side, fixed_constants
from qlvbayes.io.wording import plain

_TESTS = {
    ("pads", "constants"): "joint test of all shared constants",
    ("fluids", "constants"): "smallest tail of the shared constants, corrected for their number",
    ("pads", "shown"): "smallest tail of what all tests show, corrected for their number",
    ("fluids", "shown"): "smallest tail of what all tests show, corrected for their number",
}
_SHARED = {"constants": "in every shared constant", "shown": "in all that both tests show"}


def paragraphs(comparison: Comparison) -> list[str]:
    """Return the answer: whether they differ, each quantity, and the limits of the comparison."""
    one, _ = comparison.names
    # the paper's table gives the relaxation rates as equal for both fluids
    rates = [c for c in comparison.of_group("constants") if c.quantity.startswith("v[")]
    lines = [_verdict(comparison)]
    if rates:
        lines.append(f"Relaxation rates: {'; '.join(_one(c, comparison) for c in rates)}.")
    texts = {
        "greater": f"Greater in {one}",
        "less": f"Less in {one}",
        "equal": f"Equal within {100 * comparison.region:g} %",
        "cannot tell": "Cannot tell",
    }
    for answer, text in texts.items():
        chosen = [c for c in comparison.contrasts if c.answer == answer]
        lines += [f"{text}: {', '.join(map(_brief, chosen))}."] if chosen else []
    different = sum(c.answer in ("greater", "less") for c in comparison.contrasts)
    lines.append(
        f"{different} of {len(comparison.contrasts)} quantities are called different one by one; "
        f"were the two equal in all of them, up to {comparison.by_chance:.1f} would be by chance "
        f"({100 * BY_CHANCE:g} % each). Whether they differ at all is therefore judged by the "
        "joint test above."
    )
    return [*lines, *(f"{notice[0].upper()}{notice[1:]}." for notice in comparison.notices)]


def _verdict(comparison: Comparison) -> str:
    one, other = comparison.names
    region, omnibus = f"{100 * comparison.region:g} %", comparison.omnibus
    if omnibus is None:
        return (
            f"Cannot tell whether {one} and {other} differ as a whole: they share no constant that "
            "a joint test could compare. One by one:"
        )
    p_value = f"p = {omnibus.p_value:.2g}" if omnibus.p_value >= 1e-4 else "p < 0.0001"
    test = (
        f"({_TESTS[comparison.between, omnibus.over]}, {p_value}; {100 * omnibus.false_alarms:g} % "
        "of equal pairs would be called different)"
    )
    if comparison.differ:
        return f"Yes: {one} and {other} differ {test}.{_most(comparison, region)}"
    if comparison.differ is None:
        return (
            f"Cannot tell whether {one} and {other} differ: no difference is shown {test}, but the "
            f"intervals are too wide to call them equal within {region}."
        )
    return (
        f"No: {one} and {other} are equal within {region} {_SHARED[omnibus.over]}, and no "
        f"difference is shown {test}."
    )


def _most(comparison: Comparison, region: str) -> str:
    """Name the quantity that differs most."""
    if all(c.answer == "equal" for c in comparison.contrasts):
        return f" Yet every quantity is equal within {region}: the difference is real but small."
    apart = [c for c in comparison.contrasts if c.answer in ("greater", "less")]
    ratios = {c.quantity: c.ratio for c in apart if c.ratio}
    if not ratios:
        return ""
    (one, other), most = comparison.names, max(ratios, key=lambda k: abs(log(ratios[k].median)))
    return f" Most of all in {most}: {one}'s is {with_interval(ratios[most])} times {other}'s."


def _one(c: Contrast, comparison: Comparison) -> str:
    one, other = comparison.names
    values = f"{c.quantity} {written(c.first)[0]} and {written(c.second)[0]}{_unit(c.unit)}"
    ratio = "" if c.ratio is None else f", ratio {with_interval(c.ratio)}"
    region = f"{100 * comparison.region:g} %"
    answers = {
        "equal": f"the data say equal within {region} (probability {_share(c.equivalence)})",
        "greater": f"{one}'s is greater (probability {_share(c.direction)})",
        "less": f"{one}'s is less (probability {_share(1.0 - c.direction)})",
        "cannot tell": (
            f"the data cannot tell: neither different (probability of direction "
            f"{_share(max(c.direction, 1.0 - c.direction))}) nor equal within {region} "
            f"({_share(c.equivalence)})"
        ),
    }
    return f"{values} ({one}, {other}){ratio}: {answers[c.answer]}"


def _brief(c: Contrast) -> str:
    if c.ratio is None:
        return f"{c.quantity} (difference {with_interval(c.difference)}{_unit(c.unit)})"
    return f"{c.quantity} (x {with_interval(c.ratio)})"


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _share(probability: float) -> str:
    """Format per cent, never a certainty that so many draws cannot show."""
    if probability > 0.999:
        return "> 99.9 %"
    return "< 0.1 %" if probability < 0.001 else f"{100 * probability:.1f} %"


def notices(
    groups: tuple[Sequence[Side], Sequence[Side]],
    labels: tuple[str, str],
    settings: ReadingSettings,
    shared: Sequence[Reading],
    contrasts: Sequence[Contrast],
    lost: Sequence[str],
    apart: Sequence[str],
) -> Iterator[str]:
    """Yield one sentence on each limit of the comparison."""
    sides = [*groups[0], *groups[1]]
    if min(map(len, groups)) == 1:
        yield (
            "one specimen each: how much specimens of one kind differ is not known, so that this "
            "compares two pads, not what fills them"
        )
    else:
        for label, group in zip(labels, groups, strict=True):
            yield f"{label}: {len(group)} specimens ({', '.join(side.name for side in group)})"
    if apart:
        yield (
            f"the tests do not hold each other's relaxation times ({'; '.join(apart[:3])}): "
            "constants are not compared, nor what one of the tests does not show"
        )
    else:
        yield from _models(sides, shared)
    for side in sides:
        if not side.converged:
            yield f"the sampling of {side.name} did not converge"
        if side.reach and side.fitted and len(side.fitted) < side.reach.tests:
            yield (
                f"{side.name} was fitted to {', '.join(side.fitted)} of {side.reach.tests} tests: "
                "at other speeds its model predicts"
            )
    if settings.reach is None:
        yield "the tests are not known: whether a quantity lies beyond them cannot be said"
    else:
        if unknown := [side.name for side in sides if side.reach is None]:
            yield f"the tests of {', '.join(unknown)} are not known"
        yield (
            "instantaneous stiffness is that of an infinitely fast step; the quickest ramp of "
            f"these tests took {plain(settings.reach.quickest, 2)} s"
        )
        if beyond := [c.quantity for c in contrasts if c.extrapolated]:
            yield f"beyond what the tests cover: {', '.join(beyond)}"
    if lost:
        yield f"no finite value, left out: {', '.join(lost)}"


def _models(sides: Sequence[Side], shared: Sequence[Reading]) -> Iterator[str]:
    effects = {effect for side in sides for effect in side.choices.effects}
    apart = sorted(e for e in effects if not all(e in side.choices.effects for side in sides))
    for effect in apart:
        have = [side.name for side in sides if effect in side.choices.effects]
        yield (
            f"only {' and '.join(have)} was fitted with {effect}: its constants are not compared, "
            "and the other constants belong to different models"
        )
    chosen = [side.choices for side in sides]
    if len({one.relaxation for one in chosen}) > 1:
        yield "different relaxations: their constants are not compared"
    elif len({one.relaxing for one in chosen}) > 1:
        yield "different numbers of relaxation modes: c and v are not compared"
    elif len({side.relaxation for side in sides}) > 1:
        yield "different effects on the relaxation: c and v are not compared"
    if len({one.elastic for one in chosen}) > 1:
        yield "different elastic laws: their constants are not compared"
    if len({one.bonded for one in chosen}) > 1:
        yield "one is bonded and the other loose"
    if rig := sorted({effect for side in sides for effect in side.left_out}):
        yield f"of the rig, not of the pad, and left out: {', '.join(rig)}"
    if fixed := fixed_constants(sides):
        yield f"fixed, not fitted, and not compared: {', '.join(fixed)}"
    if not shared:
        yield "no constant is shared: there is no joint test"
