r"""Propose terms of a described law by what they would explain, before anything is fitted.

Each term's force at a handful of its shapes, projected on what the constants at a mode can follow
and weighted by the noise, is a column. With g and C the gradient and curvature
that `Point.added_terms` gives for the amplitude k of a column, in sds of its prior, the term
explains (the slab of a spike and slab; George & McCulloch 1993, doi:10.1080/01621459.1993.10476353)

.. math:: \ln B = \frac{g^2}{2 (C + 1)} - \tfrac12 \ln(1 + C)

more than none. A second term is proposed in the same way beside the first one as it was fitted:
there are few enough terms to look at each, and no chain over sets of them is needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.description.grammar import Term
from qlvbayes.inference.density import Density
from qlvbayes.inference.modes import Mode
from qlvbayes.inference.starts import added_forces, amplitude_of, over_shapes, transferred
from qlvbayes.io.arrays import Array

_SAME = 0.9999
"""Cosine of two columns from which they are one: off the pad nothing was measured, say."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A term at the shape and amplitude at which it explains most."""

    term: Term
    shape: Array  # (S,): the term's constants other than the amplitude, as parameters
    amplitude: float
    squares: float  # by which it reduces the sum of squares of the whitened residual


def proposals(
    density: Density, base: Mode, names: Mapping[Term, str], shapes: int
) -> list[Proposal]:
    """Return the terms at their best shapes, those that explain most first.

    A space has the terms' effects by ``names``; each is tried at so many quantiles of its shape's
    prior.
    """
    columns = [
        (term, *column)
        for term, name in names.items()
        for column in _columns(density, base, name, shapes)
    ]
    if not columns:
        return []
    terms, own_shapes, sds, forces = zip(*columns, strict=True)
    sized = density.discrepancy.at(base.size, base.point.separation)
    _, gradient, curvature = base.point.added_terms(density.whitener(np.stack(forces)), sized)
    own = np.maximum(np.diag(curvature), np.finfo(float).tiny)
    sizes = -gradient / (own + 1.0)
    gains = -0.5 * gradient * sizes - 0.5 * np.log1p(own)
    alike = np.abs(curvature) / np.sqrt(np.outer(own, own))
    kept: list[int] = []
    for k in np.argsort(-gains, kind="stable").tolist():
        known = any(terms[j] == terms[k] or alike[j, k] > _SAME for j in kept)
        if not known and (terms[k].signed or sizes[k] > 0.0):
            kept.append(k)
    squares = gradient**2 / own
    return [
        Proposal(terms[k], own_shapes[k], float(sizes[k]) * sds[k], float(squares[k])) for k in kept
    ]


def _columns(
    density: Density, base: Mode, name: str, shapes: int
) -> list[tuple[Array, float, Array]]:
    """Return the shapes of one term, the sd of its amplitude's prior, and block means (T, B) there.

    These forces are at one sd of the amplitude; shapes that add no finite force are left out.
    """
    space = density.space
    parameters = space.parameters(base.point.own.hypothesis.plus(name))
    amplitude = amplitude_of(parameters, name)
    assert amplitude is not None
    theta = transferred(base.point.own, base.point.theta, parameters)
    none = np.stack(over_shapes(space, parameters, name, theta, shapes))
    some = none.copy()
    some[:, amplitude.number] += amplitude.sd
    own = [
        k
        for key, leaf in parameters.by_name.items()
        if key.startswith(f"{name}.") and leaf.theta.start != amplitude.number
        for k in leaf.theta
    ]
    forces = np.where(space.real, added_forces(space, parameters, none, some), 0.0)
    return [
        (start[own], amplitude.sd, force)
        for start, force in zip(none, forces, strict=True)
        if np.isfinite(force).all() and np.any(force)
    ]
