"""A test as the likelihood sees it, block averages and motion, and several tests as one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, cast

import jax
import numpy as np
from jaxtyping import Array

from qlvbayes.laws.motion import Motion
from qlvbayes.pytree import Pytree

_LEAST = 32  # points or blocks

held = cast("Callable[[Any], Array]", np.asarray)
"""Arrays of one test stay numpy's: JAX would compile a copy for every length."""


class Blocks(Pytree):
    """Averages over runs of consecutive samples; every field has shape (B,)."""

    force: Array  # mean of the samples (N)
    count: Array  # how many
    # first, last: times of the first and the last (s)
    first: Array
    last: Array
    # measured sd of the samples over its root mean square in the pad (1 where none was measured)
    weight: Array
    scale: Array  # sd of all noise at the block's force over the one at the floor's level
    extra: Array  # sd (N) of the error that the motion's makes, one a block
    # sd (N) of what is not known of the moments (`timing`), independent from block to block
    timing: Array
    # change of the force (N) for one standard error of the test's zero of displacement, common to
    # all its blocks, 0 where the zero is taken as exact
    zero: Array
    stage: Array  # the same where the error is common to all tests of a stage
    tare: Array  # sd (N) of the zero of the test's force, common to all its blocks
    real: Array  # False for padding

    @property
    def contact(self) -> Array:
        """Return the change of the force (N) for one standard error of the contact, of any kind.

        A test has one kind of contact, so that the other's change is 0.
        """
        return held(np.asarray(self.zero) + np.asarray(self.stage))

    @classmethod
    def of_means(
        cls,
        force: np.ndarray,
        count: np.ndarray,
        first: np.ndarray,
        last: np.ndarray,
        weight: np.ndarray | None = None,
    ) -> Blocks:
        """Make blocks that have no errors but the noise of their samples, and no padding."""
        one, none = np.ones(count.shape), np.zeros(count.shape)
        fields = {"force": force, "count": count, "first": first, "last": last, "scale": one}
        fields |= {"weight": one if weight is None else weight, "real": one > 0.0}
        fields |= dict.fromkeys(("extra", "timing", "zero", "stage", "tare"), none)
        return cls(**{name: held(values) for name, values in fields.items()})


class RateErrors(Pytree):
    """Errors of a motion's velocity and acceleration, (E, N) each, on the grid of a record."""

    velocity: Array
    acceleration: Array


class Record(Pytree):
    """A test (or, with a leading axis, several padded to one size)."""

    motion: Motion  # on the grid (N,)
    nodes: Array  # (B, 2) indices on the grid whose forces average to the block's mean
    blocks: Blocks  # (B,)
    # of the motion's velocity and acceleration, where they were asked for
    errors: RateErrors | None = None

    def average(self, force: Array) -> Array:
        """Return the block means (B,) of a force (N,) on the grid."""
        return 0.5 * (force[self.nodes[:, 0]] + force[self.nodes[:, 1]])


def batch(records: Sequence[Record], like: Record | None = None) -> Record:
    """Stack records along a leading axis; the last grid point and masked blocks pad them."""
    points = padded_size(max(r.motion.time.shape[0] for r in records))
    blocks = padded_size(max(r.blocks.force.shape[0] for r in records))
    if like is not None:
        points = max(points, like.motion.time.shape[-1])
        blocks = max(blocks, like.blocks.force.shape[-1])
    known = (*records, *([like] if like else []))
    for field, dtype in (("ago", int), ("sagitta", float)):
        if any(getattr(r.motion, field) is not None for r in known):
            records = [with_zeros(record, field, dtype) for record in records]
    records = _with_as_many_errors(records)
    padded = [_pad(record, points, blocks) for record in records]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *padded)


def forgetting(record: Record) -> Record:
    """Return a batch, of the same shape, with every test begun at rest."""

    def alone(motion: Motion) -> Motion:
        return replace(motion.alone, ago=motion.ago)

    motion = jax.vmap(alone)(jax.tree.map(jax.numpy.asarray, record.motion))
    return Record(motion, record.nodes, record.blocks)


def padded_size(size: int) -> int:
    """Return the next size that is a power of two or three quarters of one."""
    whole = max(_LEAST, 1 << (size - 1).bit_length())
    return 3 * whole // 4 if size <= 3 * whole // 4 and whole > _LEAST else whole


def _pad(record: Record, points: int, blocks: int) -> Record:
    seen = record.motion
    motion = jax.tree.map(lambda leaf: extended(leaf, points) if leaf.ndim else leaf, seen)
    size = record.blocks.force.shape[0]
    full = jax.tree.map(lambda leaf: extended(leaf, blocks), record.blocks)
    real = np.arange(blocks) < size
    # one sample, of no duration: the noise model's closed forms stay finite in padding
    count = held(np.where(real, full.count, 1.0))
    single = replace(full, count=count, real=held(real))
    errors = jax.tree.map(lambda rows: held(extended(rows.T, points).T), record.errors)
    return Record(motion, extended(record.nodes, blocks), single, errors)


def _with_as_many_errors(records: Sequence[Record]) -> Sequence[Record]:
    """Return records that have equally many errors, of zeros where there are none."""
    known = [record.errors for record in records if record.errors is not None]
    if not known:
        return records
    count = padded_size(max(errors.velocity.shape[0] for errors in known))
    filled = []
    for record in records:
        zeros = np.zeros((count, record.motion.time.shape[0]))
        own = record.errors or RateErrors(held(zeros[:0]), held(zeros[:0]))
        rows = jax.tree.map(lambda x, zeros=zeros: np.concatenate([x, zeros[len(x) :]]), own)
        filled.append(replace(record, errors=rows))
    return filled


def with_zeros(record: Record, field: str, dtype: type) -> Record:
    """Return the record with zeros for a field of its motion that is None."""
    motion = record.motion
    if getattr(motion, field) is not None:
        return record
    zeros = held(np.zeros(motion.time.shape, dtype))
    return replace(record, motion=replace(motion, **{field: zeros}))


def extended(values: Array | np.ndarray, size: int) -> Array:
    """Return values padded along their first axis to a length with their last one."""
    missing = [(0, size - values.shape[0])] + [(0, 0)] * (values.ndim - 1)
    return held(np.pad(np.asarray(values), missing, mode="edge"))
