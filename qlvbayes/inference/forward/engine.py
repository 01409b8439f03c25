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
from qlvbayes.inference.forward.traced import traced
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
_APART = (0, 3)  # leaves of a model that are no columns of a row: the law's number, the rates
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
    fractions (L + 1,) and the effects' constants. Rates (1/s) are each row's own, (K, L), or
    one set (L,) for all: what decays then does so alike in all rows, and is computed once.
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

    def compiled_with(self, at_work: frozenset[str], alike: bool) -> frozenset[str]:
        """Effects compiled with those at work: none, the listed or all that are not costly.

        Costly ones only where they are at work, and so, where all rows decay alike, what would give
        each a time of its own.
        """
        apart, listed, cheap = self._sets[alike]
        here = apart & at_work
        sets = [listed, cheap] if here else [frozenset[str](), listed, cheap]
        return here | next(names for names in sets if at_work - here <= names)

    @cached_property
    def _sets(self) -> tuple[tuple[frozenset[str], ...], ...]:
        """Effects compiled apart, the listed ones of the others, all of the others.

        First where each row has its own rates, then where all decay alike.
        """
        found = []
        for alike in (False, True):
            apart = frozenset(e.name for e in self.effects if e.costly or (alike and e.own_time))
            cheap = [e for e in self.effects if e.name not in apart]
            listed = frozenset(e.name for e in cheap if e.generalises is None and not e.outside)
            found.append((apart, listed, frozenset(e.name for e in cheap)))
        return tuple(found)

    def forces(
        self, which: int, at_work: frozenset[str], rows: Array, rates: Array, record: Record
    ) -> Array:
        """(K, T, B) block means of the force (N) of rows of constants, over a record.

        which: number of the elastic law; at_work: effects that are not at their null.
        """
        names = self.compiled_with(at_work, alike=rates.ndim == 1)
        kept = [effect for effect in self._nested if effect.name in names]
        start = self.width + rates.shape[-1] + 1
        columns = [start + k for effect in kept for k in self.slots[effect.name]]
        parts = _in_parts(rows[:, [*range(start), *columns]])
        rates_of = [rates] * len(parts) if rates.ndim == 1 else _in_parts(rates)
        record = told(record, "bow", float)  # one compiled function serves straight lines too
        motions, nodes = _motions(record), np.asarray(record.nodes)
        shape = jax.tree.structure(record.motion)
        tasks: list[tuple[Any, ...]] = [
            (which, part, own, *motion)
            for motion in motions
            for part, own in zip(parts, rates_of, strict=True)
        ]

        def kind(task: tuple[Any, ...]) -> Any:
            return names, shape, task[2].shape, task[3].shape

        def run(task: tuple[Any, ...]) -> Array:
            return np.asarray(self._forces[kind(task)](*task))

        for task in tasks[:: len(parts)]:  # by one thread only: each would compile it for itself
            if kind(task) not in self._forces:
                self._forces[kind(task)] = self._force_of(kept, shape, task)
                run(task)
        found = list(_AT_ONCE.map(run, tasks))
        per_test = [found[k : k + len(parts)] for k in range(0, len(found), len(parts))]
        of_blocks = [
            0.5 * (f[:, n[:, 0]] + f[:, n[:, 1]])
            for f, n in zip(map(np.concatenate, per_test), nodes, strict=True)
        ]
        return np.stack(of_blocks, axis=1)[: len(rows)]

    def _force_of(
        self, effects: Sequence[AbstractEffect], of_motion: Any, arguments: Any
    ) -> Callable[..., JaxArray]:
        """Compiled force of one test, from arguments like those given."""
        leaves, structure = jax.tree.flatten(self._model(arguments[2].shape[-1], effects))
        sizes = tuple(int(np.size(leaf)) for k, leaf in enumerate(leaves) if k not in _APART)
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


def _in_parts(rows: Array) -> list[Array]:
    """Rows (K, ...), filled up, as many together as are run at once."""
    full = filled_up(rows)
    return np.split(full, range(TOGETHER, len(full), TOGETHER))


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
    """Force (K, N) of one test, of which law, rows of constants, rates and a motion's arrays.

    structure, sizes: of a model, and of its leaves beside the law's number and the rates; 1 is a
    scalar; of_motion: the motion's structure.
    Arguments are plain arrays: to take modules apart at every call would cost as much as the force.
    """
    ends = np.cumsum(sizes)[:-1].tolist()

    def forces(which: JaxArray, rows: JaxArray, rates: JaxArray, *arrays: JaxArray) -> JaxArray:
        motion: Motion = jax.tree.unflatten(of_motion, arrays)

        def one(row: JaxArray, rates: JaxArray) -> JaxArray:
            parts = jnp.split(row, ends)
            law, fractions, *effects = [part[0] if part.size == 1 else part for part in parts]
            own: Model = jax.tree.unflatten(structure, [which, law, fractions, rates, *effects])
            return own.force(motion)

        return jax.vmap(one, in_axes=(0, 0 if rates.ndim == 2 else None))(rows, rates)

    return forces
