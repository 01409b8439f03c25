"""The sensitivity of the tests to each effect, from the force that one prior sd of it adds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.result import Excluded, ParameterBias
from qlvbayes.diagnosis.search import Search
from qlvbayes.effects.effect import AbstractEffect, Protocol
from qlvbayes.inference.starts import shapes
from qlvbayes.io.arrays import Array

SEEN = 10.0
"""Expected 2 ln(Bayes factor) from which an effect counts as visible."""
TOO_ALIKE = "too small here, or too much like a change of the constants"
_FREE_RIDE = 0.15  # share of an effect's force that is left once the constants are refitted
_LEAST_BIAS = 0.01  # relative change of a constant from which it is reported


@dataclass(frozen=True, eq=False)
class Response:
    """The force that one prior sd of an effect adds to the baseline model, at one of its shapes."""

    effect: str
    amplitude: str
    size: float  # the prior sd of the amplitude
    # total, information: squared norm of the whitened force before and after the constants follow
    total: float
    information: float
    shift: Array  # change (F,) of the free parameters that takes the rest

    @property
    def evidence(self) -> float:
        """The expected 2 ln(Bayes factor) of the effect at this size."""
        return self.information - math.log1p(self.information)


def responses(search: Search, baseline: Candidate) -> list[Response]:
    """Return the response to each candidate effect, at the shape that shows best."""
    density, point, best = search.density, baseline.point, []
    jacobian = point.jacobian
    curvature = jacobian @ jacobian.T + point.prior.curvature
    for name in search.families.nameable:
        if name in baseline.hypothesis.effects:
            continue
        own = density.space.parameters(baseline.hypothesis.plus(name))
        amplitude = own.amplitude_of.get(name)
        if amplitude is None:
            continue
        constant, size, some = own.names[amplitude.constant], amplitude.sd, []
        starts = np.stack(shapes(density.space, point, own, name))
        added = density.space.added_forces(own.hypothesis, starts, amplitude.number, size)
        for change in np.nan_to_num(density.whitener(added)):
            shift = np.linalg.solve(curvature, jacobian @ change)
            total = float(change @ change)
            information = max(float(change @ change - (jacobian @ change) @ shift), 0.0)
            some.append(Response(name, constant, size, total, information, shift))
        best.append(max(some, key=lambda one: one.evidence))
    return best


def unseen(some: Sequence[Response], search: Search, protocol: Protocol) -> list[Excluded]:
    """Return the effects that these tests cannot show, with the reason."""
    return [
        Excluded(
            one.effect,
            type(search.density.space.effects[one.effect]).blind(protocol)
            or f"{TOO_ALIKE} (2 ln Bayes factor {one.evidence:.1f} expected at 5 % of the peak "
            "force)",
        )
        for one in some
        if one.evidence < SEEN
    ]


def unmeasured(kinds: Iterable[type[AbstractEffect]], protocol: Protocol) -> list[Excluded]:
    """Return effects of a velocity or acceleration that displacement records do not give."""
    reasons = {kind.name: kind.unmeasured(protocol) for kind in kinds}
    return [Excluded(name, reason) for name, reason in reasons.items() if reason is not None]


def parameter_biases(some: Sequence[Response], baseline: Candidate) -> list[ParameterBias]:
    """Return the effects of which the constants take nearly all, with each constant's change."""
    point, biases = baseline.point, []
    for one in some:
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
            biases.append(ParameterBias(one.effect, one.amplitude, one.size, left, changes, seen))
    return biases
