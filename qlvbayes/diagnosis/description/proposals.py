r"""Propose terms of a described law by what they would explain, before anything is fitted.

Each term's force at a handful of its shapes, projected on what the constants at a mode can follow
and weighted by noise and discrepancy there, is a column. With g and C the gradient and curvature
that `Point.added_terms` gives for the amplitude k of a column, in sds of its prior, the term
explains (the slab of a spike and slab; George & McCulloch 1993, doi:10.1080/01621459.1993.10476353)

.. math:: \ln B = \frac{g^2}{2 (C + 1)} - \tfrac12 \ln(1 + C)

more than none. A second term is proposed in the same way beside the first one as it was fitted:
there are few enough terms to look at each, and no chain over sets of them is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
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
class Column:
    """The force of a term at one of its shapes."""

    term: Term
    shape: Array  # (S,): the term's constants other than the amplitude, as parameters
    sd: float  # of the amplitude's prior
    force: Array  # (T, B): block means (N) at one sd


@dataclass(frozen=True)
class Proposal:
    """A term at the shape and amplitude at which it explains most."""

    column: Column
    size: float  # the amplitude, in sds of its prior
    gain: float  # ln B
    squares: float  # by which it reduces the sum of squares of the whitened residual


def columns_of(
    density: Density,
    base: Mode,
    terms: Sequence[Term],
    names: Sequence[str],
    shapes: int,
) -> list[Column]:
    """Return the columns of terms, whose effects a space has by ``names``; none without force."""
    space, found = density.space, []
    for term, name in zip(terms, names, strict=True):
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
        for start, added in zip(none, added_forces(space, parameters, none, some), strict=True):
            added = np.where(space.real, added, 0.0)
            if np.isfinite(added).all() and np.any(added):
                found.append(Column(term, start[own], amplitude.sd, added))
    return found


def proposals(
    density: Density, base: Mode, columns: Sequence[Column], present: Sequence[Term] = ()
) -> list[Proposal]:
    """Return the terms at their best shapes, those that explain most first.

    The terms can be in one law with those that are ``present`` already.
    """
    fitting = [c for c in columns if all(c.term.joins(one) for one in present)]
    fitting = [c for c in fitting if c.term.name not in {one.name for one in present}]
    if not fitting:
        return []
    point = base.point
    sized = density.discrepancy.at(base.size, point.separation)
    forces = density.whitener(np.stack([column.force for column in fitting]))
    gradient, curvature = point.added_terms(forces, sized)
    own = np.maximum(np.diag(curvature), np.finfo(float).tiny)
    sizes = -gradient / (own + 1.0)
    gains = -0.5 * gradient * sizes - 0.5 * np.log1p(own)
    alike = np.abs(curvature) / np.sqrt(np.outer(own, own))
    kept: list[int] = []
    for k in np.argsort(-gains, kind="stable").tolist():
        term = fitting[k].term
        known = any(fitting[j].term.name == term.name or alike[j, k] > _SAME for j in kept)
        if not known and (term.signed or sizes[k] > 0.0):
            kept.append(k)
    figures = np.column_stack([sizes, gains, gradient**2 / own])
    return [Proposal(fitting[k], *figures[k].tolist()) for k in kept]
