"""All that hypotheses about one record are made of, and what they predict.

Every hypothesis has a posterior of its own, under the noise floor as it was measured; all are run
by one `Engine`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from numpy.typing import NDArray

from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.inference.forward.engine import FEW, Engine
from qlvbayes.inference.forward.fixedrates import FixedRates, relaxation_of
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters, few_sizes
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.model.posterior import Posterior, is_prior, value_shape
from qlvbayes.preprocess.record import Record
from qlvbayes.priors.distributions import AbstractPrior
from qlvbayes.priors.natural import Natural, natural

Array = NDArray[np.float64]

_DRAWS = 25  # of each prior, for medians, quantiles and starts
_PLACES = 40  # depths, or times, at which laws are compared


@dataclass(frozen=True, eq=False)
class Space:
    """All that hypotheses about one record are made of, with priors.

    elastic, relaxation: laws by name; effects: candidates by name, amplitudes `Natural`; noise: the
    floor, its numbers fixed.
    """

    record: Record
    elastic: dict[str, AbstractElastic]
    relaxation: dict[str, AbstractRelaxation]
    effects: dict[str, AbstractEffect]
    noise: AbstractNoise
    bonded: bool
    _cache: dict[Hypothesis, Parameters] = field(default_factory=dict)
    _draws: dict[Any, Array] = field(default_factory=dict)
    _rates: dict[int, tuple[Record, FixedRates]] = field(default_factory=dict)

    def with_effects(self, effects: dict[str, AbstractEffect]) -> Space:
        """The same with other priors of its effects."""
        laws = {key: own for key, own in self._draws.items() if key[0] != "effects"}
        return replace(self, effects=effects, _cache={}, _draws=laws)

    def with_forces(self, forces: Array) -> Space:
        """The same about other block means (T, B) of the force (N)."""
        record = eqx.tree_at(lambda r: r.blocks.force, self.record, jnp.asarray(forces))
        return replace(self, record=record, _cache={})

    @cached_property
    def engine(self) -> Engine:
        """What computes their forces."""
        laws = tuple(_emptied(law) for law in self.elastic.values())
        effects = tuple(_emptied(effect) for effect in self.effects.values())
        return Engine(laws, effects, self.bonded)

    @cached_property
    def real(self) -> NDArray[np.bool_]:
        """(T, B) which blocks are no padding."""
        return np.asarray(self.record.blocks.real)

    def parameters(self, hypothesis: Hypothesis) -> Parameters:
        """What a hypothesis leaves free."""
        if hypothesis not in self._cache:
            model = Model(
                self.elastic[hypothesis.elastic],
                self.relaxation[hypothesis.relaxation],
                self.bonded,
            )
            for name in self.effects:
                if name in hypothesis.effects:
                    model = model + self.effects[name]
            posterior = Posterior(model, self.noise, self.record)
            self._cache[hypothesis] = Parameters.of(hypothesis, posterior)
        return self._cache[hypothesis]

    def forces(
        self, hypothesis: Hypothesis, constants: Array, record: Record | None = None
    ) -> Array:
        """(K, T, B) block means of the force (N) of constants (K, P), of another record if given.

        One of the same shape as the space's own takes no compiling.
        """
        return self.forces_of([(hypothesis, constants)], record)[0]

    def forces_of(
        self, several: Sequence[tuple[Hypothesis, Array]], record: Record | None = None
    ) -> list[Array]:
        """`forces` of several hypotheses on the same laws, each with its constants.

        Those that one compiled function serves are run together.
        """
        record = record or self.record
        rows, rates = self._rows(several, self._fixed(record))
        which = list(self.elastic).index(several[0][0].elastic)
        ends = np.cumsum([len(constants) for _, constants in several])
        places = np.split(np.arange(ends[-1]), ends[:-1])
        found: dict[int, Array] = {}
        alike = rates.ndim == 1
        together: dict[frozenset[str], list[int]] = {}
        for k, (hypothesis, _) in enumerate(several):
            names = self.engine.compiled_with(hypothesis.effects, alike)
            together.setdefault(names, []).append(k)
        for members in together.values():
            some = np.concatenate([places[k] for k in members])
            at_work = frozenset[str]().union(*(several[k][0].effects for k in members))
            own = rates if alike else rates[some]
            forces = self.engine.forces(which, at_work, rows[some], own, record)
            parts = np.split(forces, np.cumsum([len(places[k]) for k in members])[:-1])
            found |= dict(zip(members, parts, strict=True))
        return [found[k] for k in range(len(several))]

    def _fixed(self, record: Record) -> FixedRates:
        """Rates by which long spectra run over a record."""
        if id(record) not in self._rates:  # with the record, which so keeps its id
            self._rates[id(record)] = record, FixedRates.over(np.asarray(record.motion.time))
        return self._rates[id(record)][1]

    def added_force(self, hypothesis: Hypothesis, theta: Array, number: int, size: float) -> Array:
        """(T, B) what ``size`` more of one free number adds to the force (N) at theta (F,)."""
        added = theta.copy()
        added[number] += size
        constants = self.parameters(hypothesis).constants(np.stack([theta, added]))
        before, after = self.forces(hypothesis, constants)
        return np.asarray(after - before)

    @cached_property
    def places(self) -> tuple[Array, Array]:
        """Depths (mm) and times (s) at which laws are looked at, over all that the tests hold."""
        motion = self.record.motion
        time = np.asarray(motion.time)
        steps = np.diff(time, axis=-1)
        depth, least = float(np.max(motion.displacement)), float(steps[steps > 0.0].min())
        return np.linspace(0.0, depth, _PLACES), np.geomspace(least, float(time.max()), _PLACES)

    def numbers_of(self, hypothesis: Hypothesis, part: str) -> list[int]:
        """Places in theta of its elastic law's or its relaxation's numbers.

        With those of effects that act on the relaxation function alone.
        """
        elastic = self.draws("elastic", hypothesis.elastic).shape[1]
        if part == "elastic":
            return list(range(elastic))
        count = self.draws("relaxation", hypothesis.relaxation).shape[1]
        own = self.parameters(hypothesis).by_name.items()
        effects = tuple(f"{name}." for name in hypothesis.effects & self.relaxing)
        beside = [k for name, leaf in own if name.startswith(effects) for k in leaf.theta]
        return [*range(elastic, elastic + count), *(beside if effects else [])]

    def draws_of(self, hypothesis: Hypothesis, part: str) -> Array:
        """(25, size) draws of those numbers."""
        found = [self.draws(part, getattr(hypothesis, part))]
        if part == "relaxation":
            names = [name for name in self._nested(hypothesis) if name in self.relaxing]
            found += [self.draws("effects", name) for name in names]
        return np.concatenate(found, axis=1)

    def curve(self, hypothesis: Hypothesis, part: str, constants: Array) -> Array:
        """(K, 40) elastic force (N) over depth, or relaxation over time, of constants (K, P)."""
        count, full = self._counts[hypothesis.elastic], few_sizes(constants)
        if part == "elastic":
            law = self.elastic[hypothesis.elastic]
            structure = jax.tree.structure(_emptied(law))
            forces = _elastic_curves(structure, self.places[0], full[:, :count])
            return np.asarray(forces)[: len(constants)]
        name = hypothesis.relaxation
        fractions, rates = _spectra(self._structures[name], self._shapes[name], full[:, count:])
        found = relaxation_of(fractions, rates, self.places[1])[: len(constants)]
        for effect, own in self._on_relaxation(hypothesis, constants):
            found = np.asarray(
                effect(*own).relaxed(jnp.asarray(found), jnp.asarray(self.places[1]))
            )
        return found

    def _on_relaxation(
        self, hypothesis: Hypothesis, constants: Array
    ) -> Iterator[tuple[type[AbstractEffect], list[Array]]]:
        """Effects that act on the relaxation function alone, with their constants (K, 1)."""
        known = self.parameters(hypothesis).names
        for name in sorted(hypothesis.effects & self.relaxing):
            kind = type(self.effects[name])
            columns = [known.index(f"{name}.{field}") for field in kind.units]
            yield kind, [constants[:, [k]] for k in columns]

    @cached_property
    def relaxing(self) -> frozenset[str]:
        """Effects that act on the relaxation function alone."""
        every = {name: type(effect) for name, effect in self.effects.items()}
        return frozenset(n for n, k in every.items() if k.relaxed is not AbstractEffect.relaxed)

    def _rows(
        self, several: Sequence[tuple[Hypothesis, Array]], fixed: FixedRates
    ) -> tuple[Array, Array]:
        """(K, R) rows of the engine, and their rates, (K, L) or the fixed ones (L,)."""
        elastic_law, relaxation = several[0][0].base
        count, shapes = self._counts[elastic_law], self._shapes[relaxation]
        start = count + sum(math.prod(shape) for shape in shapes)
        laws = np.concatenate([constants[:, :start] for _, constants in several])
        elastic = np.zeros((len(laws), self.engine.width))
        elastic[:, :count] = laws[:, :count]
        fractions, rates = _spectra(self._structures[relaxation], shapes, laws[:, count:])
        missing = FEW - rates.shape[1]
        if missing < 0:
            fractions, rates = fixed.fractions(fractions, rates), fixed.rates
        else:
            fractions = np.pad(fractions, ((0, 0), (0, missing)))
            rates = np.pad(rates, ((0, 0), (0, missing)), constant_values=1.0)
        effects = [self._columns(one.effects, constants[:, start:]) for one, constants in several]
        return np.concatenate([elastic, fractions, np.concatenate(effects)], axis=1), rates

    def _columns(self, effects: frozenset[str], constants: Array) -> Array:
        """(K, ...) constants of all effects, of those of some, the others at nothing."""
        slots, start = self.engine.slots, 0
        found = np.tile(self._null, (len(constants), 1))
        for name in sorted(effects, key=lambda name: slots[name].start):
            width = len(slots[name])
            found[:, list(slots[name])] = constants[:, start : start + width]
            start += width
        return found

    @cached_property
    def _null(self) -> Array:
        """Constants at which all effects vanish; their others are of no account, but finite."""
        found = np.zeros(sum(len(slot) for slot in self.engine.slots.values()))
        for name, slot in self.engine.slots.items():
            effect = self.effects[name]
            found[list(slot)] = [effect.null.get(field, 1.0) for field in effect.units]
        return found

    @cached_property
    def _counts(self) -> dict[str, int]:
        """Constants of each elastic law."""
        return {name: len(jax.tree.leaves(_emptied(law))) for name, law in self.elastic.items()}

    @cached_property
    def _structures(self) -> dict[str, Any]:
        """Of the relaxations, a prior a leaf."""
        return {
            name: jax.tree.structure(law, is_leaf=is_prior) for name, law in self.relaxation.items()
        }

    @cached_property
    def _shapes(self) -> dict[str, list[tuple[int, ...]]]:
        """Shapes of each relaxation's fields."""
        return {
            name: [value_shape(leaf) for leaf in jax.tree.leaves(law, is_leaf=is_prior)]
            for name, law in self.relaxation.items()
        }

    def draws(self, part: str, name: str, seed: int = 0) -> Array:
        """(25, size) numbers drawn from the priors of a law or effect, the same for a seed."""
        if (part, name, seed) not in self._draws:
            rng = np.random.default_rng(seed)
            found = []
            for leaf in jax.tree.leaves(getattr(self, part)[name], is_leaf=is_prior):
                if is_prior(leaf):
                    values = np.stack([leaf.draw(rng) for _ in range(_DRAWS)])
                    found.append(np.asarray(_unconstrained(leaf, values)).reshape(_DRAWS, -1))
            self._draws[(part, name, seed)] = np.concatenate(
                [np.zeros((_DRAWS, 0)), *found], axis=1
            )
        return self._draws[(part, name, seed)]

    def plain_draws(self, hypothesis: Hypothesis, seed: int = 0) -> Array:
        """(25, F) of a hypothesis's numbers, drawn from their priors."""
        parts = [("elastic", hypothesis.elastic), ("relaxation", hypothesis.relaxation)]
        parts += [("effects", name) for name in self._nested(hypothesis)]
        return np.concatenate([self.draws(*part, seed) for part in parts], axis=1)

    def _nested(self, hypothesis: Hypothesis) -> list[str]:
        """Names of its effects, in the order in which they nest."""
        model = self.parameters(hypothesis).posterior.model
        return [effect.name for effect in model.effects]


