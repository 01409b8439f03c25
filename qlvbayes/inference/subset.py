"""A posterior of which only some effects are switched on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import jax
import numpy as np

from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.model.parameters import names, unit_kinds
from qlvbayes.model.posterior import Posterior, draw_priors, is_prior, value_shape
from qlvbayes.model.record import Record

_DRAWS = 25


@dataclass(frozen=True)
class Place:
    """Where one field's numbers lie: in theta, in the constants, and which prior (None: fixed)."""

    theta: range
    constants: range
    prior: int | None


@dataclass(frozen=True, eq=False)
class Ensemble:
    """One posterior that holds every candidate effect, each at its null unless switched on.

    All subsets share the functions compiled for the whole, or for a smaller part that holds the
    effects at work. ``costly`` effects run the law beneath several times; parts without them are
    kept apart. ``own`` effects belong to the model and are always on.
    """

    posterior: Posterior
    costly: tuple[str, ...] = ()
    own: frozenset[str] = frozenset()
    _cache: dict[frozenset[str], Subset] = field(default_factory=dict)

    @cached_property
    def places(self) -> list[Place]:
        """One entry a field, in field order."""
        found, theta, constants, prior = [], 0, 0, 0
        parts = (self.posterior.model, self.posterior.noise)
        for leaf in jax.tree.leaves(parts, is_leaf=is_prior):
            count = int(np.prod(value_shape(leaf), dtype=int))
            size = leaf.size if is_prior(leaf) else 0
            found.append(
                Place(
                    range(theta, theta + size),
                    range(constants, constants + count),
                    prior if is_prior(leaf) else None,
                )
            )
            theta, constants, prior = theta + size, constants + count, prior + bool(size)
        return found

    @cached_property
    def names(self) -> list[str]:
        """Names of all constants."""
        return names(self.posterior)

    @property
    def candidates(self) -> list[str]:
        """Names of the effects that may be switched on."""
        return [effect.name for effect in self.effects if effect.name not in self.own]

    @property
    def effects(self) -> tuple[AbstractEffect, ...]:
        """Every effect, the model's own ones too."""
        return self.posterior.model.effects

    def effect(self, name: str) -> AbstractEffect:
        """The candidate of that name."""
        return next(effect for effect in self.effects if effect.name == name)

    def owner(self, place: Place) -> str | None:
        """Name of the effect that a field belongs to; None for the plain model and the noise."""
        stem = self.names[place.constants.start].partition(".")[0]
        return stem if stem in {effect.name for effect in self.effects} else None

    @cached_property
    def _fields(self) -> dict[str | None, list[Place]]:
        found: dict[str | None, list[Place]] = {}
        for place in self.places:
            found.setdefault(self.owner(place), []).append(place)
        return found

    @cached_property
    def _nulls(self) -> list[tuple[str, int, float]]:
        """Effect, place and value of every constant at whose null an effect vanishes."""
        return [
            (effect.name, self.names.index(f"{effect.name}.{name}"), value)
            for effect in self.effects
            for name, value in effect.null.items()
        ]

    def fields(self, effect: str) -> list[Place]:
        """The fields of one effect."""
        return self._fields[effect]

    def amplitude(self, effect: str) -> int:
        """Place among the constants of an effect's amplitude."""
        first = next(iter(self.effect(effect).null))
        return self.names.index(f"{effect}.{first}")

    @cached_property
    def unit_kinds(self) -> list[str]:
        """Kind of unit of each constant."""
        return unit_kinds(self.posterior)

    @cached_property
    def _draws(self) -> np.ndarray:
        """(N, D) draws of the priors."""
        return draw_priors(self.posterior, _DRAWS, np.random.default_rng(0))

    @property
    def centre(self) -> np.ndarray:
        """(D,) medians of the priors."""
        return np.median(self._draws, axis=0)

    @cached_property
    def plain(self) -> list[int]:
        """Places in theta of the plain model's numbers, without effects and noise."""
        noise = set(self.noise)
        return [i for place in self._fields[None] for i in place.theta if i not in noise]

    @cached_property
    def noise(self) -> list[int]:
        """Places of the noise's numbers in theta."""
        parts = self.places[-len(self.posterior.noise.units) :]
        return [i for place in parts for i in place.theta]

    def quantile(self, place: Place, share: float) -> np.ndarray:
        """That quantile of a field's prior, in its part of theta."""
        return np.quantile(self._draws[:, list(place.theta)], share, axis=0)

    def draw(self, count: int) -> np.ndarray:
        """(count, D) draws of the priors, the same at every call."""
        return self._draws[:count]

    @cached_property
    def parts(self) -> list[Part]:
        """Models of some of the effects, the cheapest first."""
        light = [name for half in self._halves for name in half]
        pairs = (some + one for some in (*self._halves, light) for one in self._costly)
        every = [effect.name for effect in self.effects]
        return [self._part(names) for names in (*self._usual, light, *pairs, every)]

    @property
    def _usual(self) -> list[list[str]]:
        return [[], *self._halves, *self._costly]

    @property
    def _halves(self) -> list[list[str]]:
        """Effects that are not costly: a model of half of them runs in little more than half."""
        light = [effect.name for effect in self.effects if effect.name not in self.costly]
        return [light[: len(light) // 2], light[len(light) // 2 :]]

    @property
    def _costly(self) -> list[list[str]]:
        return [[effect.name] for effect in self.effects if effect.name in self.costly]

    def _part(self, names: list[str]) -> Part:
        return Part.of(self, self.own | frozenset(names))

    def part(self, constants: np.ndarray, direction: np.ndarray | None = None) -> Part:
        """The cheapest part that holds every effect at work in constants (P,) or a direction."""
        working = {
            effect
            for effect, place, value in self._nulls
            if constants[place] != value or (direction is not None and direction[place])
        }
        return next(part for part in self.parts if working <= part.effects)

    def with_record(self, record: Record) -> Ensemble:
        """The same effects beside other tests; what does not hang on them is not found again."""
        whole = self.posterior
        other = replace(self, posterior=Posterior(whole.model, whole.noise, record))
        parts = [part.with_record(record) for part in self.parts]
        vars(other).update({**vars(self), "posterior": other.posterior, "parts": parts})
        return other

    def subset(self, effects: frozenset[str] | tuple[str, ...] = ()) -> Subset:
        """The posterior with these effects on."""
        key = frozenset(effects) | self.own
        if key not in self._cache:
            self._cache[key] = Subset.of(self, key)
        return self._cache[key]


@dataclass(frozen=True, eq=False)
class Part:
    """A posterior with some of the effects: places of its constants among those of the whole."""

    effects: frozenset[str]
    posterior: Posterior
    constants: np.ndarray

    @classmethod
    def of(cls, ensemble: Ensemble, effects: frozenset[str]) -> Part:
        """Leave out the other effects."""
        whole = ensemble.posterior
        model = whole.model
        for effect in ensemble.effects:
            if effect.name not in effects:
                model = model.without(effect.name)
        posterior = Posterior(model, whole.noise, whole.record)
        places = [ensemble.names.index(name) for name in names(posterior)]
        return cls(effects, posterior, np.array(places))

    def with_record(self, record: Record) -> Part:
        """The same part beside other tests."""
        own = self.posterior
        return replace(self, posterior=Posterior(own.model, own.noise, record))


@dataclass(frozen=True, eq=False)
class Subset:
    """Which numbers are free with some effects on.

    theta, constants, priors: places of the free ones; null: (P,) constants of what is off (nan
    where on); noise: places of the noise's constants.
    """

    effects: frozenset[str]
    theta: np.ndarray
    constants: np.ndarray
    priors: np.ndarray
    null: np.ndarray

    @classmethod
    def of(cls, ensemble: Ensemble, effects: frozenset[str]) -> Subset:
        """Find the places."""
        theta: list[int] = []
        constants: list[int] = []
        priors: list[int] = []
        for place in ensemble.places:
            owner = ensemble.owner(place)
            if owner is None or owner in effects:
                theta += place.theta
                constants += place.constants
                priors += [] if place.prior is None else [place.prior]
        null = np.full(len(ensemble.names), np.nan)
        for effect in ensemble.effects:
            if effect.name not in effects:
                for name, value in effect.null.items():
                    null[ensemble.names.index(f"{effect.name}.{name}")] = value
        return cls(effects, np.array(theta), np.array(constants), np.array(priors), null)

    def nulled(self, constants: np.ndarray) -> np.ndarray:
        """Constants (P,) with what is off at its null."""
        return np.where(np.isnan(self.null), constants, self.null)


def with_every_effect(
    posterior: Posterior, effects: tuple[AbstractEffect, ...], costly: tuple[str, ...] = ()
) -> Ensemble:
    """The posterior's model plus every candidate that it lacks."""
    model = posterior.model
    own = frozenset(effect.name for effect in model.effects)
    for effect in effects:
        model = model + effect
    return Ensemble(Posterior(model, posterior.noise, posterior.record), costly, own)
