"""The explanation from a fit: its model, with a normal distribution of the posterior's moments."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Array as JaxArray

from qlvbayes.diagnosis.nexttest.belief import Explanation
from qlvbayes.inference.forward.hypothesis import filled_up
from qlvbayes.io.arrays import Array
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import described_model, drawn_models
from qlvbayes.model.model import Model
from qlvbayes.model.parameters import fields_of
from qlvbayes.motion.record import Record

_CONSTANT = 1e-12  # of the largest variance, below which nothing varies in a direction
_TOGETHER = 4  # draws that are run at once; their number is filled up to a multiple
_FRACTIONS = "c["  # prefix of the constants that sum to one


def explanation_of_draws(
    choices: Choices, names: Sequence[str], draws: Array, depth: float
) -> Explanation:
    """Return the explanation from draws (n, P) of a fit; ``depth`` (mm) is the largest."""
    model = described_model(choices, depth)
    fields = list(fields_of(model))
    own = [name for field in fields for name in field.names]
    values = np.stack([draws[:, list(names).index(name)] for name in own], axis=1)
    in_log = np.all(values > 0.0, axis=0)
    scaled = np.where(in_log, np.log(np.where(in_log, values, 1.0)), values)
    mean, root = scaled.mean(axis=0), _root(np.atleast_2d(np.cov(scaled.T)))
    shares = np.array([name.startswith(_FRACTIONS) for name in own])
    sums = bool(shares.any()) and np.allclose(values[:, shares].sum(axis=1), 1.0)

    def constants(z: Array) -> Array:
        rows = mean + z @ root.T
        rows[:, in_log] = np.exp(rows[:, in_log])
        if sums:
            rows[:, shares] /= rows[:, shares].sum(axis=1, keepdims=True)
        return rows

    def run(rows: Array, record: Record) -> Array:
        full = filled_up(rows, _TOGETHER)
        parts = [drawn_models(model, own, full[k : k + _TOGETHER])
                 for k in range(0, len(full), _TOGETHER)]  # fmt: skip
        return np.concatenate([np.asarray(_forces(part, record)) for part in parts])[: len(rows)]

    whole = drawn_models(model, own, constants(np.zeros((1, root.shape[1]))))
    fractions, rates = jax.vmap(lambda one: one.relaxation.spectrum())(whole)
    words = " + ".join((choices.elastic, choices.relaxing, *choices.effects))
    return Explanation(
        words,
        1.0,
        root.shape[1],
        tuple(own),
        tuple(field.unit for field in fields for _ in field.names),
        constants,
        run,
        np.asarray(fractions)[0, 1:],
        np.asarray(rates)[0],
    )


def _root(covariance: Array) -> Array:
    """Return a root (P, F) of a covariance (P, P), without directions in which nothing varies."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _CONSTANT * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


@jax.jit
def _forces(models: Model, record: Record) -> JaxArray:
    """Return the block means (K, T, B) of the force (N) of K models in T tests."""

    def one(model: Model) -> JaxArray:
        return jax.vmap(lambda test: test.average(model.force(test.motion)))(record)

    return jax.vmap(one)(models)
