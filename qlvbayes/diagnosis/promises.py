"""What one effect more promises beside a hypothesis, before it is optimised.

To first order about a mode, and by a few steps of a fit under coarse noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.weighed import Weighed, weigh
from qlvbayes.inference.density import Density, Extension, Point
from qlvbayes.inference.extending import amplitude_of, shapes
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import Mode, rough_mode
from qlvbayes.inference.score import promised_evidence

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Promise:
    """An effect more at a mode, and what the evidence with it promises to be."""

    point: Point
    added: Extension
    log_evidence: float

    @property
    def hypothesis(self) -> Hypothesis:
        """The one with the effect."""
        return self.added.own.hypothesis


def promised(
    density: Density, known: Sequence[Weighed], names: Sequence[str], followed: int
) -> list[Promise]:
    """Of each of some effects more the places that promise most, at a hypothesis' modes.

    Parameters
    ----------
    known
        The hypothesis at its modes, the likeliest first.
    followed
        Places kept of an effect.
    """
    found: dict[Hypothesis, list[Promise]] = {}
    for order, one in enumerate(known):
        for promise in _promised_at(density, one, names, order == 0):
            found.setdefault(promise.hypothesis, []).append(promise)
    best = [sorted(same, key=_order)[:followed] for same in found.values()]
    return sorted((one for some in best for one in some), key=_order)


def screened(
    density: Density, known: Weighed, names: Sequence[str], tolerance: float
) -> list[Mode]:
    """Of effects more those with which a hypothesis follows the data better, the best first.

    Under coarse noise and without a discrepancy: beside one, what it can stand for moves nothing.
    """
    mode = rough_mode(density, known.hypothesis, known.point.theta)
    if mode is None:
        return []
    plain = weigh(density.coarse, known.hypothesis, mode, tolerance)
    likeliest: dict[Hypothesis, Promise] = {}
    for one in sorted(_promised_at(density.coarse, plain, names, True), key=_order):
        likeliest.setdefault(one.hypothesis, one)
    found: list[Mode] = []
    for hypothesis, one in likeliest.items():
        start = density.coarse.extended(one.point, one.added)
        if start is None:
            continue
        least = min((other.loss for other in found), default=math.inf)
        better = rough_mode(density, hypothesis, start, least)
        found += [better] if better is not None and better.loss < mode.loss else []
    return sorted(found, key=lambda one: one.loss)


def _promised_at(
    density: Density, found: Weighed, names: Sequence[str], whole: bool
) -> list[Promise]:
    """Each of some effects more at a mode; whole: over all of its first shape's prior.

    Not those that a record cannot show: with them the evidence is the same.
    """
    several = [one for name in names if (one := _at_nothing(density, found, name, whole))]
    added = density.extensions(found.point, several) if several else []
    added = [one for one in added if one.is_visible]
    if not added:
        return []
    logs = promised_evidence(density, found.point, found.evidence.by_size, added)
    return [Promise(found.point, part, log) for part, log in zip(added, logs.tolist(), strict=True)]


def _at_nothing(
    density: Density, found: Weighed, effect: str, whole: bool
) -> tuple[Hypothesis, int, list[Array]] | None:
    """A mode with an effect more, its amplitude's place, and thetas with it at nothing."""
    hypothesis = found.hypothesis.plus(effect)
    own = density.space.parameters(hypothesis)
    amplitude = amplitude_of(own, effect)
    if amplitude is None:
        return None
    starts = shapes(density.space, found.point, own, effect)
    some = starts if whole else starts[len(starts) // 2 :][:1]
    return hypothesis, amplitude.number, some


def _order(one: Promise) -> float:
    return -one.log_evidence