def in_natural_amplitude(effect: AbstractEffect, factor: float = 1.0) -> AbstractEffect:
    """The effect with its amplitude's prior in the amplitude itself, times ``factor``."""
    name = next(iter(effect.null))
    prior = natural(getattr(effect, name))
    if isinstance(prior, Natural):
        prior = eqx.tree_at(lambda p: p.inner.sd, prior, factor * prior.sd)
    changed: AbstractEffect = eqx.tree_at(
        lambda e: getattr(e, name), effect, prior, is_leaf=is_prior
    )
    return changed


def _emptied(part: Any) -> Any:
    """A law or effect with numbers of no account in the place of its priors."""
    return jax.tree.map(lambda leaf: 0.0, part, is_leaf=is_prior)


def _spectra(
    structure: Any, shapes: list[tuple[int, ...]], constants: Array
) -> tuple[Array, Array]:
    """Fractions (K, L + 1) and rates (K, L) of constants (K, ...) that begin with the law's.

    structure, shapes: of the relaxation and its fields.
    """
    filled, start = [], 0
    for size in shapes:
        count = math.prod(size)
        part = constants[:, start : start + count].reshape(len(constants), *size)
        filled.append(few_sizes(part))
        start += count
    fractions, rates = _spectrum(structure, tuple(filled))
    return np.asarray(fractions)[: len(constants)], np.asarray(rates)[: len(constants)]


@partial(jax.jit, static_argnums=0)
def _elastic_curves(structure: Any, depths: JaxArray, constants: JaxArray) -> JaxArray:
    """(K, places) of constants (K, count) of an elastic law."""

    def one(row: JaxArray) -> JaxArray:
        law: AbstractElastic = jax.tree.unflatten(structure, list(row))
        return law.force(depths)

    return jax.vmap(one)(constants)


def _spectrum_of(relaxation: AbstractRelaxation) -> tuple[JaxArray, JaxArray]:
    return relaxation.spectrum()


@partial(jax.jit, static_argnums=0)
def _spectrum(structure: Any, constants: tuple[Array, ...]) -> tuple[JaxArray, JaxArray]:
    return jax.vmap(_spectrum_of)(jax.tree.unflatten(structure, constants))


@jax.jit
def _unconstrained(prior: AbstractPrior, values: JaxArray) -> JaxArray:
    return jax.vmap(prior.unconstrain)(values)


def median(draws: Iterable[Array]) -> Array:
    """Of draws (N, F), each number by itself."""
    return np.asarray(np.median(np.asarray(list(draws)), axis=0))
