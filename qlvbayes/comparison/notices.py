"""What a reader of a comparison must know: what was left out, and what reaches beyond the tests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from qlvbayes.comparison.contrast import Contrast
from qlvbayes.comparison.readings import Reading
from qlvbayes.comparison.settings import Settings
from qlvbayes.comparison.side import Side, fixed_constants


def notices(
    groups: tuple[Sequence[Side], Sequence[Side]],
    labels: tuple[str, str],
    settings: Settings,
    shared: Sequence[Reading],
    contrasts: Sequence[Contrast],
    lost: Sequence[str],
) -> Iterator[str]:
    """One sentence each."""
    sides = [*groups[0], *groups[1]]
    yield from _specimens(groups, labels)
    yield from _models(sides, shared)
    yield from _fits(sides)
    yield from _reach(sides, settings, contrasts)
    if lost:
        yield f"no finite value, left out: {', '.join(lost)}"


def _specimens(
    groups: tuple[Sequence[Side], Sequence[Side]], labels: tuple[str, str]
) -> Iterator[str]:
    if min(map(len, groups)) == 1:
        yield (
            "one specimen each: how much specimens of one kind differ is not known, so that this "
            "compares two pads, not what fills them"
        )
        return
    for label, group in zip(labels, groups, strict=True):
        yield f"{label}: {len(group)} specimens ({', '.join(side.name for side in group)})"


def _models(sides: Sequence[Side], shared: Sequence[Reading]) -> Iterator[str]:
    effects = {effect for side in sides for effect in side.choices.effects}
    apart = sorted(e for e in effects if not all(e in side.choices.effects for side in sides))
    for effect in apart:
        have = [side.name for side in sides if effect in side.choices.effects]
        yield (
            f"only {' and '.join(have)} was fitted with {effect}: its constants are not compared, "
            "and the other constants belong to different models"
        )
    if len({side.choices.relaxation for side in sides}) > 1:
        yield "different relaxations: their constants are not compared"
    elif len({side.choices.relaxing for side in sides}) > 1:
        yield "different numbers of relaxation modes: c and v are not compared"
    if len({side.choices.law for side in sides}) > 1:
        yield "different elastic laws: their constants are not compared"
    if len({side.choices.bonded for side in sides}) > 1:
        yield "one is bonded and the other loose"
    if rig := sorted({effect for side in sides for effect in side.left_out}):
        yield f"of the rig, not of the pad, and left out: {', '.join(rig)}"
    if fixed := fixed_constants(sides):
        yield f"fixed, not fitted, and not compared: {', '.join(fixed)}"
    if not shared:
        yield "no constant is shared: there is no joint test"


def _fits(sides: Sequence[Side]) -> Iterator[str]:
    for side in sides:
        if not side.converged:
            yield f"the sampling of {side.name} did not converge"
        if side.reach and side.fitted and len(side.fitted) < side.reach.tests:
            yield (
                f"{side.name} was fitted to {', '.join(side.fitted)} of {side.reach.tests} tests: "
                "at other speeds its model predicts"
            )


def _reach(
    sides: Sequence[Side], settings: Settings, contrasts: Sequence[Contrast]
) -> Iterator[str]:
    if not settings.known:
        yield "the tests are not known: whether a quantity lies beyond them cannot be said"
        return
    unknown = [side.name for side in sides if side.reach is None]
    if unknown:
        yield f"the tests of {', '.join(unknown)} are not known"
    yield (
        "instantaneous stiffness is that of an infinitely fast step; the quickest ramp of these "
        f"tests took {settings.reach.quickest:.2g} s"
    )
    if beyond := [c.quantity for c in contrasts if c.extrapolated]:
        yield f"beyond what the tests cover: {', '.join(beyond)}"
