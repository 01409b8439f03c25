"""One compiled model for every hypothesis: any elastic law, any spectrum, effects on or off.

Which law is meant is a number that is given with the constants, and what is compiled for one
hypothesis serves all. Slopes are differences of two forces: kinks of contact and clearance have no
derivative that would serve better, and half as much is traced and compiled.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from numpy.typing import NDArray

from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.inference.traced import traced
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.scales import Scales
from qlvbayes.model.model import Model
from qlvbayes.preprocess.batching import told
from qlvbayes.preprocess.record import Record

Array = NDArray[np.float64]

TOGETHER = 4
"""Sets of constants come in multiples of this, so that few sizes are compiled."""
_AT_ONCE = ThreadPoolExecutor(min(4, os.cpu_count() or 1), thread_name_prefix="force")
"""XLA runs a force on one core and lets Python go on meanwhile: so do several at once."""
_WORTH = 512  # points: their force takes a millisecond, to trace another size a second
FEW = 4
"""Modes up to which a spectrum counts as short, and runs in a model of its own."""


class AnyElastic(AbstractElastic):
    """One of several elastic laws: that of number ``which``, with its constants in ``numbers``.

    templates: an instance of each law, for its structure.
    """

    which: Any
    numbers: Any
    templates: tuple[Any, ...] = eqx.field(static=True)
    name: ClassVar[str] = "any"
    units: ClassVar[dict[str, str]] = {}
    meanings: ClassVar[dict[str, str]] = {}
    law: ClassVar[str] = "one of several"
    reference: ClassVar[str] = ""

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """No law of its own."""
        raise NotImplementedError

    def _switched(self, method: str, *arguments: JaxArray) -> JaxArray:
        def branch(structure: Any) -> Any:
            def run(numbers: JaxArray, *arguments: JaxArray) -> JaxArray:
                own = jax.tree.unflatten(structure, list(numbers[: structure.num_leaves]))
                return getattr(own, method)(*arguments)

            return run

        branches = [branch(structure) for structure in self.templates]
        found: JaxArray = jax.lax.switch(self.which, branches, self.numbers, *arguments)
        return found

    def force(self, depth: JaxArray) -> JaxArray:
        """That of the law meant."""
        return self._switched("force", depth)

    def stiffness(self, depth: JaxArray) -> JaxArray:
        """That of the law meant."""
        return self._switched("stiffness", depth)

    def relaxed_step(
        self,
        start: JaxArray,
        stop: JaxArray,
        force_start: JaxArray,
        force_stop: JaxArray,
        decay: JaxArray,
    ) -> JaxArray:
        """That of the law meant."""
        return self._switched("relaxed_step", start, stop, force_start, force_stop, decay)


class AnyRelaxation(AbstractRelaxation):
    """A spectrum given as it is: fractions (L + 1,) and rates (L,) in 1/s."""

    fractions: Any
    rates: Any
    name: ClassVar[str] = "any"
    units: ClassVar[dict[str, str]] = {}
    meanings: ClassVar[dict[str, str]] = {}
    law: ClassVar[str] = "any spectrum"
    reference: ClassVar[str] = ""

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """No law of its own."""
        raise NotImplementedError

    def spectrum(self) -> tuple[JaxArray, JaxArray]:
        """As given."""
        return self.fractions, self.rates

    def times(self) -> dict[str, JaxArray]:
        """None of its own."""
        return {}


@dataclass(frozen=True, eq=False)
class Engine:
    """The force of any hypothesis.

    elastic: laws that may be meant, in the order of their numbers (any values); effects: candidates
    (any values, nested as in `Model`). A row of constants holds the elastic law's numbers (E,), the
    fractions (L + 1,), the rates (L,) and the effects' constants.
    """

    elastic: tuple[AbstractElastic, ...]
    effects: tuple[AbstractEffect, ...]
    bonded: bool
    _forces: dict[Any, Callable[..., JaxArray]] = field(default_factory=dict)

    @cached_property
    def width(self) -> int:
        """E, the most constants that an elastic law has."""
        return max(len(jax.tree.leaves(law)) for law in self.elastic)

    @cached_property
    def slots(self) -> dict[str, range]:
        """Where each effect's constants lie, counted from the first effect's."""
        found, start = {}, 0
        for effect in self._nested:
            count = len(jax.tree.leaves(effect))
            found[effect.name] = range(start, start + count)
            start += count
        return found

    @cached_property
    def _nested(self) -> tuple[AbstractEffect, ...]:
        return tuple(sorted(self.effects, key=lambda effect: (effect.level, effect.rank)))

    @cached_property
    def _sets(self) -> list[frozenset[str]]:
        """Sets of effects that are not costly, each compiled as one: none, the listed, all."""
        cheap = [e for e in self.effects if not e.costly]
        listed = [e for e in cheap if e.generalises is None and not e.outside]
        return [frozenset(e.name for e in some) for some in ([], listed, cheap)]

    def _together(self, at_work: frozenset[str]) -> frozenset[str]:
        """Effects compiled with those at work: with costly ones, which are at work themselves."""
        costly = frozenset(e.name for e in self.effects if e.costly) & at_work
        sets = self._sets[1:] if costly else self._sets
        return costly | next(names for names in sets if at_work - costly <= names)

    def forces(
        self, which: int, lanes: int, at_work: frozenset[str], rows: Array, record: Record
    ) -> Array:
        """(K, T, B) block means of the force (N) of rows of constants, over a record.

        which: number of the elastic law; lanes: L; at_work: effects that are not at their null.
        """
        names = self._together(at_work)
        kept = [effect for effect in self._nested if effect.name in names]
        start = self.width + 2 * lanes + 1
        columns = [start + k for effect in kept for k in self.slots[effect.name]]
        own = filled_up(rows[:, [*range(start), *columns]])
        parts = np.split(own, range(TOGETHER, len(own), TOGETHER))
        record = told(record, "bow", float)  # one compiled function serves straight lines too
        motions, nodes = _motions(record), np.asarray(record.nodes)
        shape = jax.tree.structure(record.motion)
        tasks: list[tuple[Any, ...]] = [
            (which, part, *motion) for motion in motions for part in parts
        ]

        def run(task: tuple[Any, ...]) -> Array:
            return np.asarray(self._forces[lanes, names, shape, task[2].shape](*task))

        for task in tasks[:: len(parts)]:  # by one thread only: each would compile it for itself
            kind = (lanes, names, shape, task[2].shape)
            if kind not in self._forces:
                self._forces[kind] = self._force_of(lanes, kept, shape, task)
                run(task)
        found = list(_AT_ONCE.map(run, tasks))
        per_test = [found[k : k + len(parts)] for k in range(0, len(found), len(parts))]
        of_blocks = [
            0.5 * (f[:, n[:, 0]] + f[:, n[:, 1]])
            for f, n in zip(map(np.concatenate, per_test), nodes, strict=True)
        ]
        return np.stack(of_blocks, axis=1)[: len(rows)]

    def _force_of(
        self, lanes: int, effects: Sequence[AbstractEffect], of_motion: Any, arguments: Any
    ) -> Callable[..., JaxArray]:
        """Compiled force of one test, from arguments like those given."""
        leaves, structure = jax.tree.flatten(self._model(lanes, effects))
        sizes = tuple(int(np.size(leaf)) for leaf in leaves[1:])  # the first is the law's
        parts = (*self.elastic, *effects)
        ours = all(type(part).__module__.startswith("qlvbayes.") for part in parts)
        meaning = f"{structure} {sizes} {of_motion}" if ours else None
        like = tuple(jax.ShapeDtypeStruct(np.shape(x), np.asarray(x).dtype) for x in arguments)
        return traced(_forces_of(structure, sizes, of_motion), like, meaning)

    def _model(self, lanes: int, effects: Sequence[AbstractEffect]) -> Model:
        """With empty numbers."""
        templates = tuple(jax.tree.structure(law) for law in self.elastic)
        elastic = AnyElastic(0, np.zeros(self.width), templates)
        relaxation = AnyRelaxation(np.zeros(lanes + 1), np.zeros(lanes))
        empty = tuple(jax.tree.map(lambda x: np.zeros(()), effect) for effect in effects)
        return Model(elastic, relaxation, self.bonded, empty)


def filled_up(rows: Array, multiple: int = TOGETHER) -> Array:
    """Rows (K, ...) and the first of them again, up to a multiple."""
    return np.concatenate([rows, np.repeat(rows[:1], -len(rows) % multiple, axis=0)])


def _motions(record: Record) -> list[tuple[Array, ...]]:
    """Of each test, its motion's arrays: what is compiled then knows no number of tests.

    Each as long as its own points ask for: the longest test may have many times as many.
    """
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(record.motion)]
    found = []
    for k, last in enumerate(np.max(np.asarray(record.nodes), axis=(1, 2)).tolist()):
        size = leaves[0].shape[1]
        while size >= 2 * _WORTH and size % 2 == 0 and size // 2 > last:  # few sizes are compiled
            size //= 2
        found.append(tuple(leaf[k][:size] if leaf.ndim > 1 else leaf[k] for leaf in leaves))
    return found


@cache
def _forces_of(structure: Any, sizes: tuple[int, ...], of_motion: Any) -> Callable[..., JaxArray]:
    """Force (4, N) of one test, of which law, rows of constants and a motion's arrays.

    structure, sizes: of a model, and of its leaves beside the law's number; 1 is a scalar;
    of_motion: the motion's structure.
    Arguments are plain arrays: to take modules apart at every call would cost as much as the force.
    """
    ends = np.cumsum(sizes)[:-1].tolist()

    def forces(which: JaxArray, rows: JaxArray, *arrays: JaxArray) -> JaxArray:
        motion: Motion = jax.tree.unflatten(of_motion, arrays)

        def one(row: JaxArray) -> JaxArray:
            parts = jnp.split(row, ends)
            numbers = [part[0] if part.size == 1 else part for part in parts]
            own: Model = jax.tree.unflatten(structure, [which, *numbers])
            return own.force(motion)

        return jax.vmap(one)(rows)

    return forces
