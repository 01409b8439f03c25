"""Compute the force of many sets of constants over a record by NumPy, without compilation.

The law's own equations run on arrays (N, T, K): time, tests, sets of constants. Derivatives are
differences of two forces: contact and clearance make kinks where exact derivatives would serve no
better.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Array as JaxArray
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.io.runtime import in_threads
from qlvbayes.laws.layered import Law, Layer
from qlvbayes.laws.motion import Motion
from qlvbayes.model.model import Model
from qlvbayes.motion.record import Record

_TOGETHER = 16  # sets that run together: their arrays of one megabyte or so stay in the cache
_FEW = 16_384  # numbers of an array below which more sets run together: each call costs time too
_SAME = 1e-9  # of the largest force, by which NumPy and JAX may differ
_KEPT = 4  # records that are kept in the form in which they run
_SHORTER = 0.4  # share of the longest test below which a test runs in another group: each group
# costs a millisecond beside its arithmetic


@dataclass(frozen=True, eq=False)
class TestGroup:
    """Tests of about the same length, with time as the first axis."""

    members: list[int]  # indices in the record
    motion: Motion  # (N, T, 1)
    begin: NDArray[np.intp]  # begin, end (B, T): of each block, points whose mean is the block's
    end: NDArray[np.intp]

    @classmethod
    def from_record(cls, record: Record, members: list[int], points: int) -> TestGroup:
        """Return some tests of a record, with their motions truncated after ``points`` points."""

        def turned(leaf: Any) -> Array:
            some = np.asarray(leaf)[members]
            return some[:, None] if some.ndim == 1 else some[:, :points].T[:, :, None].copy()

        nodes = np.asarray(record.nodes)[members]
        motion = jax.tree.map(turned, record.motion)
        return cls(members, motion, nodes[:, :, 0].T, nodes[:, :, 1].T)

    def block_means(self, force: Array) -> Array:
        """Return the block means (K, T, B) of a force (N, T, K) or (N, T, 1)."""
        test = np.arange(len(self.members))
        means = 0.5 * (force[self.begin, test] + force[self.end, test])
        return np.asarray(means.transpose(2, 1, 0))


@dataclass(frozen=True, eq=False)
class Forces:
    """The forces of models over records, which are kept in the form in which they run.

    A user's own law or effect is tried once: where its equations run on one test at a time only, or
    give another force for many, JAX compiles it.
    """

    _records: dict[int, tuple[Record, list[TestGroup]]] = field(default_factory=dict)
    _together: dict[frozenset[type], bool] = field(default_factory=dict)

    def over(self, model: Model, count: int, record: Record) -> Array:
        """Return block means (K, T, B) of the force (N) of a model of K = ``count`` sets."""
        own = frozenset(filter(_is_users, map(type, (model.elastic, *model.effects))))
        if own not in self._together:
            self._together[own] = not own or self._agrees(_selected(model, slice(0, 1)), record)
        if not self._together[own]:
            return _by_jax(model, count, record)
        together = max(_TOGETHER, _FEW // np.size(record.motion.time))
        if count <= together:
            return self._by_numpy(model, count, record)
        parts = [slice(k, min(k + together, count)) for k in range(0, count, together)]

        def means(part: slice) -> Array:
            return self._by_numpy(_selected(model, part), part.stop - part.start, record)

        return np.concatenate(in_threads(means, parts))

    def _by_numpy(self, model: Model, count: int, record: Record) -> Array:
        means = np.empty((count, *np.shape(record.nodes)[:2]))
        law = model.law
        layers: Any = tuple(_Users(x) if _is_users(type(x)) else x for x in law.layers)
        law = replace(law, layers=layers)
        with np.errstate(all="ignore"):  # what is not finite is refused by the callers
            for group in self.groups(record):
                means[:, group.members] = group.block_means(law.force(group.motion))
        return means

    def _agrees(self, model: Model, record: Record) -> bool:
        """Return whether NumPy gives the force that JAX gives."""
        try:
            found = self._by_numpy(model, 1, record)
        except Exception:  # of a user's own code, which need not run on arrays of three axes
            return False
        expected = _by_jax(model, 1, record)
        return np.allclose(found, expected, rtol=_SAME, atol=_SAME * np.max(np.abs(expected)))

    def groups(self, record: Record) -> list[TestGroup]:
        """Return the tests of a record grouped by length."""
        known = self._records.get(id(record))
        if known is None:  # the record is kept too, so that its id stays unique
            known = record, list(_by_length(record))
            while len(self._records) >= _KEPT:
                self._records.pop(next(iter(self._records)), None)
            self._records[id(record)] = known
        return known[1]


class _Users:
    """A user's own layer, which may make arrays of JAX of the motion and of the force."""

    def __init__(self, layer: Layer) -> None:
        self.layer = layer

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the layer's force as an array of NumPy."""
        return np.asarray(self.layer.force(_Below(below), motion))  # type: ignore[arg-type]


class _Below:
    """The law below a user's own layer, which takes arrays of either kind."""

    def __init__(self, law: Law) -> None:
        self.elastic, self.relaxation, self._law = law.elastic, law.relaxation, law

    def force(self, motion: Motion) -> Array:
        """Return the force of the law."""
        return self._law.force(jax.tree.map(np.asarray, motion))


def _is_users(kind: type) -> bool:
    return not kind.__module__.startswith("qlvbayes.")


def _by_jax(model: Model, count: int, record: Record) -> Array:
    """Return block means (K, T, B) of the force (N) of K sets, compiled."""
    rows = np.minimum(np.arange(count + -count % _TOGETHER), count - 1)
    models = jax.tree.map(lambda x: np.moveaxis(np.asarray(x)[..., rows], -1, 0), model)
    return np.asarray(_compiled(models, record))[:count]


@jax.jit
def _compiled(models: Model, record: Record) -> JaxArray:
    def one(model: Model) -> JaxArray:
        return jax.vmap(lambda test: test.average(model.force(test.motion)))(record)

    return jax.vmap(one)(models)


def _selected(model: Model, some: slice) -> Model:
    """Return the model of some of the sets, which lie along the last axis of its constants."""
    chosen: Model = jax.tree.map(lambda x: x[..., some], model)
    return chosen


def _by_length(record: Record) -> Iterator[TestGroup]:
    """Yield groups of tests, each as long as its own blocks need: some tests may be far longer."""
    needed = np.max(np.asarray(record.nodes), axis=(1, 2)) + 1
    left = sorted(range(len(needed)), key=lambda k: -int(needed[k]))
    while left:
        longest = int(needed[left[0]])
        members = [k for k in left if needed[k] >= _SHORTER * longest]
        yield TestGroup.from_record(record, sorted(members), longest)
        left = [k for k in left if k not in members]
