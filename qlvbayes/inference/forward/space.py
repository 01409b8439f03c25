"""Hold what all hypotheses about one record are made of, and compute what they predict.

Every hypothesis has a posterior of its own, under the noise floor as measured. One `ForceEngine`
computes the forces of all.
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
from qlvbayes.inference.forward.engine import ConstantSets, ForceEngine, LayerChain
from qlvbayes.inference.forward.fixedrates import FixedRates, relaxation_of
from qlvbayes.inference.forward.hypothesis import (
    ELASTIC,
    RELAXATION,
    Hypothesis,
    Parameters,
    few_sizes,
)
from qlvbayes.io.arrays import Array
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.model.posterior import Posterior, is_prior, value_shape
from qlvbayes.motion.record import Record
from qlvbayes.priors.distributions import AbstractPrior
from qlvbayes.priors.natural import Natural, natural

FEW = 4
"""Largest number of modes of a spectrum that is computed as it is, without fixed rates."""
_DRAWS = 25  # of each prior, for medians, quantiles and starts
_GRID = 40  # depths, or times, at which the curves of laws are compared


@dataclass(frozen=True, eq=False)
class Space:
    """The record, laws and effects, with priors, from which hypotheses are formed."""

    record: Record
    # elastic, relaxation: laws by name
    elastic: dict[str, AbstractElastic]
    relaxation: dict[str, AbstractRelaxation]
    effects: dict[str, AbstractEffect]  # candidates by name, with `Natural` amplitudes
    noise: AbstractNoise  # the floor, with fixed parameters
    bonded: bool  # whether the specimen is fixed to the indenter
    _engine: ForceEngine = field(default_factory=ForceEngine)
    _cache: dict[Hypothesis, Parameters] = field(default_factory=dict)
    _chains: dict[Hypothesis, tuple[LayerChain, list[slice]]] = field(default_factory=dict)
    _draws: dict[tuple[str, str, int], Array] = field(default_factory=dict)
    _rates: dict[int, tuple[Record, FixedRates]] = field(default_factory=dict)

    def with_effects(self, effects: dict[str, AbstractEffect]) -> Space:
        """Return the space with other priors of its effects."""
        laws = {key: own for key, own in self._draws.items() if key[0] != "effects"}
        return replace(self, effects=effects, _cache={}, _chains={}, _draws=laws)

    @cached_property
    def real(self) -> NDArray[np.bool_]:
        """Return a mask (T, B) of the blocks that are not padding."""
        return np.asarray(self.record.blocks.real)

    def parameters(self, hypothesis: Hypothesis) -> Parameters:
        """Return the free parameters of a hypothesis."""
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
            self._cache[hypothesis] = Parameters.from_posterior(hypothesis, posterior)
        return self._cache[hypothesis]

    def forces(
        self, hypothesis: Hypothesis, constants: Array, record: Record | None = None
    ) -> Array:
        """Return block means (K, T, B) of the force (N) at constants (K, P)."""
        record = record or self.record
        sets = self._sets(hypothesis, constants, self._fixed(record))
        return self._engine.forces(self._chain(hypothesis)[0], sets, record)

    def _fixed(self, record: Record) -> FixedRates:
        """Return the rates by which long spectra are represented over a record."""
        if id(record) not in self._rates:  # the record is kept too, so that its id stays unique
            self._rates[id(record)] = record, FixedRates.over(np.asarray(record.motion.time))
        return self._rates[id(record)][1]

    def added_force(self, hypothesis: Hypothesis, theta: Array, number: int, size: float) -> Array:
        """Return the force (T, B) in N that ``size`` more of one parameter adds at theta (F,)."""
        added = theta.copy()
        added[number] += size
        constants = self.parameters(hypothesis).constants(np.stack([theta, added]))
        before, after = self.forces(hypothesis, constants)
        return np.asarray(after - before)

    @cached_property
    def curve_grids(self) -> tuple[Array, Array]:
        """Return the depths (mm) and times (s) at which curves of laws are compared, (40,) each."""
        motion = self.record.motion
        time = np.asarray(motion.time)
        steps = np.diff(time, axis=-1)
        depth, least = float(np.max(motion.displacement)), float(steps[steps > 0.0].min())
        return np.linspace(0.0, depth, _GRID), np.geomspace(least, float(time.max()), _GRID)

    def indices_of(self, hypothesis: Hypothesis, part: str) -> list[int]:
        """Return the indices in theta of a hypothesis's elastic law or relaxation."""
        elastic = self.draws("elastic", hypothesis.elastic).shape[1]
        if part == "elastic":
            return list(range(elastic))
        count = self.draws("relaxation", hypothesis.relaxation).shape[1]
        own = self.parameters(hypothesis).by_name.items()
        effects = tuple(f"{name}." for name in hypothesis.effects & self.relaxing)
        of_effects = [k for name, leaf in own if name.startswith(effects) for k in leaf.theta]
        return [*range(elastic, elastic + count), *(of_effects if effects else [])]

    def draws_of(self, hypothesis: Hypothesis, part: str, seed: int = 0) -> Array:
        """Return prior draws (25, size) of the parameters that `indices_of` names."""
        parts = [self.draws(part, getattr(hypothesis, part), seed)]
        if part == "relaxation":
            names = [name for name in self._nested(hypothesis) if name in self.relaxing]
            parts += [self.draws("effects", name, seed) for name in names]
        return np.concatenate(parts, axis=1)

    def curve(self, hypothesis: Hypothesis, part: str, constants: Array) -> Array:
        """Return the curves (K, 40) of a law at constants (K, P)."""
        if part == "elastic":
            law = _emptied(self.elastic[hypothesis.elastic])
            columns = few_sizes(constants[:, self.parameters(hypothesis).columns[ELASTIC]])
            forces = _elastic_curves(jax.tree.structure(law), self.curve_grids[0], columns)
            return np.asarray(forces)[: len(constants)]
        return relaxation_of(*self.spectra(hypothesis, constants), self.curve_grids[1])

    @cached_property
    def relaxing(self) -> frozenset[str]:
        """Return the names of the effects that act on the relaxation function alone."""
        every = {name: type(effect) for name, effect in self.effects.items()}
        return frozenset(n for n, k in every.items() if k.spectrum is not AbstractEffect.spectrum)

    def _chain(self, hypothesis: Hypothesis) -> tuple[LayerChain, list[slice]]:
        """Return the chain of layers, and the columns of the constants that each layer takes."""
        if hypothesis not in self._chains:
            parameters = self.parameters(hypothesis)
            model: Model = _emptied(parameters.posterior.model)
            for name in hypothesis.effects & self.relaxing:
                model = model.without(name)
            law, none = model.law, slice(0, 0)
            names = [getattr(layer, "name", None) for layer in law.layers]
            columns = [parameters.columns.get(name, none) if name else none for name in names]
            self._chains[hypothesis] = LayerChain.from_law(law), columns
        return self._chains[hypothesis]

    def _sets(self, hypothesis: Hypothesis, constants: Array, fixed: FixedRates) -> ConstantSets:
        """Return constants (K, P) by law and layer; long spectra are represented by fixed rates."""
        fractions, rates = self.spectra(hypothesis, constants)
        if rates.shape[1] > FEW:
            fractions, rates = fixed.fractions(fractions, rates), fixed.rates
        elastic = self.parameters(hypothesis).columns[ELASTIC]
        layers = tuple(constants[:, columns] for columns in self._chain(hypothesis)[1])
        return ConstantSets(constants[:, elastic], fractions, rates, layers)

    def spectra(self, hypothesis: Hypothesis, constants: Array) -> tuple[Array, Array]:
        """Return fractions (K, L + 1) and rates (K, L), changed by the effects that act on them."""
        parameters, rows = self.parameters(hypothesis), few_sizes(constants)
        model: Model = parameters.posterior.model
        effects = [effect for effect in model.effects if effect.name in self.relaxing]
        columns = [rows[:, parameters.columns[RELAXATION]]]
        columns += [rows[:, parameters.columns[effect.name]] for effect in effects]
        fractions, rates = _spectrum(_filling(model.relaxation, *effects), tuple(columns))
        return np.asarray(fractions)[: len(constants)], np.asarray(rates)[: len(constants)]

    def draws(self, part: str, name: str, seed: int = 0) -> Array:
        """Return draws (25, size) from the priors of a law or effect, which depend on the seed."""
        if (part, name, seed) not in self._draws:
            rng = np.random.default_rng(seed)
            columns = []
            for leaf in jax.tree.leaves(getattr(self, part)[name], is_leaf=is_prior):
                if is_prior(leaf):
                    values = np.stack([leaf.draw(rng) for _ in range(_DRAWS)])
                    columns.append(np.asarray(_unconstrained(leaf, values)).reshape(_DRAWS, -1))
            self._draws[(part, name, seed)] = np.concatenate(
                [np.zeros((_DRAWS, 0)), *columns], axis=1
            )
        return self._draws[(part, name, seed)]

    def prior_draws(self, hypothesis: Hypothesis, seed: int = 0) -> Array:
        """Return draws (25, F) of a hypothesis's free parameters from their priors."""
        parts = [("elastic", hypothesis.elastic), ("relaxation", hypothesis.relaxation)]
        parts += [("effects", name) for name in self._nested(hypothesis)]
        return np.concatenate([self.draws(*part, seed) for part in parts], axis=1)

    def _nested(self, hypothesis: Hypothesis) -> list[str]:
        """Return the names of a hypothesis's effects, in the order in which they nest."""
        model = self.parameters(hypothesis).posterior.model
        return [effect.name for effect in model.effects]


