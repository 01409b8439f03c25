"""Simulated pads with one effect each, drawn from the priors, and their posteriors."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.inference.evidence import evidence
from qlvbayes.inference.forward.hypothesis import Leaf, Parameters
from qlvbayes.inference.forward.space import Space
from qlvbayes.inference.importance import (
    BoundedStudentT,
    ImportanceSample,
    importance_sample,
    mixture_about,
)
from qlvbayes.inference.modes import Mode, distinct, find_mode, modes
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.model.noise import Correlated
from qlvbayes.model.parameters import draw_priors, is_prior
from qlvbayes.motion.noisefloor import NoiseFloor
from recovery.bench import bench

_ACROSS = (0.125, 0.375, 0.625, 0.875)  # quantiles of a constant's prior draws
_BETWEEN = 0.5  # of their sd: about half of what lies between two of these
_STARTS = 8  # draws of the priors, from which modes are looked for
_BEHIND = 8.0  # loss behind the best mode, at which a slice is left out
_WORTH = 100.0  # effective draws that do
_ROUNDS = 90  # of draws, at most
_AT_ONCE = 64  # sets of constants, so that few sizes are compiled


@dataclass(frozen=True, eq=False)
class Slice:
    """Loss at the mode, and a cloud about it that reaches to the next slices."""

    loss: float
    cloud: BoundedStudentT


def slices(density: Density, own: Parameters, effect: str, best: Mode) -> Iterator[Slice]:
    """Yield slices at quantiles of each constant of the effect, from the best mode.

    Where the amplitude may be zero the posterior has an arm along the whole prior of each further
    constant, such as a rate; where that is a rate of the pad, one along the amplitude.
    """
    draws = density.space.prior_draws(own.hypothesis)
    fields = {
        name.removeprefix(f"{effect}.").partition("[")[0]: leaf
        for name, leaf in own.by_name.items()
        if name.startswith(f"{effect}.")
    }
    middle = best.point.theta.copy()
    for leaf in fields.values():
        middle[list(leaf.theta)] = np.median(draws[:, list(leaf.theta)], axis=0)
    for field, leaf in fields.items():
        indices = list(leaf.theta)
        sds = _BETWEEN * draws[:, indices].std(axis=0)
        for share in _ACROSS:
            start = middle.copy()
            start[indices] = np.quantile(draws[:, indices], share, axis=0)
            held = _held(density, effect, field, leaf, start)
            kept = own.positions_of(held.space.parameters(own.hypothesis))
            mode = find_mode(held, own.hypothesis, start[kept])
            if mode is not None:
                start[kept] = mode.point.theta
                covariance = _along(density, own, start, indices, sds)
                yield Slice(mode.loss, BoundedStudentT.from_covariance(start, covariance))


def _held(density: Density, effect: str, field: str, leaf: Leaf, theta: Array) -> Density:
    """Return the density with one field of an effect fixed at its value at theta (F,)."""
    space = density.space
    value = leaf.values(theta[None])[0]
    fixed = eqx.tree_at(lambda e: getattr(e, field), space.effects[effect], value, is_leaf=is_prior)
    return density.with_space(space.with_effects({**space.effects, effect: fixed}))


def _along(density: Density, own: Parameters, theta: Array, held: list[int], sds: Array) -> Array:
    """Return the covariance (F, F) given and along the held parameters of sds (H,)."""
    point = density.at(own.hypothesis, theta)
    assert point is not None  # it was finite in the slice
    between = np.isfinite(own.lowest) & np.isfinite(own.highest)
    curvature = density.terms(point, 0.0).curvature + np.diag(between / own.length**2)
    free = np.setdiff1d(np.arange(own.size), held)
    inverse = np.linalg.inv(curvature[np.ix_(free, free)])
    direction = np.eye(own.size)[:, held]
    direction[free] = -inverse @ curvature[free][:, held]
    covariance = np.asarray((direction * sds**2) @ direction.T)
    covariance[np.ix_(free, free)] += inverse
    return covariance


@dataclass(frozen=True, eq=False)
class Pads:
    """Pads with this effect; the others of the space are at their nulls."""

    effect: str
    space: Space

    @cached_property
    def own(self) -> Parameters:
        """Free parameters: the law's constants and the effect's."""
        return self.space.parameters(bench().hypothesis(self.effect))

    @cached_property
    def constants(self) -> dict[str, int]:
        """Free constants of the effect: their names and indices."""
        stem = f"{self.effect}."
        return {
            name.removeprefix(stem): index
            for index, name in enumerate(self.own.names)
            if name.startswith(stem) and np.isnan(self.own.fixed[index])
        }

    def recovered(self, seed: int, k: int, shares: tuple[float, ...]) -> tuple[Array, Array, float]:
        """Return truth (C,), posterior quantiles (len(shares), C) and effective draws."""
        rng = np.random.default_rng([seed, zlib.crc32(self.effect.encode()), k])
        truth = self.own.constants(draw_priors(self.own.posterior, 1, rng))
        sampled = self._sampled(self._tested(truth, rng), rng)
        kept = sampled.weights > 0.0
        parts = np.split(sampled.thetas[kept], range(_AT_ONCE, int(kept.sum()), _AT_ONCE))
        draws = np.concatenate([self.own.constants(part) for part in parts])
        indices = list(self.constants.values())
        ends = [_quantiles(draws[:, index], sampled.weights[kept], shares) for index in indices]
        return truth[0, indices], np.array(ends).T, sampled.effective

    def _tested(self, constants: Array, rng: np.random.Generator) -> Density:
        """Return the density given simulated forces of constants (1, P), with random noise."""
        noise: Correlated = jax.tree.map(
            lambda prior: jnp.asarray(prior.draw(rng)), bench().noise, is_leaf=is_prior
        )
        record, peak = self.space.record, bench().scales.force
        key = jax.random.key(int(rng.integers(2**31)))
        keys = jax.random.split(key, record.blocks.force.shape[0])
        errors = np.asarray(
            jax.jit(jax.vmap(type(noise).draw, (None, 0, 0)))(noise, keys, record.blocks)
        )
        forces = self.space.forces(self.own.hypothesis, constants)[0] + errors
        floor = NoiseFloor(float(noise.white), float(noise.ou), float(noise.tau))
        whitener = Whitener.from_floor(floor, record.blocks, peak)
        none = Discrepancy.none(whitener, peak)
        measured = eqx.tree_at(lambda r: r.blocks.force, record, jnp.asarray(forces))
        space = replace(self.space, record=measured, _cache={}, _chains={})
        return Density(space, none)

    def _sampled(self, density: Density, rng: np.random.Generator) -> ImportanceSample:
        """Sample from clouds about the modes and between slices; every amplitude counts."""
        hypothesis = self.own.hypothesis
        best_modes = modes(density, hypothesis, self.space.prior_draws(hypothesis)[:_STARTS])
        if not best_modes:
            raise NoFiniteForceError
        cut = list(slices(density, self.own, self.effect, best_modes[0]))
        ways = [find_mode(density, hypothesis, one.cloud.centre) for one in cut]
        best_modes = distinct([*best_modes, *(way for way in ways if way is not None)])
        clouds = mixture_about([(mode, evidence(density, mode.point)) for mode in best_modes])
        between = [one.cloud for one in cut if one.loss < best_modes[0].loss + _BEHIND]
        if between:
            clouds = [(cloud, 0.5 * share) for cloud, share in clouds]
            clouds += [(cloud, 0.5 / len(between)) for cloud in between]
        points = [mode.point for mode in best_modes]
        does = lambda one: one.effective >= _WORTH  # noqa: E731
        return importance_sample(density, self.own, clouds, points, does, _ROUNDS, rng)


def _quantiles(values: Array, weights: Array, shares: tuple[float, ...]) -> Array:
    """Return quantiles of weighted values (K,)."""
    order = np.argsort(values)
    below = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(shares, below, values[order])
