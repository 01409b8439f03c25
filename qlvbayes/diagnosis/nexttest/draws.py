"""The explanation from a fit: its model, with a normal distribution of the posterior's moments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.diagnosis.nexttest.belief import Explanation
from qlvbayes.inference.forward.forces import Forces
from qlvbayes.io.arrays import Array
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import described_model
from qlvbayes.model.parameters import fields_of, filled
from qlvbayes.motion.record import Record

_CONSTANT = 1e-12  # of the largest variance, below which nothing varies in a direction
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

    forces = Forces()

    def run(rows: Array, record: Record) -> Array:
        return forces.over(filled(model, rows.T), len(rows), record)

    whole = filled(model, constants(np.zeros((1, root.shape[1])))[0])
    fractions, rates = whole.relaxation.spectrum()
    words = " + ".join((choices.elastic, choices.relaxing, *choices.effects))
    return Explanation(
        words,
        1.0,
        root.shape[1],
        tuple(own),
        tuple(field.unit for field in fields for _ in field.names),
        constants,
        run,
        np.asarray(fractions)[1:],
        np.asarray(rates),
    )


def _root(covariance: Array) -> Array:
    """Return a root (P, F) of a covariance (P, P), without directions in which nothing varies."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _CONSTANT * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))
