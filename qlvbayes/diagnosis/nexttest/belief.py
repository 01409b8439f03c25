"""The belief about a pad before the next test: explanations, each with its constants."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.forward.forces import Forces
from qlvbayes.io.arrays import Array
from qlvbayes.model.model import Model
from qlvbayes.model.parameters import fields_of, filled
from qlvbayes.motion.record import Record

STEP = 0.02
"""Step of the forward differences in sds: it smooths kinks of contact and is far above rounding."""
_CONSTANT = 1e-12  # of the largest variance, below which nothing varies in a direction
_FRACTIONS = "c["  # prefix of the constants that sum to one
_LEAST = 0.05  # probability from which a cause, or a further explanation of one, counts
_MOST = 6  # explanations of all causes together: each costs a simulation of every design
_FORGOTTEN = 0.01  # share of the force of a press that may be left when the next test begins
_RESTS = np.geomspace(0.1, 3600.0, 300)  # s, rests that are tried


@dataclass(frozen=True, eq=False)
class Explanation:
    """A model whose P constants are normal in F coordinates z ~ N(0, 1) after the tests done."""

    words: str  # its laws and effects in words
    probability: float
    cause: str  # the set of effects that it stands for: explanations of one cause are one answer
    # names, kinds: of the constants, and of their units
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    # mean (P,) and root (P, F) of the covariance of the constants, or of their logarithms
    mean: Array
    root: Array
    # in_log, sums: which (P,) are logarithms, and which are fractions that sum to one
    in_log: NDArray[np.bool_]
    sums: NDArray[np.bool_]
    # function from constants (K, P) and a record of T tests to block means (K, T, B) of the force
    run: Callable[[Array, Record], Array]
    spectrum: tuple[Array, Array]  # fractions (L,) and rates (L,) in 1/s of its relaxation

    @classmethod
    def from_draws(
        cls, words: str, model: Model, draws: Mapping[str, Array], probability: float, cause: str
    ) -> Explanation:
        """Return the explanation with the moments of draws (n,) of each constant of a model."""
        fields = list(fields_of(model))
        names = tuple(name for field in fields for name in field.names)
        kinds = tuple(field.unit for field in fields for _ in field.names)
        values = np.stack([draws[name] for name in names], axis=1)
        logs = np.log(np.where(positive := np.all(values > 0.0, axis=0), values, 1.0))
        in_log = positive & (_skewness(logs) < _skewness(values))  # not amplitudes near zero
        scaled = np.where(in_log, logs, values)
        variances, axes = np.linalg.eigh(np.atleast_2d(np.cov(scaled.T)))
        kept = variances > _CONSTANT * max(float(variances.max()), 1e-300)
        root = axes[:, kept] * np.sqrt(variances[kept])
        forces = Forces()

        def run(rows: Array, record: Record) -> Array:
            return forces.over(filled(model, rows.T), len(rows), record)

        shares = np.array([name.startswith(_FRACTIONS) for name in names])
        sums = shares & np.allclose(values[:, shares].sum(axis=1), 1.0)
        fractions, rates = filled(model, values.mean(axis=0)).relaxation.spectrum()
        spectrum = np.asarray(fractions)[1:], np.asarray(rates)
        known = names, kinds, scaled.mean(axis=0), root, in_log, sums, run, spectrum
        return cls(words, probability, cause, *known)

    @property
    def size(self) -> int:
        """Number F of coordinates."""
        return self.root.shape[1]

    def constants(self, z: Array) -> Array:
        """Return the constants (K, P) at z (K, F)."""
        rows = self.mean + z @ self.root.T
        rows[:, self.in_log] = np.exp(rows[:, self.in_log])
        if self.sums.any():  # those of logarithms about their mean do not
            rows[:, self.sums] /= rows[:, self.sums].sum(axis=1, keepdims=True)
        return rows

    def forces(self, z: Array, record: Record) -> Array:
        """Return block means (K, T, B) of the force (N) at z (K, F)."""
        return self.run(self.constants(z), record)

    def force_and_slopes(self, record: Record) -> Array:
        """Return block means (1 + F, T, B) of the force at z = 0, and of its slopes along z."""
        force = self.forces(STEP * np.eye(1 + self.size, self.size, -1), record)
        return np.concatenate([force[:1], (force[1:] - force[:1]) / STEP])

    @cached_property
    def centre(self) -> Array:
        """The constants (P,) at z = 0."""
        return self.constants(np.zeros((1, self.size)))[0]

    @cached_property
    def gradient(self) -> Array:
        """The slopes (P, F) of the constants along z."""
        return (self.constants(STEP * np.eye(self.size)) - self.centre).T / STEP

    def directions(self, names: Sequence[str]) -> Array:
        """Return unit rows (r, F): the directions of z in which constants of these names vary."""
        rows = self.gradient[[is_meant(own, names) for own in self.names]]
        sizes = np.linalg.norm(rows, axis=1, keepdims=True)
        return np.asarray(rows[sizes[:, 0] > 0.0] / sizes[sizes[:, 0] > 0.0])


def _skewness(values: Array) -> Array:
    """Return the size of the skewness (P,) of draws (n, P)."""
    apart = values - values.mean(axis=0)
    return np.asarray(abs(np.mean(apart**3, axis=0)) / np.maximum(apart.std(axis=0), 1e-99) ** 3)


def _totals(some: Sequence[Explanation]) -> dict[str, float]:
    """Return the probability of each cause."""
    totals = dict.fromkeys((one.cause for one in some), 0.0)
    for one in some:
        totals[one.cause] += one.probability
    return totals


def is_meant(own: str, names: Sequence[str]) -> bool:
    """Return whether a constant is meant: by its own name, or by that of the vector it is in."""
    return any(own == name or own.startswith(f"{name}[") for name in names)


@dataclass(frozen=True, eq=False)
class Belief:
    """Explanations whose probabilities sum to one, the most probable first."""

    explanations: tuple[Explanation, ...]
    # probability that something unmodelled is there, in addition to any of them
    outside: float = 0.0

    @classmethod
    def from_explanations(cls, some: Sequence[Explanation], outside: float = 0.0) -> Belief:
        """Return the belief in those explanations that count, by the ratios of probabilities.

        Of each probable cause its most probable explanation counts, and others that are probable
        themselves; they share the probability of their cause.
        """
        ordered = sorted(some, key=lambda one: -one.probability)
        first, total = {one.cause: one for one in reversed(ordered)}, _totals(ordered)

        def standing(one: Explanation) -> tuple[bool, float]:
            leads = one is first[one.cause]
            return leads, total[one.cause] if leads else one.probability

        kept = [x for x in sorted(some, key=standing, reverse=True) if standing(x)[1] >= _LEAST]
        kept = kept[:_MOST] or ordered[:1]
        own = _totals(kept)
        factor = {cause: total[cause] / own[cause] / sum(total[c] for c in own) for cause in own}
        shared = [replace(one, probability=one.probability * factor[one.cause]) for one in kept]
        return cls(tuple(sorted(shared, key=lambda one: -one.probability)), outside)

    @cached_property
    def causes(self) -> dict[str, float]:
        """The probability of each cause."""
        return _totals(self.explanations)

    @cached_property
    def shares(self) -> Array:
        """The probability (G, H) of each explanation within its cause; 0 outside it."""
        rows = [[one.cause == cause for one in self.explanations] for cause in self.causes]
        joint = np.array(rows) * [one.probability for one in self.explanations]
        return np.asarray(joint / joint.sum(axis=1, keepdims=True))

    @property
    def entropy(self) -> float:
        """The bits that are missing to know which cause is right."""
        p = np.array(list(self.causes.values()))
        return float(-(p * np.log2(p)).sum()) + 0.0

    def recovery(self, duration: float) -> float:
        r"""Return the rest (s) after a test of ``duration`` s, whichever explanation is right.

        A mode of share c and rate v has :math:`c (1 - e^{-v D}) e^{-v t}` left at the time t.
        """
        left = np.zeros_like(_RESTS)
        for fractions, rates in (one.spectrum for one in self.explanations):
            excited = fractions * -np.expm1(-rates * duration)
            left = np.maximum(left, excited @ np.exp(-np.outer(rates, _RESTS)))
        enough = np.flatnonzero(left <= _FORGOTTEN)
        return float(_RESTS[enough[0]]) if enough.size else float(_RESTS[-1])
