"""Hold what all hypotheses about one record are made of, and compute what they predict.

Every hypothesis has parameters of its own, under the noise floor as measured.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import jax
import numpy as np
from numpy.typing import NDArray

from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.inference.forward.fixedrates import FixedRates, relaxation_of
from qlvbayes.inference.forward.forces import Forces
from qlvbayes.inference.forward.hypothesis import (
    ELASTIC,
    RELAXATION,
    Hypothesis,
    Parameters,
)
from qlvbayes.io.arrays import Array
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.relaxation.prony import Prony, Spectrum
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.model.parameters import filled, is_prior, unconstrained
from qlvbayes.motion.record import Record
from qlvbayes.priors.distributions import HalfNormal, Normal, SignedAmplitude
from qlvbayes.pytree import Pytree

FEW = 4
"""Largest number of modes of a spectrum that is computed as it is, without fixed rates."""
STEP = 1e-5
"""Natural lengths of a difference quotient: half the digits of a float64."""
_DRAWS = 25  # of each prior, for medians, quantiles and starts
_GRID = 40  # depths, or times, at which the curves of laws are compared


@dataclass(frozen=True, eq=False)
class Space:
    """The record, laws and effects, with priors, from which hypotheses are formed."""

    record: Record
    # elastic, relaxation: laws by name
    elastic: dict[str, AbstractElastic]
    relaxation: dict[str, AbstractRelaxation]
    effects: dict[str, AbstractEffect]  # candidates by name, `in_natural_amplitude`
    noise: AbstractNoise  # the floor, with fixed parameters
    bonded: bool  # whether the specimen is fixed to the indenter
    _forces: Forces = field(default_factory=Forces)
    _cache: dict[Hypothesis, Parameters] = field(default_factory=dict)
    _draws: dict[tuple[str, str, int], Array] = field(default_factory=dict)
    _rates: dict[int, tuple[Record, FixedRates]] = field(default_factory=dict)

    def with_effects(self, effects: dict[str, AbstractEffect]) -> Space:
        """Return the space with other priors of its effects."""
        laws = {key: own for key, own in self._draws.items() if key[0] != "effect"}
        return replace(self, effects=effects, _cache={}, _draws=laws)

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
            self._cache[hypothesis] = Parameters.from_model(hypothesis, model, self.noise)
        return self._cache[hypothesis]

    def forces(
        self, hypothesis: Hypothesis, constants: Array, record: Record | None = None
    ) -> Array:
        """Return block means (K, T, B) of the force (N) at constants (K, P)."""
        record = record or self.record
        model = self._model(hypothesis, constants, self._fixed(record))
        return self._forces.over(model, len(constants), record)

    def residuals(
        self, hypothesis: Hypothesis, thetas: Array, largest: float
    ) -> tuple[NDArray[np.intp], Array, Array]:
        """Return indices (R,) of thetas (K, F) that have a density, log priors (R,) and residuals.

        The others lie beyond the bounds, or give a force that is not finite or leaves more than
        ``largest`` (N). The residuals (R, T, B) are measured minus predicted block means (N).
        """
        own = self.parameters(hypothesis)
        inside = np.flatnonzero(np.all((thetas >= own.lowest) & (thetas <= own.highest), axis=1))
        if not inside.size:
            return inside, np.zeros(0), np.zeros((0, *self.real.shape))
        constants, priors = own.bound(thetas[inside])
        residuals = np.asarray(self.record.blocks.force) - self.forces(hypothesis, constants)
        sound = np.abs(residuals).max(axis=(1, 2)) < largest  # false for NaN
        return inside[sound], priors[sound], residuals[sound]

    def _fixed(self, record: Record) -> FixedRates:
        """Return the rates by which long spectra are represented over a record."""
        if id(record) not in self._rates:  # the record is kept too, so that its id stays unique
            self._rates[id(record)] = record, FixedRates.over(np.asarray(record.motion.time))
        return self._rates[id(record)][1]

    def forces_and_slopes(self, hypothesis: Hypothesis, theta: Array) -> tuple[Array, Array, Array]:
        """Return constants (1 + F, P), block means (T, B) and their derivatives (F, T, B).

        The derivatives at theta (F,) are differences of two forces; the constants beyond the first
        row are those of the steps.
        """
        parameters = self.parameters(hypothesis)
        steps = STEP * parameters.length
        constants = parameters.constants(np.concatenate([theta[None], theta + np.diag(steps)]))
        forces = self.forces(hypothesis, constants)
        return constants, forces[0], (forces[1:] - forces[0]) / steps[:, None, None]

    def added_forces(
        self, hypothesis: Hypothesis, thetas: Array, number: int, size: float
    ) -> Array:
        """Return what ``size`` more of one parameter adds (S, T, B) in N at thetas (S, F)."""
        added = thetas.copy()
        added[:, number] += size
        constants = self.parameters(hypothesis).constants(np.concatenate([added, thetas]))
        forces = self.forces(hypothesis, constants)
        return np.asarray(forces[: len(thetas)] - forces[len(thetas) :])

    @cached_property
    def curve_grids(self) -> tuple[Array, Array]:
        """Return the depths (mm) and times (s) at which curves of laws are compared, (40,) each."""
        motion = self.record.motion
        time = np.asarray(motion.time)
        steps = np.diff(time, axis=-1)
        depth, least = float(np.max(motion.displacement)), float(steps[steps > 0.0].min())
        return np.linspace(0.0, depth, _GRID), np.geomspace(least, float(time.max()), _GRID)

    def indices_of(self, hypothesis: Hypothesis, part: str) -> list[int]:
        """Return the indices in theta of a hypothesis's elastic law or relaxation.

        To the relaxation belong the effects that act on it alone.
        """
        own = self.parameters(hypothesis)
        names = [part, *(hypothesis.effects & self.relaxing if part == RELAXATION else ())]
        some = [own.columns[name] for name in names]
        starts = [(leaf, leaf.constants.start) for leaf in own.leaves]
        inside = [leaf for leaf, k in starts if any(one.start <= k < one.stop for one in some)]
        return [k for leaf in inside for k in leaf.theta]

    def curve(self, hypothesis: Hypothesis, part: str, constants: Array) -> Array:
        """Return the curves (K, 40) of a law at constants (K, P)."""
        if part == "elastic":
            rows = constants[:, self.parameters(hypothesis).columns[ELASTIC]].T
            law = filled(self.elastic[hypothesis.elastic], rows)
            with np.errstate(all="ignore"):
                forces = law.force(self.curve_grids[0][:, None])
            return np.broadcast_to(forces, (_GRID, len(constants))).T
        return relaxation_of(*self.spectra(hypothesis, constants), self.curve_grids[1])

    @cached_property
    def relaxing(self) -> frozenset[str]:
        """Return the names of the effects that act on the relaxation function alone."""
        every = {name: type(effect) for name, effect in self.effects.items()}
        return frozenset(n for n, k in every.items() if k.spectrum is not AbstractEffect.spectrum)

    def _model(self, hypothesis: Hypothesis, constants: Array, fixed: FixedRates) -> Model:
        """Return the model of constants (K, P); long spectra are represented by fixed rates."""
        fractions, rates = self.spectra(hypothesis, constants)
        if rates.shape[1] > FEW:
            fractions = fixed.fractions(fractions, rates)
            rates = np.broadcast_to(fixed.rates, (len(constants), fixed.rates.size))
        model = self.parameters(hypothesis).model_at(constants.T)
        for name in hypothesis.effects & self.relaxing:
            model = model.without(name)
        return replace(model, relaxation=Spectrum(fractions.T, rates.T))

    def spectra(self, hypothesis: Hypothesis, constants: Array) -> tuple[Array, Array]:
        """Return fractions (K, L + 1) and rates (K, L), changed by the effects that act on them."""
        parameters = self.parameters(hypothesis)
        index = which = np.arange(len(constants))
        if not isinstance(parameters.model.relaxation, Prony):
            # sets that differ elsewhere share a spectrum: a continuous one costs more than a force
            acting = [RELAXATION, *(hypothesis.effects & self.relaxing)]
            columns = np.concatenate([constants[:, parameters.columns[x]] for x in acting], axis=1)
            _, index, which = np.unique(columns, axis=0, return_index=True, return_inverse=True)
        model = parameters.model_at(constants[index].T)
        with np.errstate(all="ignore"):
            spectrum = _spectrum(model.relaxation, len(index))
            for effect in model.effects:
                if effect.name in self.relaxing:
                    changed = effect.spectrum(*spectrum)
                    assert changed is not None
                    spectrum = changed
        fractions, rates = (np.broadcast_to(x.T, (len(index), len(x))) for x in spectrum)
        return fractions[which], rates[which]

    def prior_draws(self, hypothesis: Hypothesis, seed: int = 0) -> Array:
        """Return draws (25, F) of a hypothesis's free parameters from their priors.

        Those of a law or an effect are the same in every hypothesis that has it.
        """
        model = self.parameters(hypothesis).model
        parts: dict[tuple[str, str], Pytree] = {
            (ELASTIC, hypothesis.elastic): model.elastic,
            (RELAXATION, hypothesis.relaxation): model.relaxation,
            **{("effect", effect.name): effect for effect in model.effects},
        }
        for name, part in parts.items():
            if (*name, seed) not in self._draws:
                rng, columns = np.random.default_rng(seed), [np.zeros((_DRAWS, 0))]
                for leaf in filter(is_prior, jax.tree.leaves(part, is_leaf=is_prior)):
                    values = np.stack([leaf.draw(rng) for _ in range(_DRAWS)])
                    columns.append(unconstrained(leaf, values))
                self._draws[(*name, seed)] = np.concatenate(columns, axis=1)
        return np.concatenate([self._draws[(*name, seed)] for name in parts], axis=1)


def in_natural_amplitude(effect: AbstractEffect, factor: float = 1.0) -> AbstractEffect:
    """Return the effect with a prior on its amplitude itself, its sd scaled by ``factor``."""
    name = next(iter(effect.null))
    prior = getattr(effect, name)
    if isinstance(prior, Normal):
        return replace(effect, **{name: SignedAmplitude(prior.mean, factor * float(prior.sd))})
    if isinstance(prior, HalfNormal):
        return replace(effect, **{name: HalfNormal(factor * float(prior.sd))})
    return effect


def _spectrum(relaxation: AbstractRelaxation, count: int) -> tuple[Array, Array]:
    """Return fractions (L + 1, K) and rates (L, K) of a relaxation of K = ``count`` sets."""
    if type(relaxation).__module__.startswith("qlvbayes."):
        return relaxation.spectrum()
    # a user's own law may know of one set only
    sets = [jax.tree.map(lambda x, k=k: x[..., k], relaxation) for k in range(count)]
    pairs = zip(*(one.spectrum() for one in sets), strict=True)
    fractions, rates = (np.stack(list(map(np.asarray, some)), axis=-1) for some in pairs)
    return fractions, rates
