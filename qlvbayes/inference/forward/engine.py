"""Compute the force of a hypothesis by a chain of small compiled pieces.

The motion is passed down through the layers to the material, and the force is passed up again, for
all tests and sets of constants together (`pieces`). Derivatives are differences of two forces:
contact and clearance make kinks where exact derivatives would serve no better.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from threading import Lock
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import PyTreeDef
from jaxtyping import Array as JaxArray
from numpy.typing import NDArray

from qlvbayes.inference.forward.pieces import (
    MotionRequest,
    common_piece_of,
    material_of,
    parts_of,
    piece_of,
    plan_of,
    whole_of,
)
from qlvbayes.io.arrays import Array
from qlvbayes.io.runtime import cores
from qlvbayes.laws.layered import Law
from qlvbayes.laws.motion import Motion
from qlvbayes.motion.record import Record, with_zeros

Leaves = tuple[JaxArray, ...]
Force = JaxArray | Array
Path = tuple[Any, Any, Any]

SETS = 4
"""Number of sets of constants that are computed together."""
_WORTH = 512  # points, whose force takes 1 ms; to compile for another length takes 1 s
_MANY = 8  # groups of sets that a thread computes together
_KEPT = 4  # records that are cached in the form pieces take


@dataclass(frozen=True, eq=False)
class ConstantSets:
    """K sets of the constants of one law."""

    elastic: Array  # (K, E)
    fractions: Array  # (K, L + 1)
    rates: Array  # (K, L) in 1/s, or (L,) where all sets share them
    layers: tuple[Array, ...]  # (K, P) of each layer, the innermost first

    @property
    def laws(self) -> tuple[Array, Array, Array]:
        """Return the constants of the material, with rates (K, L) of every set."""
        rates = np.broadcast_to(self.rates, (len(self.elastic), self.rates.shape[-1]))
        return self.elastic, self.fractions, rates

    def parts(self) -> Iterator[ConstantSets]:
        """Yield the sets in groups of `SETS`; the last group is filled up with the last set."""
        count = len(self.elastic)
        for start in range(0, count, SETS):
            rows = np.minimum(np.arange(start, start + SETS), count - 1)
            rates = self.rates if self.rates.ndim == 1 else self.rates[rows]
            layers = tuple(own[rows] for own in self.layers)
            yield ConstantSets(self.elastic[rows], self.fractions[rows], rates, layers)


@dataclass(frozen=True, eq=False)
class TestGroup:
    """Tests of about the same length, in the form in which pieces take them."""

    members: list[int]  # indices in the record
    # structure, leaves (T, N): of the motion, the same for all sets
    structure: PyTreeDef
    leaves: Leaves
    # begin, end (T, K, B): indices of the ends of each block in the flattened force (T, K, N)
    begin: NDArray[np.intp]
    end: NDArray[np.intp]
    # motions that layers without constants make of this motion
    known: dict[tuple[Any, ...], Leaves] = field(default_factory=dict)

    @classmethod
    def from_record(cls, record: Record, members: list[int], points: int) -> TestGroup:
        """Return some tests of a record, with their motions truncated after ``points`` points."""
        motion = jax.tree.map(lambda leaf: np.asarray(leaf)[members], record.motion)
        leaves, structure = jax.tree.flatten(motion)
        truncated = tuple(
            jnp.asarray(leaf[:, :points] if leaf.ndim > 1 else leaf) for leaf in leaves
        )
        nodes = np.asarray(record.nodes)[members]
        first = (np.arange(len(members))[:, None] * SETS + np.arange(SETS)) * points
        begin, end = (first[:, :, None] + nodes[:, None, :, k] for k in (0, 1))
        return cls(members, structure, truncated, begin, end)

    def block_means(self, force: Array) -> Array:
        """Return the block means (K, T, B) of a force (T, K, N)."""
        flat = force.reshape(-1)
        means = 0.5 * (flat[self.begin] + flat[self.end])
        return np.asarray(means.transpose(1, 0, 2))


@dataclass(frozen=True, eq=False)
class LayerChain:
    """A law under its layers, given by their pytree structures, which computes the law's force."""

    elastic: PyTreeDef
    layers: tuple[PyTreeDef, ...]

    @classmethod
    def from_law(cls, law: Law) -> LayerChain:
        """Return the chain of a law; the values in its fields do not matter."""
        layers = tuple(jax.tree.structure(layer) for layer in law.layers)
        return cls(jax.tree.structure(law.elastic), layers)

    def forces(self, groups: Sequence[ConstantSets], tests: TestGroup) -> Sequence[Force]:
        """Return the force (T, K, N) in N of each group of as many sets as run together."""
        motions = [tests.leaves] * len(groups)
        return self._under(len(self.layers), groups, tests, motions, tests.structure)

    def _under(
        self,
        count: int,
        groups: Sequence[ConstantSets],
        tests: TestGroup,
        motions: Sequence[Leaves],
        structure: PyTreeDef,
    ) -> Sequence[Force]:
        """Return the forces (T, K, N) of the ``count`` innermost layers over the material."""
        if count == 0:
            return self._material(groups, motions, structure)
        layer, shared = self.layers[count - 1], _shared(motions[0], structure)
        plan = plan_of(layer, self.elastic, structure)
        if plan is None:
            whole = whole_of(self.layers[:count], self.elastic, structure, shared)
            return [
                whole(sets.layers[:count], sets.laws, leaves)
                for sets, leaves in zip(groups, motions, strict=True)
            ]
        elastic = self.elastic if plan.uses_laws else None
        own = [(sets.layers[count - 1], sets.laws if plan.uses_laws else ()) for sets in groups]
        answers: list[list[Force]] = [[] for _ in groups]
        for turn, request in enumerate(plan.requests):
            requested = motions
            if any(request.new) and all(shared) and not own[0][0].shape[1] and turn == 0:
                common = self._common(layer, tests, motions[0], structure, request)
                requested = [common] * len(groups)
            elif any(request.new):
                piece = piece_of(layer, elastic, structure, turn, shared, request.new)
                requested = [
                    _replaced(leaves, piece(*constants, leaves, known), request)
                    for constants, leaves, known in zip(own, motions, answers, strict=True)
                ]
            forces = self._under(count - 1, groups, tests, requested, request.structure)
            for known, force in zip(answers, forces, strict=True):
                known.append(force)
        last = piece_of(layer, elastic, structure, len(plan.requests), shared)
        return [
            last(*constants, leaves, known)
            for constants, leaves, known in zip(own, motions, answers, strict=True)
        ]

    def _common(
        self,
        layer: PyTreeDef,
        tests: TestGroup,
        leaves: Leaves,
        structure: PyTreeDef,
        request: MotionRequest,
    ) -> Leaves:
        """Return what a layer without constants makes of a shared motion, computed only once."""
        key = layer, *map(id, leaves)
        if key not in tests.known:
            new = common_piece_of(layer, structure, request.new)(leaves)
            tests.known[key] = _replaced(leaves, new, request)
        return tests.known[key]

    def _material(
        self, groups: Sequence[ConstantSets], motions: Sequence[Leaves], structure: PyTreeDef
    ) -> Sequence[Force]:
        """Return the force (T, K, N) of the material alone for each group."""
        paths = [_path(leaves, structure) for leaves in motions]
        shared = tuple(part.ndim == 2 for part in paths[0])
        if len(groups) > 1 and groups[0].rates.ndim == 1:
            index = _equal_sets(groups, paths, shared)
            if index.max() < SETS * (len(groups) - 1):
                return self._from_parts(groups, paths, shared, index)
        piece = material_of(self.elastic, groups[0].rates.ndim == 1, shared)
        pairs = zip(groups, paths, strict=True)
        return [piece(sets.elastic, sets.fractions, sets.rates, *path) for sets, path in pairs]

    def _from_parts(
        self,
        groups: Sequence[ConstantSets],
        paths: Sequence[Path],
        shared: tuple[bool, ...],
        index: NDArray[np.intp],
    ) -> Sequence[Force]:
        """Return the force (T, K, N) of each group from parts that sets have in common."""
        fractions = np.concatenate([sets.fractions for sets in groups])
        first = np.unique(index, return_index=True)[1]
        piece = parts_of(self.elastic, shared)
        tests, points = np.shape(paths[0][0])[0], np.shape(paths[0][0])[-1]
        force = np.empty((tests, len(fractions), points))
        for start in range(0, len(first), SETS):
            rows = first[np.minimum(np.arange(start, start + SETS), len(first) - 1)]
            at = [divmod(int(row), SETS) for row in rows]
            path = [
                paths[0][j]
                if same
                else np.stack([np.asarray(paths[g][j])[:, k] for g, k in at], axis=1)
                for j, same in enumerate(shared)
            ]
            elastic = np.stack([groups[g].elastic[k] for g, k in at])
            parts = np.asarray(piece(elastic, groups[0].rates, *path))
            for k in range(start, min(start + SETS, len(first))):
                same = np.flatnonzero(index == k)
                force[:, same] = fractions[same] @ parts[:, k - start]
        return np.split(force, len(groups), axis=1)


