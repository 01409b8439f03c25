"""The belief about a pad before the next test, and how many bits a test would add to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations

import jax
import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.nexttest.design import Design, Readings
from qlvbayes.inference.forward.forces import Forces
from qlvbayes.io.arrays import Array
from qlvbayes.io.runtime import in_threads
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
_LN2 = float(np.log(2.0))
_TOGETHER = 64  # designs that are run at once: their arrays take some ten megabytes
_DEPENDENT = 1e-9  # of a variance: less of it is rounding


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


@dataclass(frozen=True, eq=False)
class Products:
    r"""The products of the whitened f_h and A_h in each of T tests, or series of tests.

    The information is that of linear forces and normal noise. It depends on the whitened forces f_h
    of every explanation h and their slopes A_h along its coordinates z ~ N(0, 1) only by their
    products, which add up over tests. With M = 1 + A^T A, the information about Qz is

    .. math:: I(Qz; y) = \tfrac12 \log_2 \frac{\det Q Q^T}{\det Q M^{-1} Q^T}

    (half log det M for all of z; Lindley 1956, doi:10.1214/aoms/1177728069). Explanation h predicts
    N(f_h, 1 + A_h A_h^T). If i is right, the expected logarithm of its Bayes factor against j is
    the Kullback-Leibler divergence of these predictions,

    .. math:: D_{ij} = \tfrac12 \left[\text{tr}\, \Sigma_j^{-1} (\Sigma_i - \Sigma_j)
              + (f_i - f_j)^T \Sigma_j^{-1} (f_i - f_j) + \ln |\Sigma_j| - \ln |\Sigma_i|\right],
              \quad \Sigma_h = 1 + A_h A_h^T,

    whose determinants say how much less j has committed itself to. The explanations of one cause
    have weights w. The information about which cause g, of probabilities p_g, is right has bounds
    in the distances D between causes (Kolchinsky & Tracey 2017, doi:10.3390/e19070361),

    .. math:: I(g; y) \gtreqless -\sum_a p_a \log_2 \sum_b p_b e^{-D_{ab}}

    from below with the Bhattacharyya distance, from above with the Kullback-Leibler divergence. Of
    causes, :math:`e^{-D_{ab}}` is at most
    :math:`\sum_{i \in a, j \in b} \sqrt{w_i w_j} e^{-D_{ij}}` in the first, and :math:`D_{ab}` at
    most :math:`\sum w_i w_j D_{ij}` in the second, as the root is subadditive and the divergence
    convex.
    """

    belief: Belief
    # products (T, V, V); V counts f_h and the F slopes of one explanation after another
    values: Array

    @cached_property
    def _starts(self) -> list[int]:
        """Where each explanation's f_h is, before its slopes."""
        return np.cumsum([0, *(1 + one.size for one in self.belief.explanations)]).tolist()

    def _slopes(self, k: int) -> slice:
        return slice(self._starts[k] + 1, self._starts[k + 1])

    @cached_property
    def precisions(self) -> list[Array]:
        """M (T, F, F) of each explanation."""
        count = len(self.belief.explanations)
        blocks = [self.values[:, self._slopes(k), self._slopes(k)] for k in range(count)]
        return [np.eye(block.shape[1]) + block for block in blocks]

    def bits_for(self, k: int, directions: Array) -> Array:
        """Return the bits (T,) about directions, unit rows (r, F), of explanation k's z."""
        left = directions @ np.linalg.solve(self.precisions[k], directions.T)
        little = _DEPENDENT * np.eye(len(directions))  # is left of what the other rows span
        before = np.linalg.slogdet(directions @ directions.T + little)[1]
        return 0.5 * (before - np.linalg.slogdet(left + little)[1]) / _LN2

    def bits_for_constants(self, names: Sequence[str]) -> Array:
        """Return the bits (T,) about constants, averaged over the explanations."""
        some = enumerate(self.belief.explanations)
        bits = [one.probability * self.bits_for(k, one.directions(names)) for k, one in some]
        return np.sum(bits, axis=0)

    def sds(self, k: int, gradient: Array) -> Array:
        """Return sds (T, P) after the tests of quantities with slopes (P, F) along z."""
        spread = np.linalg.solve(self.precisions[k], gradient.T)
        return np.sqrt(np.maximum(np.einsum("pf,tfp->tp", gradient, spread), 0.0))

    def _between(self, i: int, j: int) -> Array:
        """Return the products (T, W, W) of f_i - f_j, the slopes of j, and those of i."""
        unit = np.eye(self.values.shape[1])
        apart = unit[[self._starts[i]]] - unit[[self._starts[j]]]
        rows = np.concatenate([apart, unit[self._slopes(j)], unit[self._slopes(i)]])
        return np.asarray(rows @ self.values @ rows.T)

    @cached_property
    def distances(self) -> tuple[Array, Array]:
        """Bhattacharyya distances and Kullback-Leibler divergences (H, H, T) of explanations."""
        some = self.belief.explanations
        near, far = np.zeros((2, len(some), len(some), len(self.values)))
        volumes = [np.linalg.slogdet(M)[1] for M in self.precisions]
        for i, j in permutations(range(len(some)), 2):
            every, own = self._between(i, j), 1 + some[j].size
            apart, volume = _distance(every, 0.5)
            more = volume - 0.5 * (volumes[i] + volumes[j])
            near[i, j] = 0.125 * apart + 0.5 * np.maximum(more, 0.0)
            apart, volume = _distance(every[:, :own, :own], 1.0)
            jj, ij, ii = every[:, 1:own, 1:own], every[:, own:, 1:own], every[:, own:, own:]
            solved = np.linalg.solve(self.precisions[j], jj + np.swapaxes(ij, 1, 2) @ ij)
            trace = np.einsum("tff->t", ii) - np.einsum("tff->t", solved)
            far[i, j] = 0.5 * np.maximum(trace + apart + volume - volumes[i], 0.0)
        return near, far

    def bits_for_cause(self) -> tuple[Array, Array]:
        """Return bounds (T,) from below and above of the bits about which cause is right."""
        weights, p = self.belief.shares, np.array(list(self.belief.causes.values()))
        near, far = self.distances
        near = np.minimum(_grouped(np.sqrt(weights), np.exp(-near)), 1.0)
        far = np.exp(-_grouped(weights, far))
        bounds = []
        for factor in (near, far):
            factor[:, range(len(p)), range(len(p))] = 1.0
            bits = -np.log2(factor @ p) @ p
            bounds.append(np.clip(bits, 0.0, max(self.belief.entropy, 0.0)))
        return bounds[0], bounds[1]

    def evidence(self) -> Array:
        """Return the least expected 2 ln(Bayes factor) (T,) of two causes' explanations."""
        causes = [one.cause for one in self.belief.explanations]
        pairs = [(i, j) for i, a in enumerate(causes) for j, b in enumerate(causes) if a != b]
        if not pairs:
            return np.zeros(len(self.values))
        return np.asarray(2.0 * np.min([self.distances[1][pair] for pair in pairs], axis=0))


