r"""Errors of the force that follow from those of the motion's speed and acceleration.

An effect whose force is computed from the platen's speed or acceleration (inertia, ringing, drags,
a film) makes of each error e of a record's motion (`patherrors`) an error of the force,

.. math:: v_e = F(v + e_v, a + e_a) - F(v, a)

with the force F that it adds over a law without force. The errors are independent and of unit
variance: the block means have the additional covariance :math:`\sum_e v_e v_e^T`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import numpy as np

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space
from qlvbayes.io.arrays import Array
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.layered import Law
from qlvbayes.laws.relaxation.prony import Spectrum
from qlvbayes.model.parameters import filled

_NOTICED = 0.2
"""Sds of the noise: an error that stays below that in every combination of block means is left
out, as it would add 4 % to one variance."""


def rated(space: Space, hypothesis: Hypothesis) -> list[AbstractEffect]:
    """Return the effects of a hypothesis whose force is computed from speed or acceleration."""
    effects = space.parameters(hypothesis).model.effects
    return [effect for effect in effects if effect.needs != "displacement"]


def motion_columns(
    space: Space, whitener: Whitener, hypothesis: Hypothesis, constants: Array
) -> Array:
    """Return errors (K, T, B) of the force (N) at constants (P,), largest first."""
    real = space.real
    errors, effects = space.record.errors, rated(space, hypothesis)
    if errors is None or not effects:
        return np.zeros((0, *real.shape))
    own = space.parameters(hypothesis)
    added = [_forces(space, filled(one, constants[own.columns[one.name]])) for one in effects]
    forces = np.sum(added, axis=0)
    nodes = np.asarray(space.record.nodes)
    found = []
    for k, force in enumerate(np.moveaxis(forces, 1, 0)):  # (N, 1 + E)
        kept = whitener.blocks[k]
        change = (force[:, 1:] - force[:, :1])[nodes[k, kept]].mean(axis=1).T
        moved = change[np.any(change != 0.0, axis=1)]
        seen, sizes = _noticed(moved, partial(whitener.whiten_test, k))
        columns = np.zeros((len(seen), *real.shape))
        columns[:, k, kept] = seen
        found.append((columns, sizes))
    order = np.argsort(-np.concatenate([sizes for _, sizes in found]))
    return np.concatenate([columns for columns, _ in found])[order]


def _forces(space: Space, effect: AbstractEffect) -> Array:
    """Return what an effect adds (N, T, 1 + E) to no force: as recorded, then with each error."""
    record = space.record
    assert record.errors is not None
    motion = jax.tree.map(_by_time, record.motion)
    loose = effect.level < Level.CONTACT and not space.bonded
    touches = (motion.displacement > 0.0) | (not loose)
    every = replace(
        motion,
        velocity=_with_errors(motion.velocity, record.errors.velocity, touches),
        acceleration=_with_errors(motion.acceleration, record.errors.acceleration, touches),
    )
    with np.errstate(all="ignore"):
        force = Law(Linear(0.0), Spectrum(np.ones(1), np.zeros(0)), (effect,)).force(every)
    return np.asarray(np.broadcast_to(force, every.velocity.shape))


def _by_time(leaf: Any) -> Array:
    """Return values (T, N) as (N, T, 1), and values of whole tests (T,) as (T, 1)."""
    return np.asarray(leaf).T[..., None]


def _with_errors(rate: Array, errors: Any, touches: Array) -> Array:
    """Return a rate (N, T, 1) and, after it, the rate with each error (T, E, N): (N, T, 1 + E)."""
    every = np.concatenate([rate, rate + np.asarray(errors).transpose(2, 0, 1)], axis=2)
    return np.where(touches, every, 0.0)


def _noticed(columns: Array, whiten: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return combinations of columns (K, n) that the noise does not hide, and their sizes."""
    if not len(columns):
        return columns, np.zeros(0)
    white = whiten(columns)
    values, vectors = np.linalg.eigh(white @ white.T)
    seen = values > _NOTICED**2
    return vectors[:, seen].T @ columns, np.sqrt(values[seen])