class ForceEngine:
    """An engine that runs chains over records, and caches the records in the form pieces take."""

    def __init__(self) -> None:
        self._tests: OrderedDict[tuple[int, int, int], tuple[Record, list[TestGroup]]] = (
            OrderedDict()
        )
        self._lock = Lock()

    def forces(self, chain: LayerChain, sets: ConstantSets, record: Record) -> Array:
        """Return block means (K, T, B) of the force (N) of K sets of constants over a record."""
        count, (tests, blocks) = len(sets.elastic), np.shape(record.nodes)[:2]
        by_length = self._groups(record)
        groups = list(sets.parts())
        forces = np.empty((len(groups) * SETS, tests, blocks))

        def run(first: int) -> None:
            some = groups[first : first + _MANY]
            for own in by_length:
                for k, force in enumerate(chain.forces(some, own), first):
                    means = own.block_means(np.asarray(force))
                    forces[k * SETS : (k + 1) * SETS, own.members] = means

        runs = range(0, len(groups), _MANY)
        if len(runs) == 1:
            run(0)
        else:
            with ThreadPoolExecutor(cores()) as threads:
                deque(threads.map(run, runs), maxlen=0)
        return forces[:count]

    def _groups(self, record: Record) -> list[TestGroup]:
        """Return the tests of a record grouped by length."""
        key = id(record.motion.time), id(record.motion.displacement), id(record.nodes)
        with self._lock:
            if key not in self._tests:
                self._tests[key] = record, _by_length(with_zeros(record, "sagitta", float))
            self._tests.move_to_end(key)
            while len(self._tests) > _KEPT:
                self._tests.popitem(last=False)
            return self._tests[key][1]


