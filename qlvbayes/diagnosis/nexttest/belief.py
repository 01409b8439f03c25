"""What is believed of a pad before the next test: explanations, each with its constants."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.nexttest.design import Recovery
from qlvbayes.io.checks import InputError
from qlvbayes.motion.record import Record

Array = NDArray[np.float64]
Forces = Callable[[Array, Record], Array]

STEP = 0.02  # sds, over which slopes are taken: kinks of contact are smoothed, rounding is not seen
_DEPENDENT = 1e-9  # of the largest singular value: directions that others span


@dataclass(frozen=True, eq=False)
class Explanation:
    """A model whose constants are known as far as the tests that were done tell.

    Its F free numbers z are independent standard normal ones. names, kinds: of the P constants, and
    of their units; constants: from z (K, F) to (K, P); run: from constants (K, P) and a record of T
    tests to block means (K, T, B) of the force (N); fractions (L,), rates (L,): of its relaxation,
    1/s; cause: what it is told by, whatever its laws, explanations of one cause being one answer.
    """

    words: str
    probability: float
    size: int
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    constants: Callable[[Array], Array]
    run: Forces
    fractions: Array
    rates: Array
    cause: str = ""

    def forces(self, z: Array, record: Record) -> Array:
        """(K, T, B) of z (K, F)."""
        return self.run(self.constants(z), record)

    def slopes(self, z: Array, record: Record) -> tuple[Array, Array]:
        """Block means (K, T, B) of z (K, F), and their slopes (K, F, T, B) along z."""
        rows = z[:, None] + STEP * np.concatenate([np.zeros((1, self.size)), np.eye(self.size)])
        found = self.forces(rows.reshape(-1, self.size), record)
        found = found.reshape(len(z), 1 + self.size, *found.shape[1:])
        return found[:, 0], (found[:, 1:] - found[:, :1]) / STEP

    @cached_property
    def centre(self) -> Array:
        """Constants (P,) at z = 0."""
        return self.constants(np.zeros((1, self.size)))[0]

    @cached_property
    def gradient(self) -> Array:
        """Slopes (P, F) of the constants along z."""
        return (self.constants(STEP * np.eye(self.size)) - self.centre).T / STEP

    def asked(self, names: Sequence[str]) -> Array:
        """Orthonormal rows (r, F): what of z some constants say; those that it has not, nothing."""
        some = [k for k, own in enumerate(self.names) if _named(own, names)]
        rows = self.gradient[some]
        sizes = np.linalg.norm(rows, axis=1, keepdims=True)
        rows = rows[sizes[:, 0] > 0.0] / sizes[sizes[:, 0] > 0.0]
        if not len(rows):
            return np.zeros((0, self.size))
        _, values, axes = np.linalg.svd(rows, full_matrices=False)
        return np.asarray(axes[values > _DEPENDENT * values[0]])


def _named(own: str, names: Sequence[str]) -> bool:
    """Whether a constant is meant: by its name, or by that of the vector it is in."""
    return any(own == name or own.startswith(f"{name}[") for name in names)


@dataclass(frozen=True, eq=False)
class Belief:
    """Explanations whose probabilities sum to one, the likeliest first.

    outside: probability that none of them is all of it.
    """

    explanations: tuple[Explanation, ...]
    outside: float = 0.0

    @property
    def probabilities(self) -> Array:
        """(H,)."""
        return np.array([one.probability for one in self.explanations])

    @cached_property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Places of the explanations of each cause; one that names none is a cause of its own."""
        found: dict[str, list[int]] = {}
        for k, one in enumerate(self.explanations):
            found.setdefault(one.cause or one.words, []).append(k)
        return tuple(tuple(places) for places in found.values())

    @property
    def causes(self) -> dict[str, float]:
        """Probability of each, in the order of `groups`."""
        p = self.probabilities
        firsts = (self.explanations[group[0]] for group in self.groups)
        names = (first.cause or first.words for first in firsts)
        return {n: float(p[list(g)].sum()) for n, g in zip(names, self.groups, strict=True)}

    @property
    def entropy(self) -> float:
        """Bits that are missing to know which cause is right."""
        p = np.array(list(self.causes.values()))
        p = p[p > 0.0]
        return float(-(p * np.log2(p)).sum()) + 0.0

    @property
    def recovery(self) -> Recovery:
        """Of a pad of which any explanation may be right."""
        return Recovery(tuple((one.fractions, one.rates) for one in self.explanations))

    def check(self, names: Sequence[str]) -> None:
        """Raise InputError where no explanation has a constant of that name."""
        known = dict.fromkeys(name for one in self.explanations for name in one.names)
        for name in names:
            if not any(_named(own, [name]) for own in known):
                raise InputError(f"no constant '{name}'", remedy=f"use cause, {', '.join(known)}")

    @property
    def base_names(self) -> tuple[str, ...]:
        """Constants of the laws, not of effects, that any explanation has and leaves free."""
        return tuple(
            dict.fromkeys(
                name
                for one in self.explanations
                for name, row in zip(one.names, one.gradient, strict=True)
                if "." not in name and np.any(row)
            )
        )


def normalised(explanations: Sequence[Explanation], outside: float = 0.0) -> Belief:
    """The belief in some explanations by the ratios of their probabilities."""
    total = sum(one.probability for one in explanations)
    ordered = sorted(explanations, key=lambda one: -one.probability)
    return Belief(
        tuple(replace(one, probability=one.probability / total) for one in ordered), outside
    )
