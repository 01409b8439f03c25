"""The products of many designs, from which `information` computes bits in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.errors import ReadingErrors, Whitening
from qlvbayes.diagnosis.nexttest.information import Products
from qlvbayes.diagnosis.nexttest.records import record_of
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.io.arrays import Array
from qlvbayes.motion.record import Record

TOGETHER = 64
"""Designs that are run at once, so that one compiled shape serves any number of them."""


def screen(
    belief: Belief, designs: Sequence[Design], rig: Rig, errors: ReadingErrors, clock: float
) -> tuple[Products, NDArray[np.bool_]]:
    """Return the products of T designs, and a mask (T,) of those that give finite forces."""
    blocks = []
    for first in range(0, len(designs), TOGETHER):
        some = list(designs[first : first + TOGETHER])
        full = some + some[:1] * (TOGETHER - len(some))
        record = record_of(full, rig, clock)
        blocks.append(_products(belief, some, record, rig, errors))
    sizes = tuple(one.size for one in belief.explanations)
    values = np.concatenate(blocks)
    sound = np.asarray(np.isfinite(values).all(axis=(1, 2)))
    return Products(np.where(sound[:, None, None], values, 0.0), sizes), sound


def _products(
    belief: Belief, designs: Sequence[Design], record: Record, rig: Rig, errors: ReadingErrors
) -> Array:
    """Return the products (T, V, V) of T designs with their record."""
    rows = []
    for one in belief.explanations:
        force, slopes = one.slopes(np.zeros((1, one.size)), record)
        rows.append(np.concatenate([force, slopes[0]]))
    vectors = np.concatenate(rows)

    def product(k: int) -> Array:
        own = vectors[:, k]
        if not np.isfinite(own).all():
            return np.full((len(own), len(own)), np.nan)
        white = whitening(designs[k], k, record, rig, errors, own[0])(own)
        return np.asarray(white @ white.T)

    with ThreadPoolExecutor(2) as pool:
        return np.stack(list(pool.map(product, range(len(designs)))))


def whitening(
    design: Design, index: int, record: Record, rig: Rig, errors: ReadingErrors, force: Array
) -> Whitening:
    """Return the whitening of a design, which is the test ``index`` of a record."""
    own = jax.tree.map(lambda x: np.asarray(x)[index], record)
    covariance = errors.covariance(design, rig, own, force)
    return Whitening(np.asarray(own.blocks.real), covariance)