def in_natural_amplitude(effect: AbstractEffect, factor: float = 1.0) -> AbstractEffect:
    """Return the effect with a prior on its amplitude itself, its sd scaled by ``factor``."""
    name = next(iter(effect.null))
    prior = natural(getattr(effect, name))
    if isinstance(prior, Natural):
        prior = eqx.tree_at(lambda p: p.inner.sd, prior, factor * prior.sd)
    changed: AbstractEffect = eqx.tree_at(
        lambda e: getattr(e, name), effect, prior, is_leaf=is_prior
    )
    return changed


def _emptied(part: Any) -> Any:
    """Return a law or effect with zeros in place of its priors."""
    return jax.tree.map(lambda leaf: 0.0, part, is_leaf=is_prior)


def _filling(*parts: Any) -> tuple[tuple[Any, tuple[tuple[int, ...], ...]], ...]:
    """Return the structure and the shapes of the fields of some laws and effects."""
    shapes = []
    for part in parts:
        leaves, structure = jax.tree.flatten(part, is_leaf=is_prior)
        shapes.append((structure, tuple(value_shape(leaf) for leaf in leaves)))
    return tuple(shapes)


def _filled(structure: Any, shapes: tuple[tuple[int, ...], ...], constants: JaxArray) -> Any:
    """Return a law or effect with constants (P,) in its fields."""
    ends = np.cumsum([math.prod(shape) for shape in shapes])[:-1].tolist()
    parts = jnp.split(constants, ends)
    values = [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
    return jax.tree.unflatten(structure, values)


@partial(jax.jit, static_argnums=0)
def _elastic_curves(structure: Any, depths: JaxArray, constants: JaxArray) -> JaxArray:
    """Return the elastic forces (K, D) at depths (D,) of constants (K, count)."""

    def one(row: JaxArray) -> JaxArray:
        law: AbstractElastic = jax.tree.unflatten(structure, list(row))
        return law.force(depths)

    return jax.vmap(one)(constants)


@partial(jax.jit, static_argnums=0)
def _spectrum(filling: Any, columns: tuple[JaxArray | Array, ...]) -> tuple[JaxArray, JaxArray]:
    """Return fractions (K, L + 1) and rates (K, L) of a relaxation and the effects on it."""

    def one(columns: tuple[Any, ...]) -> tuple[JaxArray, JaxArray]:
        pairs = zip(filling, columns, strict=True)
        relaxation, *effects = [
            _filled(structure, shapes, values) for (structure, shapes), values in pairs
        ]
        spectrum: tuple[JaxArray, JaxArray] = relaxation.spectrum()
        for effect in effects:
            spectrum = effect.spectrum(*spectrum)
        return spectrum

    return jax.vmap(one)(columns)


@jax.jit
def _unconstrained(prior: AbstractPrior, values: JaxArray) -> JaxArray:
    """Return the free parameters (K, size) of a prior at values (K, ...)."""
    return jax.vmap(prior.unconstrain)(values)


def median(draws: Iterable[Array]) -> Array:
    """Return the median (F,) of draws (N, F), parameter by parameter."""
    return np.asarray(np.median(np.asarray(list(draws)), axis=0))