def _grouped(weights: Array, values: Array) -> Array:
    """Return the sums (T, G, G) of values (H, H, T) with weights (G, H) of each group."""
    return np.asarray(np.einsum("ai,ijt,bj->tab", weights, values, weights))


def _distance(products: Array, share: float) -> tuple[Array, Array]:
    """Return d^T (1 + share A A^T)^-1 d (T,) and log det(1 + share A^T A) (T,).

    products (T, 1 + F, 1 + F): of d and the columns of A.
    """
    towards = products[:, 1:, :1]
    inner = np.eye(towards.shape[1]) + share * products[:, 1:, 1:]
    taken = share * np.sum(towards * np.linalg.solve(inner, towards), axis=(1, 2))
    return np.maximum(products[:, 0, 0] - taken, 0.0), np.linalg.slogdet(inner)[1]


def between(low: Array, high: Array) -> Array:
    """Return the expected bits about the cause from their bounds."""
    return low + (high - low) / 3.0  # for small ones these are half and twice the information


def screen(belief: Belief, designs: Sequence[Design], readings: Readings) -> Products:
    """Return the products of T designs; NaN for those whose force is not finite."""
    parts = [designs[k : k + _TOGETHER] for k in range(0, len(designs), _TOGETHER)]
    return Products(belief, np.concatenate([_products(belief, some, readings) for some in parts]))


def _products(belief: Belief, designs: Sequence[Design], readings: Readings) -> Array:
    """Return the products (T, V, V) of T designs."""
    record = readings.record(designs)
    vectors = np.concatenate([one.force_and_slopes(record) for one in belief.explanations])

    def product(k: int) -> Array:
        own, blocks = vectors[:, k], jax.tree.map(lambda x: x[k], record.blocks)
        if not np.isfinite(own).all():
            return np.full((len(own), len(own)), np.nan)
        white = readings.whitened(designs[k], blocks, own[0], own)
        return np.asarray(white @ white.T)

    return np.stack(in_threads(product, range(len(designs))))
