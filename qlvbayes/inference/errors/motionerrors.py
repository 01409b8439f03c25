r"""Errors of the force that follow from those of the motion's speed and acceleration.

An effect whose force is computed from the platen's speed or acceleration (inertia, ringing, drags,
a film) makes of each error e of a record's motion (`patherrors`) an error of the force,

.. math:: v_e = F(v + e_v, a + e_a) - F(v, a)

with the force F that it adds over a law without force. The errors are independent and of unit
variance: the block means have the additional covariance :math:`\sum_e v_e v_e^T`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.pieces import piece_of, plan_of
from qlvbayes.inference.forward.space import Space
from qlvbayes.io.arrays import Array
from qlvbayes.model.posterior import is_prior

_NOTICED = 0.2
"""Sds of the noise: an error that stays below that in every combination of block means is left
out, as it would add 4 % to one variance."""


def rated(space: Space, hypothesis: Hypothesis) -> list[AbstractEffect]:
    """Return the effects of a hypothesis whose force is computed from speed or acceleration."""
    effects = space.parameters(hypothesis).posterior.model.effects
    return [effect for effect in effects if effect.needs != "displacement"]


def motion_columns(
    space: Space, whitener: Whitener, hypothesis: Hypothesis, constants: Array
) -> Array:
    """Return errors (K, T, B) of the force (N) at constants (P,), largest first.

    They are independent and one standard deviation each; there are none where no effect needs speed
    or acceleration, or the record was made without errors of its motion. Those that the noise hides
    are left out.
    """
    real = space.real
    errors, effects = space.record.errors, rated(space, hypothesis)
    if errors is None or not effects:
        return np.zeros((0, *real.shape))
    own = space.parameters(hypothesis)
    elastic = jax.tree.structure(own.posterior.model.elastic, is_leaf=is_prior)
    forces = sum(
        _forces(space, elastic, effect, constants[own.columns[effect.name]]) for effect in effects
    )  # (T, 1 + E, N)
    nodes = np.asarray(space.record.nodes)
    found = []
    for k, force in enumerate(np.asarray(forces)):
        change = force[1:] - force[0]
        means = np.where(
            real[k], 0.5 * (change[:, nodes[k, :, 0]] + change[:, nodes[k, :, 1]]), 0.0
        )
        of_test = np.zeros((len(means), *real.shape))
        of_test[:, k] = means
        found.append(_noticed(of_test[np.any(means != 0.0, axis=1)], whitener))
    sizes = np.concatenate([size for _, size in found])
    return np.concatenate([some for some, _ in found])[np.argsort(-sizes)]


def _forces(space: Space, elastic: Any, effect: AbstractEffect, constants: Array) -> Any:
    """Return what an effect adds (T, 1 + E, N) to no force: as recorded, then with each error.

    Zero where it cannot be cut into pieces, or is computed from the material's own laws.
    """
    record, errors = space.record, space.record.errors
    assert errors is not None
    layer, motion = jax.tree.structure(effect, is_leaf=is_prior), record.motion
    tests, points = motion.time.shape
    shape = (tests, 1 + errors.velocity.shape[1], points)
    leaves, structure = jax.tree.flatten(motion)
    plan = plan_of(layer, elastic, structure)
    if plan is None or plan.uses_laws:
        return np.zeros(shape)
    loose = effect.level < Level.CONTACT and not space.bonded
    touches = (motion.displacement[:, None] > 0.0) | (not loose)
    every = replace(
        motion,
        velocity=_with_errors(motion.velocity, errors.velocity, touches),
        acceleration=_with_errors(motion.acceleration, errors.acceleration, touches),
    )
    moved = tuple(jax.tree.leaves(every))
    shared = tuple(new is old for new, old in zip(moved, leaves, strict=True))
    piece = piece_of(layer, None, structure, len(plan.requests), shared)
    answers = [jnp.zeros(shape)] * len(plan.requests)
    return piece(np.tile(constants, (shape[1], 1)), (), moved, answers)


def _with_errors(rate: Any, errors: Any, touches: Any) -> Any:
    """Return a rate (T, N) and, below it, the rate with each error (T, E, N): (T, 1 + E, N).

    It is 0 where the platen does not touch the specimen.
    """
    every = jnp.concatenate([rate[:, None], rate[:, None] + errors], axis=1)
    return jnp.where(touches, every, 0.0)


def _noticed(columns: Array, whitener: Whitener) -> tuple[Array, Array]:
    """Return the combinations of columns (K, T, B) that the noise does not hide, and their sizes.

    The covariance stays the same but for what is left out; sizes are in sds of the noise.
    """
    if not len(columns):
        return columns, np.zeros(0)
    white = whitener(columns)
    values, vectors = np.linalg.eigh(white @ white.T)
    seen = values > _NOTICED**2
    return np.einsum("ke,ktb->etb", vectors[:, seen], columns), np.sqrt(values[seen])
