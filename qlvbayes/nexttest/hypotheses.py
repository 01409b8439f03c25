"""Explanations from a diagnosis: a hypothesis about its mode, normal as far as it bends."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.space import Hypothesis, Space
from qlvbayes.nexttest.belief import Explanation
from qlvbayes.parameters import unit_kinds
from qlvbayes.records.record import Record

Array = NDArray[np.float64]


def explanation_of_mode(
    space: Space,
    hypothesis: Hypothesis,
    theta: Array,
    covariance: Array,
    probability: float,
    words: str,
) -> Explanation:
    """A hypothesis whose free numbers are normal about theta (F,); bounds are kept to."""
    own = space.parameters(hypothesis)
    root = _root(covariance)

    def constants(z: Array) -> Array:
        return own.constants(own.within(theta + z @ root.T))

    def run(rows: Array, record: Record) -> Array:
        return space.forces(hypothesis, rows, record)

    centre = own.constants(theta[None])[0]
    model = own.posterior.with_constants(jnp.asarray(centre))[0]
    fractions, rates = model.relaxation.spectrum()
    # the noise's constants come last and are fixed
    kept = len(own.names) - len(own.posterior.noise.units)
    return Explanation(
        words,
        probability,
        root.shape[1],
        tuple(own.names[:kept]),
        tuple(unit_kinds(own.posterior)[:kept]),
        lambda z: constants(z)[:, :kept],
        lambda rows, record: run(_with(rows, own.fixed[kept:]), record),
        np.asarray(fractions)[1:],
        np.asarray(rates),
    )


def _with(rows: Array, others: Array) -> Array:
    return np.concatenate([rows, np.tile(others, (len(rows), 1))], axis=1)


def _root(covariance: Array) -> Array:
    """(F, F) with root root^T = covariance."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
