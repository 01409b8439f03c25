"""A test as the likelihood sees it: block averages of the force, and the motion behind them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import equinox as eqx
import numpy as np
from jaxtyping import Array

from qlvbayes.laws.motion import Motion

held = cast("Callable[[Any], Array]", np.asarray)
"""Arrays of one test stay numpy's: JAX would compile a copy for every length."""


class Blocks(eqx.Module):
    """Averages over runs of consecutive samples; every field has shape (B,).

    force: mean of the samples (N); count: how many; first, last: times of the first and the last
    (s); weight: measured sd of the samples over its root mean square in the pad (1 where none was
    measured); scale: sd of all noise at the block's force over the one at the floor's level; extra:
    sd (N) of the error that the motion's makes, one a block; timing: sd (N) of what is not known of
    the moments (`timing`), independent from block to block; real: False for padding.
    """

    force: Array
    count: Array
    first: Array
    last: Array
    weight: Array
    scale: Array
    extra: Array
    timing: Array
    real: Array

    @classmethod
    def of_samples(cls, time: np.ndarray, force: np.ndarray, weight: np.ndarray) -> Blocks:
        """Every sample its own block."""
        one = np.ones(time.shape)
        none = np.zeros_like(one)
        return cls(*map(held, (force, one, time, time, weight, one, none, none, one > 0.0)))


class Record(eqx.Module):
    """One test (or, with a leading axis, several padded to one size).

    motion: on the grid (N,); nodes: (B, 2) places on the grid whose forces average to the block's
    mean; blocks: (B,).
    """

    motion: Motion
    nodes: Array
    blocks: Blocks

    def average(self, force: Array) -> Array:
        """Block means (B,) of a force (N,) on the grid."""
        return 0.5 * (force[self.nodes[:, 0]] + force[self.nodes[:, 1]])
