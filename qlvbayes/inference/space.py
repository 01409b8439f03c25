"""Hypotheses about one specimen: a base law and a set of effects, and the numbers each leaves free.

Every hypothesis has a posterior of its own, under the noise floor as it was measured; all are run
by one `Engine`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
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
from qlvbayes.inference.engine import FEW, Engine, filled_up
from qlvbayes.inference.fixedrates import FixedRates, relaxation_of
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.model.parameters import names
from qlvbayes.model.posterior import Posterior, is_prior, value_shape
from qlvbayes.preprocess.record import Record
from qlvbayes.priors.distributions import AbstractPrior
from qlvbayes.priors.natural import AbstractDirect, Natural, Quadratic, natural

Array = NDArray[np.float64]

_DRAWS = 25  # of each prior, for medians, quantiles and starts
_LEAST = 16  # rows of constants that are computed at once: what has few takes no time
_PLACES = 40  # depths, or times, at which laws are compared


@dataclass(frozen=True)
class Hypothesis:
    """An elastic law, a relaxation and a set of effects, by name."""

    elastic: str
    relaxation: str
    effects: frozenset[str] = frozenset()

    @property
    def base(self) -> tuple[str, str]:
        """Its laws."""
        return self.elastic, self.relaxation

    def plus(self, effect: str) -> Hypothesis:
        """With one more effect."""
        return replace(self, effects=self.effects | {effect})

    def less(self, effect: str) -> Hypothesis:
        """Without one of its effects."""
        return replace(self, effects=self.effects - {effect})


@dataclass(frozen=True, eq=False)
class Leaf:
    """One field: its prior, its places in theta, and in a hypothesis's constants."""

    prior: AbstractPrior
    theta: range
    constants: range

    @cached_property
    def flat(self) -> tuple[Any, tuple[Array, ...]]:
        """The prior's structure and numbers: JAX takes them faster than the prior itself."""
        numbers, structure = jax.tree.flatten(self.prior)
        return structure, tuple(np.asarray(number, dtype=float) for number in numbers)

    def values(self, thetas: Array) -> Array:
        """(K, ...) values of rows of all free numbers (K, F)."""
        own = thetas[:, self.theta.start : self.theta.stop]
        return np.asarray(_value(*self.flat, _few_sizes(own)))[: len(thetas)]


@dataclass(frozen=True, eq=False)
class Direct:
    """The free numbers whose priors are quadratic in them, all at once.

    theta, constants (Q,): their places in theta and in the constants; in_log (Q,): which are
    logarithms; mean, precision, curvature (Q,); top: sum of the log densities' tops.
    """

    theta: NDArray[np.intp]
    constants: NDArray[np.intp]
    in_log: NDArray[np.bool_]
    mean: Array
    precision: Array
    curvature: Array
    top: float

    @classmethod
    def of(cls, leaves: Iterable[Leaf]) -> Direct:
        """Of those among some fields that have such a prior."""
        pairs = [(leaf, p) for leaf in leaves if isinstance(p := leaf.prior, AbstractDirect)]
        densities = [prior.density() for _, prior in pairs]
        return cls(
            np.array([leaf.theta.start for leaf, _ in pairs], dtype=np.intp),
            np.array([leaf.constants.start for leaf, _ in pairs], dtype=np.intp),
            np.array([prior.in_log for _, prior in pairs], dtype=bool),
            np.array([one.mean for one in densities]),
            np.array([one.precision for one in densities]),
            np.array([one.curvature for one in densities]),
            sum(one.top for one in densities),
        )

    def values(self, thetas: Array) -> Array:
        """(K, Q) constants of thetas (K, F)."""
        own = thetas[:, self.theta]
        own[:, self.in_log] = np.exp(own[:, self.in_log])
        return own