def _by_length(record: Record) -> list[TestGroup]:
    """Return groups of tests, each as long as its own blocks need: some tests may be far longer."""
    members: dict[int, list[int]] = {}
    for k, last in enumerate(np.max(np.asarray(record.nodes), axis=(1, 2)).tolist()):
        size = np.shape(record.motion.time)[1]
        # halves only: few lengths are compiled
        while size >= 2 * _WORTH and size % 2 == 0 and size // 2 > last:
            size //= 2
        members.setdefault(size, []).append(k)
    return [TestGroup.from_record(record, indices, size) for size, indices in members.items()]


def _equal_sets(
    groups: Sequence[ConstantSets], paths: Sequence[Path], shared: Sequence[bool]
) -> NDArray[np.intp]:
    """Return an index (K,) that is the same for sets of equal elastic constants and motion."""
    index = _equal(np.concatenate([sets.elastic for sets in groups]))
    if all(shared) or index.max() >= SETS * (len(groups) - 1):
        return index
    own = [j for j, same in enumerate(shared) if not same]
    moved = [np.asarray(path[j]).swapaxes(0, 1).reshape(SETS, -1) for path in paths for j in own]
    rows = [np.concatenate(moved[j :: len(own)]) for j in range(len(own))]
    return _equal(np.concatenate([index[:, None], *rows], axis=1))


def _equal(rows: Array) -> NDArray[np.intp]:
    """Return an index (K,) that counts distinct rows (K, P) in the order of their appearance."""
    known: dict[bytes, int] = {}
    return np.array([known.setdefault(row.tobytes(), len(known)) for row in rows])


def _path(leaves: Leaves, structure: PyTreeDef) -> Path:
    """Return time, depth and sagitta of a motion."""
    motion: Motion = jax.tree.unflatten(structure, leaves)
    return motion.time, motion.displacement, motion.sagitta


def _shared(leaves: Leaves, structure: PyTreeDef) -> tuple[bool, ...]:
    """Return which leaves of a motion are shared by all sets: (T, N), or (T,) for a whole test."""
    whole = _of_whole_tests(structure)
    return tuple(leaf.ndim == (1 if k in whole else 2) for k, leaf in enumerate(leaves))


@cache
def _of_whole_tests(structure: PyTreeDef) -> tuple[int, int]:
    """Return the indices of a motion's leaves that have one value per test: start and number."""
    indices: Motion = jax.tree.unflatten(structure, list(range(structure.num_leaves)))
    return int(indices.start), int(indices.number)


def _replaced(leaves: Leaves, new: Any, request: MotionRequest) -> Leaves:
    """Return the leaves of a requested motion: the new ones, and the others unchanged."""
    new_leaves = iter(new)
    # a motion of another structure has new leaves only
    old: list[Any] = [*leaves] if len(leaves) == len(request.new) else [None] * len(request.new)
    pairs = zip(old, request.new, strict=True)
    return tuple(next(new_leaves) if is_new else leaf for leaf, is_new in pairs)
