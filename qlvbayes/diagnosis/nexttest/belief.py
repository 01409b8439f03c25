"""The belief about a pad before the next test: explanations, each with its constants."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from qlvbayes.diagnosis.nexttest.design import RecoveryTime
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.motion.record import Record

Forces = Callable[[Array, Record], Array]

STEP = 0.02
"""Step of the forward differences in sds: it smooths kinks of contact and is far above rounding."""
_DEPENDENT = 1e-9  # of the largest singular value, below which others span a direction


@dataclass(frozen=True, eq=False)
class Explanation:
    """A model with the posterior distribution of its constants after the tests that were done."""

    words: str  # its laws and effects in words
    probability: float
    size: int  # number F of free parameters
    # names, kinds: names and kinds of units of the P constants
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    constants: Callable[[Array], Array]  # function from z (K, F) to constants (K, P)
    # function from constants (K, P) and a record of T tests to block means (K, T, B) of the force
    # (N)
    run: Forces
    # fractions, rates: fractions (L,) and rates (L,) in 1/s of its relaxation
    fractions: Array
    rates: Array
    # the effects in words, without the laws. Explanations of one cause are one answer.
    cause: str = ""

    def forces(self, z: Array, record: Record) -> Array:
        """Return block means (K, T, B) of the force (N) for z (K, F)."""
        return self.run(self.constants(z), record)

    def slopes(self, z: Array, record: Record) -> tuple[Array, Array]:
        """Return block means (K, T, B) for z (K, F), and their slopes (K, F, T, B) along z."""
        rows = z[:, None] + STEP * np.concatenate([np.zeros((1, self.size)), np.eye(self.size)])
        means = self.forces(rows.reshape(-1, self.size), record)
        means = means.reshape(len(z), 1 + self.size, *means.shape[1:])
        return means[:, 0], (means[:, 1:] - means[:, :1]) / STEP

    @cached_property
    def centre(self) -> Array:
        """The constants (P,) at z = 0."""
        return self.constants(np.zeros((1, self.size)))[0]

    @cached_property
    def gradient(self) -> Array:
        """The slopes (P, F) of the constants along z."""
        return (self.constants(STEP * np.eye(self.size)) - self.centre).T / STEP

    def directions(self, names: Sequence[str]) -> Array:
        """Return orthonormal rows (r, F) that span the directions of z in which constants vary."""
        some = [k for k, own in enumerate(self.names) if _named(own, names)]
        rows = self.gradient[some]
        sizes = np.linalg.norm(rows, axis=1, keepdims=True)
        rows = rows[sizes[:, 0] > 0.0] / sizes[sizes[:, 0] > 0.0]
        if not len(rows):
            return np.zeros((0, self.size))
        _, values, axes = np.linalg.svd(rows, full_matrices=False)
        return np.asarray(axes[values > _DEPENDENT * values[0]])


def _named(own: str, names: Sequence[str]) -> bool:
    """Return whether a constant is meant: by its own name, or by that of the vector it is in."""
    return any(own == name or own.startswith(f"{name}[") for name in names)


@dataclass(frozen=True, eq=False)
class Belief:
    """Explanations whose probabilities sum to one, the most probable first."""

    explanations: tuple[Explanation, ...]
    # probability that something unmodelled is there, in addition to any of them
    outside: float = 0.0

    @classmethod
    def from_explanations(cls, explanations: Sequence[Explanation], outside: float = 0.0) -> Belief:
        """Return the belief in some explanations by the ratios of their probabilities."""
        total = sum(one.probability for one in explanations)
        ordered = sorted(explanations, key=lambda one: -one.probability)
        return cls(
            tuple(replace(one, probability=one.probability / total) for one in ordered), outside
        )

    @property
    def probabilities(self) -> Array:
        """The probability (H,) of each explanation."""
        return np.array([one.probability for one in self.explanations])

    @cached_property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """The indices of the explanations of each cause."""
        indices: dict[str, list[int]] = {}
        for k, one in enumerate(self.explanations):
            indices.setdefault(one.cause or one.words, []).append(k)
        return tuple(tuple(own) for own in indices.values())

    @property
    def causes(self) -> dict[str, float]:
        """The probability of each cause, in the order of `groups`."""
        p = self.probabilities
        firsts = (self.explanations[group[0]] for group in self.groups)
        names = (first.cause or first.words for first in firsts)
        return {n: float(p[list(g)].sum()) for n, g in zip(names, self.groups, strict=True)}

    @property
    def entropy(self) -> float:
        """The bits that are missing to know which cause is right."""
        p = np.array(list(self.causes.values()))
        p = p[p > 0.0]
        return float(-(p * np.log2(p)).sum()) + 0.0

    @property
    def recovery(self) -> RecoveryTime:
        """The time of recovery of a pad for which any explanation may be right."""
        return RecoveryTime(tuple((one.fractions, one.rates) for one in self.explanations))

    def check(self, names: Sequence[str]) -> None:
        """Raise InputError where no explanation has a constant of that name."""
        known = dict.fromkeys(name for one in self.explanations for name in one.names)
        for name in names:
            if not any(_named(own, [name]) for own in known):
                raise InputError(f"no constant '{name}'", remedy=f"use cause, {', '.join(known)}")

    @property
    def base_names(self) -> tuple[str, ...]:
        """The free constants of the base laws, of any explanation."""
        return tuple(
            dict.fromkeys(
                name
                for one in self.explanations
                for name, row in zip(one.names, one.gradient, strict=True)
                if "." not in name and np.any(row)
            )
        )