@dataclass(frozen=True, eq=False)
class Parameters:
    """What a hypothesis leaves free: F numbers theta, P constants in the order of ``names``.

    lowest, highest, length (F,): bounds and natural length of each free number; fixed (P,):
    constants that are not free, nan elsewhere; direct: numbers whose prior is quadratic in them;
    joint: the other fields.
    """

    hypothesis: Hypothesis
    posterior: Posterior
    leaves: tuple[Leaf, ...]
    lowest: Array
    highest: Array
    length: Array
    fixed: Array
    direct: Direct
    joint: tuple[Leaf, ...]

    @classmethod
    def of(cls, hypothesis: Hypothesis, posterior: Posterior) -> Parameters:
        """Of a posterior whose noise is fixed."""
        leaves: list[Leaf] = []
        fixed, bounds = [np.zeros(0)], [np.zeros((0, 3))]
        theta = constants = 0
        for leaf in jax.tree.leaves((posterior.model, posterior.noise), is_leaf=is_prior):
            if not is_prior(leaf):
                fixed.append(np.ravel(leaf))
                constants += fixed[-1].size
                continue
            count = int(np.prod(value_shape(leaf), dtype=int))
            places = range(theta, theta + leaf.size), range(constants, constants + count)
            leaves.append(Leaf(leaf, *places))
            bounds.append(np.tile(_bounds(leaf), (leaf.size, 1)))
            fixed.append(np.full(count, np.nan))
            theta, constants = theta + leaf.size, constants + count
        low, high, length = np.concatenate(bounds).T.copy()
        joint = tuple(leaf for leaf in leaves if not isinstance(leaf.prior, AbstractDirect))
        known = np.concatenate(fixed), Direct.of(leaves), joint
        return cls(hypothesis, posterior, tuple(leaves), low, high, length, *known)

    def within(self, thetas: Array) -> Array:
        """Thetas (..., F) brought back to the bounds that they are beyond."""
        return np.clip(thetas, self.lowest, self.highest)

    @property
    def size(self) -> int:
        """F."""
        return self.lowest.size

    @cached_property
    def names(self) -> list[str]:
        """Of the P constants."""
        return names(self.posterior)

    @cached_property
    def by_name(self) -> dict[str, Leaf]:
        """Fields by the name of their first constant, in the order of theta."""
        return {self.names[leaf.constants.start]: leaf for leaf in self.leaves}

    def quadratic(self, number: int) -> Quadratic:
        """Log prior density of a number that is taken as it is, by its place in theta."""
        prior = next(leaf.prior for leaf in self.leaves if leaf.theta.start == number)
        assert isinstance(prior, AbstractDirect)
        return prior.density()

    def carried(self, fewer: Parameters) -> list[int]:
        """Where in theta the numbers are of a hypothesis that leaves no others free."""
        return [place for name in fewer.by_name for place in self.by_name[name].theta]

    def constants(self, thetas: Array) -> Array:
        """(K, P) constants of thetas (K, F)."""
        found = np.tile(self.fixed, (len(thetas), 1))
        found[:, self.direct.constants] = self.direct.values(thetas)
        for leaf in self.joint:
            here = slice(leaf.constants.start, leaf.constants.stop)
            found[:, here] = leaf.values(thetas).reshape(len(thetas), -1)
        return found


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
        which = list(self.elastic).index(hypothesis.elastic)
        record = record or self.record
        rows, lanes = self._rows(hypothesis, constants, self._fixed(record))
        return self.engine.forces(which, lanes, hypothesis.effects, rows, record)

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
        count, full = self._counts[hypothesis.elastic], _few_sizes(constants)
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
        self, hypothesis: Hypothesis, constants: Array, fixed: FixedRates
    ) -> tuple[Array, int]:
        """(K, R) rows of the engine, and their lanes."""
        count = self._counts[hypothesis.elastic]
        elastic = np.zeros((len(constants), self.engine.width))
        elastic[:, :count] = constants[:, :count]
        shapes = self._shapes[hypothesis.relaxation]
        structure = self._structures[hypothesis.relaxation]
        fractions, rates = _spectra(structure, shapes, constants[:, count:])
        lanes = FEW if rates.shape[1] <= FEW else fixed.rates.size
        if rates.shape[1] > lanes:
            fractions = fixed.fractions(fractions, rates)
            rates = np.tile(fixed.rates, (len(rates), 1))
        missing = lanes - rates.shape[1]
        fractions = np.pad(fractions, ((0, 0), (0, missing)))
        rates = np.pad(rates, ((0, 0), (0, missing)), constant_values=1.0)
        slots = self.engine.slots
        effects = np.tile(self._null, (len(constants), 1))
        start = count + sum(math.prod(shape) for shape in shapes)
        for name in sorted(hypothesis.effects, key=lambda name: slots[name].start):
            width = len(slots[name])
            effects[:, slots[name].start : slots[name].stop] = constants[:, start : start + width]
            start += width
        return np.concatenate([elastic, fractions, rates, effects], axis=1), lanes

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


def _bounds(prior: AbstractPrior) -> tuple[float, float, float]:
    """Least and largest of a prior's numbers, and their natural length."""
    if isinstance(prior, AbstractDirect):
        return prior.density()[:3]
    return -math.inf, math.inf, 1.0


def _emptied(part: Any) -> Any:
    """A law or effect with numbers of no account in the place of its priors."""
    return jax.tree.map(lambda leaf: 0.0, part, is_leaf=is_prior)


def _few_sizes(rows: Array) -> Array:
    """Rows (K, ...) and the first of them again, up to 16, 64, 256 ...: few sizes are compiled."""
    size = _LEAST
    while size < len(rows):
        size *= 4
    return filled_up(rows, size)


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
        filled.append(_few_sizes(part))
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


@partial(jax.jit, static_argnums=0)
def _value(structure: Any, prior: tuple[Array, ...], numbers: JaxArray) -> JaxArray:
    """(K, ...) values of numbers (K, size), by a flattened prior."""
    whole: AbstractPrior = jax.tree.unflatten(structure, prior)
    return jax.vmap(lambda x: whole.constrain(x)[0])(numbers)


@jax.jit
def _unconstrained(prior: AbstractPrior, values: JaxArray) -> JaxArray:
    return jax.vmap(prior.unconstrain)(values)


def median(draws: Iterable[Array]) -> Array:
    """Of draws (N, F), each number by itself."""
    return np.asarray(np.median(np.asarray(list(draws)), axis=0))
