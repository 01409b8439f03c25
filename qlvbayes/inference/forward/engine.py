"""The force of a hypothesis, as a chain of small compiled pieces.

The motion goes down through the layers to the material, and the force comes up again. Every piece
is compiled once, for any hypothesis that has it, over all tests and sets of constants together
(`pieces`). Slopes are differences of two forces: kinks of contact and clearance have no derivative
that would serve better, and half as much is traced and compiled.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from threading import Lock
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.forward.pieces import (
    Question,
    common_piece_of,
    material_of,
    piece_of,
    plan_of,
    whole_of,
)
from qlvbayes.io.runtime import cores
from qlvbayes.laws.layered import Law
from qlvbayes.laws.motion import Motion
from qlvbayes.motion.record import Record, with_zeros

Array = NDArray[np.float64]
Leaves = tuple[Any, ...]

SETS = 4
"""Sets of constants that are computed together; their number is filled up to a multiple of it."""
_WORTH = 512  # points: their force takes a millisecond, to compile another size a second
_MANY = 8  # parts, from which they are worth threads of their own
_KEPT = 4  # records that are kept as pieces take them


@dataclass(frozen=True, eq=False)
class Sets:
    """K sets of the constants of one law.

    elastic: (K, E); fractions: (K, L + 1); rates: (K, L) in 1/s, or (L,) where all sets have the
    same; layers: (K, P) of each, the innermost first.
    """

    elastic: Array
    fractions: Array
    rates: Array
    layers: tuple[Array, ...]

    @property
    def laws(self) -> tuple[Array, Array, Array]:
        """Constants of the material, rates of each set by itself."""
        rates = np.broadcast_to(self.rates, (len(self.elastic), self.rates.shape[-1]))
        return self.elastic, self.fractions, rates

    def parts(self) -> Iterator[Sets]:
        """As many as are computed together, the last ones filled up with the very last."""
        count = len(self.elastic)
        for start in range(0, count, SETS):
            rows = np.minimum(np.arange(start, start + SETS), count - 1)
            rates = self.rates if self.rates.ndim == 1 else self.rates[rows]
            layers = tuple(own[rows] for own in self.layers)
            yield Sets(self.elastic[rows], self.fractions[rows], rates, layers)


@dataclass(frozen=True, eq=False)
class Tests:
    """Tests of about one length, as pieces take them.

    members: places in the record; structure, leaves: of the motion, (T, N), the same for all sets;
    begin, end: where block means do in a force (T, K, N), flattened, (T, K, B); known: motions that
    layers without constants make of it.
    """

    members: list[int]
    structure: Any
    leaves: Leaves
    begin: NDArray[np.intp]
    end: NDArray[np.intp]
    known: dict[Any, Leaves] = field(default_factory=dict)

    @classmethod
    def of(cls, record: Record, members: list[int], points: int) -> Tests:
        """Some tests of a record, their motions cut after so many points."""
        motion = jax.tree.map(lambda leaf: np.asarray(leaf)[members], record.motion)
        leaves, structure = jax.tree.flatten(motion)
        own = tuple(jnp.asarray(leaf[:, :points] if leaf.ndim > 1 else leaf) for leaf in leaves)
        nodes = np.asarray(record.nodes)[members]
        first = (np.arange(len(members))[:, None] * SETS + np.arange(SETS)) * points
        begin, end = (first[:, :, None] + nodes[:, None, :, k] for k in (0, 1))
        return cls(members, structure, own, begin, end)

    def block_means(self, force: Array) -> Array:
        """(K, T, B) of a force (T, K, N)."""
        flat = force.reshape(-1)
        means = 0.5 * (flat[self.begin] + flat[self.end])
        return np.asarray(means.transpose(1, 0, 2))


@dataclass(frozen=True, eq=False)
class Chain:
    """A law under its layers, by its structures: what is called in turn for its force."""

    elastic: Any
    layers: tuple[Any, ...]

    @classmethod
    def of(cls, law: Law) -> Chain:
        """Of a law with any numbers in it."""
        layers = tuple(jax.tree.structure(layer) for layer in law.layers)
        return cls(jax.tree.structure(law.elastic), layers)

    def force(self, sets: Sets, tests: Tests) -> Any:
        """(T, K, N) in N, of as many sets as are computed together."""
        return self._under(len(self.layers), sets, tests, tests.leaves, tests.structure)

    def _under(self, count: int, sets: Sets, tests: Tests, leaves: Leaves, structure: Any) -> Any:
        """The force of the innermost layers, so many, over the material, under a motion."""
        if count == 0:
            return self._material(sets, jax.tree.unflatten(structure, leaves))
        layer, own = self.layers[count - 1], sets.layers[count - 1]
        plan, alike = plan_of(layer, self.elastic, structure), _alike(leaves, structure)
        if plan is None:
            whole = whole_of(self.layers[:count], self.elastic, structure, alike)
            return whole(sets.layers[:count], sets.laws, leaves)
        elastic, laws = (self.elastic, sets.laws) if plan.is_looking else (None, ())
        answers: list[Any] = []
        for turn, question in enumerate(plan.questions):
            asked = leaves
            if any(question.new) and all(alike) and not own.shape[1] and turn == 0:
                asked = self._common(layer, tests, leaves, structure, question)
            elif any(question.new):
                piece = piece_of(layer, elastic, structure, turn, alike, question.new)
                asked = _replaced(leaves, piece(own, laws, leaves, answers), question)
            answers.append(self._under(count - 1, sets, tests, asked, question.structure))
        last = piece_of(layer, elastic, structure, len(plan.questions), alike)
        return last(own, laws, leaves, answers)

    def _common(
        self, layer: Any, tests: Tests, leaves: Leaves, structure: Any, question: Question
    ) -> Leaves:
        """What a layer without constants makes of a motion that all sets have: done once."""
        key = layer, *map(id, leaves)
        if key not in tests.known:
            new = common_piece_of(layer, structure, question.new)(leaves)
            tests.known[key] = _replaced(leaves, new, question)
        return tests.known[key]

    def _material(self, sets: Sets, motion: Motion) -> Any:
        """The force of the material alone."""
        path: tuple[Any, Any, Any] = motion.time, motion.displacement, motion.bow
        alike = path[0].ndim == 2, path[1].ndim == 2, path[2].ndim == 2
        force = material_of(self.elastic, sets.rates.ndim == 1, alike)
        return force(sets.elastic, sets.fractions, sets.rates, *path)


class Engine:
    """Runs chains over records, and keeps what it made of these."""

    def __init__(self) -> None:
        self._tests: OrderedDict[Any, tuple[Record, list[Tests]]] = OrderedDict()
        self._lock = Lock()

    def forces(self, chain: Chain, sets: Sets, record: Record) -> Array:
        """(K, T, B) block means of the force (N) of K sets of constants over a record."""
        count, (tests, blocks) = len(sets.elastic), np.shape(record.nodes)[:2]
        groups = self._groups(record)
        parts = list(sets.parts())
        found = np.empty((len(parts) * SETS, tests, blocks))

        def run(k: int) -> None:
            for group in groups:
                force = np.asarray(chain.force(parts[k], group))
                found[k * SETS : (k + 1) * SETS, group.members] = group.block_means(force)

        if len(parts) < _MANY:
            deque(map(run, range(len(parts))), maxlen=0)
        else:
            with ThreadPoolExecutor(cores()) as threads:
                deque(threads.map(run, range(len(parts))), maxlen=0)
        return found[:count]

    def _groups(self, record: Record) -> list[Tests]:
        """A record's tests by their lengths."""
        key = id(record.motion.time), id(record.motion.displacement), id(record.nodes)
        with self._lock:
            if key not in self._tests:
                self._tests[key] = record, _by_length(with_zeros(record, "bow", float))
            self._tests.move_to_end(key)
            while len(self._tests) > _KEPT:
                self._tests.popitem(last=False)
            return self._tests[key][1]


