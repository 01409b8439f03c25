"""Tests of different lengths as one batch, padded to sizes that many pads share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.preprocess.record import Blocks, Record, held

_LEAST = 32  # points or blocks


def batch(records: Sequence[Record], like: Record | None = None) -> Record:
    """Records along a leading axis; the grid's last point and masked blocks fill them up.

    like: a batch whose sizes are taken where they are large enough.
    """
    points = padded_size(max(r.motion.time.shape[0] for r in records))
    blocks = padded_size(max(r.blocks.force.shape[0] for r in records))
    if like is not None:
        points = max(points, like.motion.time.shape[-1])
        blocks = max(blocks, like.blocks.force.shape[-1])
    known = (*records, *([like] if like else []))
    for field, dtype in (("ago", int), ("bow", float)):
        if any(getattr(r.motion, field) is not None for r in known):
            records = [told(record, field, dtype) for record in records]
    padded = [_pad(record, points, blocks) for record in records]
    return jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *padded)


def padded_size(size: int) -> int:
    """Of so many points or blocks: up to a power of two or three quarters of one.

    Pads of few sizes share what is compiled: compiling for a size of its own takes longer than
    most pads' evaluations.
    """
    whole = max(_LEAST, 1 << (size - 1).bit_length())
    return 3 * whole // 4 if size <= 3 * whole // 4 and whole > _LEAST else whole


def _pad(record: Record, points: int, blocks: int) -> Record:
    seen = record.motion
    motion = jax.tree.map(lambda leaf: _extend(leaf, points) if leaf.ndim else leaf, seen)
    size = record.blocks.force.shape[0]
    full = Blocks(*(_extend(x, blocks) for x in jax.tree.leaves(record.blocks)))
    real = np.arange(blocks) < size
    # one sample, of no duration: the noise model's closed forms stay finite in padding
    count = held(np.where(real, full.count, 1.0))
    single = replace(full, count=count, real=held(real))
    return Record(motion, _extend(record.nodes, blocks), single)


def told(record: Record, field: str, dtype: type) -> Record:
    """The record, with zeros for a field of its motion that is None: others have it."""
    motion = record.motion
    if getattr(motion, field) is not None:
        return record
    zeros = held(np.zeros(motion.time.shape, dtype))
    return replace(record, motion=replace(motion, **{field: zeros}))


def _extend(values: Array, size: int) -> Array:
    missing = [(0, size - values.shape[0])] + [(0, 0)] * (values.ndim - 1)
    return held(np.pad(np.asarray(values), missing, mode="edge"))
