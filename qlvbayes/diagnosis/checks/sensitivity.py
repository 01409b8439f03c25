"""What this protocol can see: before any ranking, from what one prior sd of an effect would add."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.result import ParameterBias, Unseen
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.weighed import Weighed
from qlvbayes.effects.effect import AbstractEffect, Protocol
from qlvbayes.inference.forward.hypothesis import Parameters
from qlvbayes.inference.starts import Amplitude, amplitude_of, shapes

Array = NDArray[np.float64]

SEEN = 10.0  # expected 2 ln(Bayes factor) from which an effect counts as visible
TOO_ALIKE = "too small here, or too much like a change of the constants"
_FREE_RIDE = 0.15  # share of an effect's force that is left once the constants are refitted
_LEAST_BIAS = 0.01  # relative change of a constant that is worth a word
_COINCIDE = 0.98  # correlation of what two effects leave


@dataclass(frozen=True, eq=False)
class Response:
    """What an effect of one prior sd adds to the plain model's force, at one of its shapes.

    amplitude, size: its name and that sd; left (n,): whitened, less what the constants take;
    total, information: squares of it before and after; shift (F,): by which the constants' numbers
    take it.
    """

    effect: str
    amplitude: str
    size: float
    left: Array
    total: float
    information: float
    shift: Array

    @property
    def evidence(self) -> float:
        """Expected 2 ln(Bayes factor) of the effect at this size."""
        return self.information - math.log1p(self.information)


def responses(search: Search, plain: Weighed) -> list[Response]:
    """Of every candidate, at the shape that shows best."""
    found = []
    for name in search.families.listed:
        if name in plain.hypothesis.effects:
            continue
        hypothesis = plain.hypothesis.plus(name)
        own = search.density.space.parameters(hypothesis)
        amplitude = amplitude_of(own, name)
        if amplitude is not None:
            starts = shapes(search.density.space, plain.point, own, name)
            some = [_response(search, plain, own, name, amplitude, start) for start in starts]
            found.append(max(some, key=lambda one: one.evidence))
    return found


def _response(
    search: Search,
    plain: Weighed,
    own: Parameters,
    name: str,
    amplitude: Amplitude,
    start: Array,
) -> Response:
    density, size = search.density, amplitude.sd
    force = density.space.added_force(own.hypothesis, start, amplitude.number, size)
    change = np.nan_to_num(density.whitener(force[None])[0])
    jacobian, prior = plain.point.jacobian, plain.point.prior.curvature
    shift = np.linalg.solve(jacobian @ jacobian.T + prior, jacobian @ change)
    left = change - shift @ jacobian
    information = max(float(change @ change - (jacobian @ change) @ shift), 0.0)
    total = float(change @ change)
    return Response(name, own.names[amplitude.constant], size, left, total, information, shift)


def unseen(found: Sequence[Response], search: Search, protocol: Protocol) -> list[Unseen]:
    """Effects whose expected evidence at a plausible size is below 10 at every shape, and why."""
    return [
        Unseen(
            one.effect,
            type(search.density.space.effects[one.effect]).blind(protocol)
            or f"{TOO_ALIKE} (2 ln Bayes factor {one.evidence:.1f} expected at 5 % of the peak "
            "force)",
        )
        for one in found
        if one.evidence < SEEN
    ]


def unmeasured(kinds: Iterable[type[AbstractEffect]], protocol: Protocol) -> list[Unseen]:
    """Effects made of a velocity or an acceleration that the displacement records do not give.

    They are not tried: what is fitted in their place is the records' error.
    """
    reasons = {kind.name: kind.unmeasured(protocol) for kind in kinds}
    return [Unseen(name, reason) for name, reason in reasons.items() if reason is not None]


def parameter_biases(found: Sequence[Response], plain: Weighed) -> list[ParameterBias]:
    """Effects of which the constants take nearly all, and what that would do to each constant."""
    point, some = plain.point, []
    for one in found:
        if one.total <= 0.0 or one.information <= 0.0:
            continue
        left = math.sqrt(one.information / one.total)
        if left > _FREE_RIDE:
            continue
        change = point.slopes @ one.shift
        changes = {
            name: float(delta / value)
            for name, delta, value in zip(point.own.names, change, point.constants, strict=True)
            if not name.startswith("noise.") and value and abs(delta / value) > _LEAST_BIAS
        }
        if changes:
            seen = one.evidence >= SEEN
            some.append(ParameterBias(one.effect, one.amplitude, one.size, left, changes, seen))
    return some


def coincident(found: Sequence[Response]) -> list[tuple[str, ...]]:
    """Groups of effects whose visible parts have the same shape (correlation above 0.98)."""
    some = [one for one in found if one.information > 0.0]
    if len(some) < 2:
        return []
    left = np.stack([one.left / np.linalg.norm(one.left) for one in some])
    alike = np.abs(left @ left.T) > _COINCIDE
    groups: list[tuple[str, ...]] = []
    taken: set[str] = set()
    for row in alike:
        members = tuple(one.effect for one, same in zip(some, row, strict=True) if same)
        if len(members) > 1 and not taken & set(members):
            groups.append(members)
            taken |= set(members)
    return groups