def _by_length(record: Record) -> list[Tests]:
    """Tests as long as their own points ask for: the longest may have many times as many."""
    members: dict[int, list[int]] = {}
    for k, last in enumerate(np.max(np.asarray(record.nodes), axis=(1, 2)).tolist()):
        size = np.shape(record.motion.time)[1]
        while size >= 2 * _WORTH and size % 2 == 0 and size // 2 > last:  # few sizes are compiled
            size //= 2
        members.setdefault(size, []).append(k)
    return [Tests.of(record, some, size) for size, some in members.items()]


def _alike(leaves: Leaves, structure: Any) -> tuple[bool, ...]:
    """Which leaves of a motion are the same for all sets: (T, N), or (T,) of a test as a whole."""
    whole = _of_whole_tests(structure)
    return tuple(leaf.ndim == (1 if k in whole else 2) for k, leaf in enumerate(leaves))


@cache
def _of_whole_tests(structure: Any) -> tuple[int, int]:
    """Indices among a motion's leaves of its beginning on the pad's clock and of its number."""
    indices: Motion = jax.tree.unflatten(structure, list(range(structure.num_leaves)))
    return int(indices.start), int(indices.number)


def _replaced(leaves: Leaves, new: Any, question: Question) -> Leaves:
    """The motion asked for: its new leaves, and the others as they are."""
    made = iter(new)
    old = leaves if len(leaves) == len(question.new) else [None] * len(question.new)
    pairs = zip(old, question.new, strict=True)
    return tuple(next(made) if is_new else leaf for leaf, is_new in pairs)
