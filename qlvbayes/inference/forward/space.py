"""All that hypotheses about one record are made of, and what they predict.

Every hypothesis has a posterior of its own, under the noise floor as it was measured; all are run
by one `Engine`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
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
from qlvbayes.inference.forward.engine import Chain, Engine, Sets
from qlvbayes.inference.forward.fixedrates import FixedRates, relaxation_of
from qlvbayes.inference.forward.hypothesis import (
    ELASTIC,
    RELAXATION,
    Hypothesis,
    Parameters,
    few_sizes,
)
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.model.posterior import Posterior, is_prior, value_shape
from qlvbayes.motion.record import Record
from qlvbayes.priors.distributions import AbstractPrior
from qlvbayes.priors.natural import Natural, natural

Array = NDArray[np.float64]

FEW = 4
"""Modes up to which a spectrum runs as it is: longer ones share fixed rates."""
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
    _engine: Engine = field(default_factory=Engine)
    _cache: dict[Hypothesis, Parameters] = field(default_factory=dict)
    _chains: dict[Hypothesis, tuple[Chain, list[slice]]] = field(default_factory=dict)
    _draws: dict[Any, Array] = field(default_factory=dict)
    _rates: dict[int, tuple[Record, FixedRates]] = field(default_factory=dict)

    def with_effects(self, effects: dict[str, AbstractEffect]) -> Space:
        """The same with other priors of its effects."""
        laws = {key: own for key, own in self._draws.items() if key[0] != "effects"}
        return replace(self, effects=effects, _cache={}, _chains={}, _draws=laws)

    def with_forces(self, forces: Array) -> Space:
        """The same about other block means (T, B) of the force (N)."""
        record = eqx.tree_at(lambda r: r.blocks.force, self.record, jnp.asarray(forces))
        return replace(self, record=record, _cache={}, _chains={})

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
        record = record or self.record
        sets = self._sets(hypothesis, constants, self._fixed(record))
        return self._engine.forces(self._chain(hypothesis)[0], sets, record)

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

    def draws_of(self, hypothesis: Hypothesis, part: str, seed: int = 0) -> Array:
        """(25, size) draws of those numbers."""
        found = [self.draws(part, getattr(hypothesis, part), seed)]
        if part == "relaxation":
            names = [name for name in self._nested(hypothesis) if name in self.relaxing]
            found += [self.draws("effects", name, seed) for name in names]
        return np.concatenate(found, axis=1)

    def curve(self, hypothesis: Hypothesis, part: str, constants: Array) -> Array:
        """(K, 40) elastic force (N) over depth, or relaxation over time, of constants (K, P)."""
        if part == "elastic":
            law = _emptied(self.elastic[hypothesis.elastic])
            own = few_sizes(constants[:, self.parameters(hypothesis).columns[ELASTIC]])
            forces = _elastic_curves(jax.tree.structure(law), self.places[0], own)
            return np.asarray(forces)[: len(constants)]
        return relaxation_of(*self.spectra(hypothesis, constants), self.places[1])

    @cached_property
    def relaxing(self) -> frozenset[str]:
        """Effects that act on the relaxation function alone."""
        every = {name: type(effect) for name, effect in self.effects.items()}
        return frozenset(n for n, k in every.items() if k.spectrum is not AbstractEffect.spectrum)

    def _chain(self, hypothesis: Hypothesis) -> tuple[Chain, list[slice]]:
        """Of what does not act on the relaxation alone; where its layers' constants are."""
        if hypothesis not in self._chains:
            own = self.parameters(hypothesis)
            model: Model = _emptied(own.posterior.model)
            for name in hypothesis.effects & self.relaxing:
                model = model.without(name)
            law, none = model.law, slice(0, 0)
            names = [getattr(layer, "name", None) for layer in law.layers]
            places = [own.columns.get(name, none) if name else none for name in names]
            self._chains[hypothesis] = Chain.of(law), places
        return self._chains[hypothesis]

    def _sets(self, hypothesis: Hypothesis, constants: Array, fixed: FixedRates) -> Sets:
        """Constants (K, P) taken apart; long spectra by the fixed rates."""
        fractions, rates = self.spectra(hypothesis, constants)
        if rates.shape[1] > FEW:
            fractions, rates = fixed.fractions(fractions, rates), fixed.rates
        elastic = self.parameters(hypothesis).columns[ELASTIC]
        layers = tuple(constants[:, place] for place in self._chain(hypothesis)[1])
        return Sets(constants[:, elastic], fractions, rates, layers)

    def spectra(self, hypothesis: Hypothesis, constants: Array) -> tuple[Array, Array]:
        """Fractions (K, L + 1) and rates (K, L), with the effects that act on these alone."""
        own, rows = self.parameters(hypothesis), few_sizes(constants)
        model: Model = own.posterior.model
        effects = [effect for effect in model.effects if effect.name in self.relaxing]
        columns = [rows[:, own.columns[RELAXATION]]]
        columns += [rows[:, own.columns[effect.name]] for effect in effects]
        fractions, rates = _spectrum(_filling(model.relaxation, *effects), tuple(columns))
        return np.asarray(fractions)[: len(constants)], np.asarray(rates)[: len(constants)]

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


def _filling(*parts: Any) -> tuple[tuple[Any, tuple[tuple[int, ...], ...]], ...]:
    """Of laws and effects, the structure and the shapes of the fields."""
    found = []
    for part in parts:
        leaves, structure = jax.tree.flatten(part, is_leaf=is_prior)
        found.append((structure, tuple(value_shape(leaf) for leaf in leaves)))
    return tuple(found)


def _filled(structure: Any, shapes: tuple[tuple[int, ...], ...], constants: JaxArray) -> Any:
    """A law or effect with constants (P,) in its fields."""
    ends = np.cumsum([math.prod(shape) for shape in shapes])[:-1].tolist()
    parts = jnp.split(constants, ends)
    values = [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
    return jax.tree.unflatten(structure, values)


@partial(jax.jit, static_argnums=0)
def _elastic_curves(structure: Any, depths: JaxArray, constants: JaxArray) -> JaxArray:
    """(K, places) of constants (K, count) of an elastic law."""

    def one(row: JaxArray) -> JaxArray:
        law: AbstractElastic = jax.tree.unflatten(structure, list(row))
        return law.force(depths)

    return jax.vmap(one)(constants)


@partial(jax.jit, static_argnums=0)
def _spectrum(filling: Any, columns: tuple[JaxArray | Array, ...]) -> tuple[JaxArray, JaxArray]:
    """Fractions (K, L + 1) and rates (K, L) of a relaxation and what acts on it, by constants.

    Plain arrays: to take modules apart at every call would cost as much as a force.
    """

    def one(columns: tuple[Any, ...]) -> tuple[JaxArray, JaxArray]:
        pairs = zip(filling, columns, strict=True)
        relaxation, *effects = [
            _filled(structure, shapes, own) for (structure, shapes), own in pairs
        ]
        found: tuple[JaxArray, JaxArray] = relaxation.spectrum()
        for effect in effects:
            found = effect.spectrum(*found)
        return found

    return jax.vmap(one)(columns)


@jax.jit
def _unconstrained(prior: AbstractPrior, values: JaxArray) -> JaxArray:
    return jax.vmap(prior.unconstrain)(values)


def median(draws: Iterable[Array]) -> Array:
    """Of draws (N, F), each number by itself."""
    return np.asarray(np.median(np.asarray(list(draws)), axis=0))
