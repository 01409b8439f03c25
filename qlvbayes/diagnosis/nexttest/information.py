r"""Tell what a further test would say: its readings with their errors, and bits of information.

The information is that of linear forces and normal noise. It depends on the whitened forces f_h of
every explanation h and their slopes A_h along its coordinates z ~ N(0, 1) only by their products
(`Products`), which add up over tests. With M = 1 + A^T A, the information about Qz is

.. math:: I(Qz; y) = \tfrac12 \log_2 \frac{\det Q Q^T}{\det Q M^{-1} Q^T}

(half log det M for all of z; Lindley 1956, doi:10.1214/aoms/1177728069). Explanation h predicts
N(f_h, 1 + A_h A_h^T). If i is right, the expected logarithm of its Bayes factor against j is the
Kullback-Leibler divergence of these predictions,

.. math:: D_{ij} = \tfrac12 \left[\text{tr}\, \Sigma_j^{-1} (\Sigma_i - \Sigma_j)
          + (f_i - f_j)^T \Sigma_j^{-1} (f_i - f_j) + \ln |\Sigma_j| - \ln |\Sigma_i|\right],
          \quad \Sigma_h = 1 + A_h A_h^T,

whose determinants say how much less j has committed itself to. The explanations of one cause have
weights w. The information about which cause g, of probabilities p_g, is right has bounds in the
distances D between causes (Kolchinsky & Tracey 2017, doi:10.3390/e19070361),

.. math:: I(g; y) \gtreqless -\sum_a p_a \log_2 \sum_b p_b e^{-D_{ab}}

from below with the Bhattacharyya distance, from above with the Kullback-Leibler divergence. Of
causes, :math:`e^{-D_{ab}}` is at most :math:`\sum_{i \in a, j \in b} \sqrt{w_i w_j} e^{-D_{ij}}`
in the first, and :math:`D_{ab}` at most :math:`\sum w_i w_j D_{ij}` in the second, as the root is
subadditive and the divergence convex.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np
from msgspec import structs
from scipy.linalg import solve_triangular

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import Design, Rig
from qlvbayes.inference.errors.features import UNDECIDED, Locations
from qlvbayes.inference.errors.features import covariance as smooth_covariance
from qlvbayes.inference.errors.whitening import covariance as floor_covariance
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.io.runtime import in_threads
from qlvbayes.io.wording import plain
from qlvbayes.laws.motion import Motion
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.phases import KINDS, MOVING
from qlvbayes.motion.record import Blocks, Record, extended, held

_LN2 = float(np.log(2.0))
_LEAST = 0.01  # of the tests' depth: a limit below it is one in another unit
_TOGETHER = 64  # designs that are run at once: their arrays take some ten megabytes
_DEPENDENT = 1e-9  # of a variance: less of it is rounding
_BLOCKS = 128  # means of a test
_POINTS = 320  # of a test's motion: two nodes for each mean, and up to 64 knots
_EARLY = 1e-4  # share of a dwell that its first block takes
_LONGER = 3.0  # largest ratio of a block to the one before; else the last takes nearly all
_MOVING = 1.0 / 3.0  # share of the blocks for all movements: their forces are simpler than dwells'


@dataclass(frozen=True, eq=False)
class Readings:
    """The readings of any further test of a pad: the limits of its rig, and their errors."""

    rig: Rig
    floor: NoiseFloor  # noise floor of the load cell
    peak: float  # largest force of the tests so far (N)
    # size (N) of the discrepancy that is left in addition to the effects that are named
    missed: float = 0.0
    clock: float = 0.0  # time on the pad's clock after these tests (s)

    @classmethod
    def after(cls, experiment: Experiment, missed: float, **limits: float) -> Readings:
        """Return those after some tests, within their limits where no others are given."""
        scales, trials = experiment.scales, experiment.trials
        acceleration = scales.acceleration or scales.speed / (10.0 * scales.shortest)
        rows = max(trial.test.time.size for trial in trials)
        known = scales.depth, scales.speed, acceleration, scales.shortest, rows, len(trials)
        rig = structs.replace(Rig(*known), **limits)
        if rig.depth < _LEAST * scales.depth:
            unit, deepest = experiment.units.displacement, plain(scales.depth)
            what = f"a depth of at most {rig.depth:g} {unit}, where the tests had {deepest} {unit}"
            raise InputError(what, remedy="give the limits in the units of the file")
        return cls(rig, experiment.floor, scales.force, missed, scales.clock)

    def record(self, designs: Sequence[Design]) -> Record:
        """Return the record of T tests, each of which begins when it has waited."""
        records = [self._record(design) for design in designs]
        record: Record = jax.tree.map(lambda *leaves: np.stack(leaves), *records)
        return record

    def _record(self, design: Design) -> Record:
        path, rig = design.trajectory, self.rig
        begin, end = _edges(design, rig.interval)
        width = end - begin
        # a logger that keeps few readings has them evenly over the blocks
        count = np.round(np.minimum(width / rig.interval, max(rig.rows / width.size, 1.0)))
        count = np.maximum(count, 1.0)
        middle, half = 0.5 * (begin + end), 0.5 * width * (1.0 - 1.0 / count)
        # two nodes a block: the mean plus and minus one sd of evenly spaced readings
        spread = width * np.sqrt(np.maximum(1.0 - count**-2, 0.0) / 12.0)
        nodes = np.stack([middle - spread, middle + spread], axis=1)
        grid = np.unique(np.concatenate([path.knots, nodes.ravel()]))
        indices = np.searchsorted(grid, nodes)
        grid = np.asarray(extended(grid, _POINTS))
        x, v, a = path.displacement(grid), path.velocity(grid), path.acceleration(grid)
        start, number = held(self.clock + design.wait), held(float(rig.done))
        motion = Motion(held(grid), held(x), held(v), held(a), start, number=number)
        blocks = Blocks.of_means(np.zeros_like(count), count, middle - half, middle + half)
        full = jax.tree.map(lambda field: extended(field, _BLOCKS), blocks)
        real = held(np.arange(_BLOCKS) < begin.size)
        return Record(motion, extended(indices, _BLOCKS), replace(full, real=real))

    @cached_property
    def _expected(self) -> NoiseFloor:
        """The floor with all that the dwells leave open averaged over."""
        return self.floor.expected()

    def whitened(self, design: Design, blocks: Blocks, force: Array, vectors: Array) -> Array:
        """Return block means (K, B) of a design as independent values (K, n) of unit variance.

        force (B,): that of the likeliest explanation, with which the noise may grow.
        """
        real = np.asarray(blocks.real)
        own: Blocks = jax.tree.map(lambda x: np.asarray(x)[real], blocks)
        own = replace(own, scale=held(self.floor.scale(force[real])))
        covariance = floor_covariance(self._expected, own, self.peak)
        if self.missed > 0.0:
            middle = 0.5 * (np.asarray(own.first) + np.asarray(own.last))
            locations = self._locations(design, middle, force[real])
            smooth = smooth_covariance(locations, locations)
            covariance += self.missed**2 * (smooth + UNDECIDED.rough * np.eye(middle.size))
        root = np.linalg.cholesky(covariance)
        return solve_triangular(root, vectors[:, real].T, lower=True, check_finite=False).T

    def _locations(self, design: Design, middle: Array, force: Array) -> Locations:
        """Return the arguments of a discrepancy at the middles (n,) in s of a design's blocks."""
        kinds, starts, _ = zip(*design.stretches, strict=True)
        begun = np.array(starts)
        which = np.searchsorted(begun[1:], middle, side="right")
        smooth = UNDECIDED.smooth(
            np.maximum(middle - begun[which], 0.0) + self.rig.interval,
            design.trajectory.displacement(middle) / self.rig.depth,
            np.full(middle.shape, design.speed),
        )
        phase = np.array([KINDS.index(kind) for kind in kinds])[which]
        size = UNDECIDED.size(force / self.peak)
        return Locations(smooth, size, phase, np.zeros(middle.shape, np.intp))


def _edges(design: Design, interval: float) -> tuple[Array, Array]:
    """Return begin and end (s) of the blocks of all movements and dwells."""
    stretches = design.stretches
    moves = sum(kind in MOVING for kind, *_ in stretches)
    dwells = max(len(stretches) - moves, 1)
    move = max(int(_MOVING * _BLOCKS) // moves, 1)
    rest = (_BLOCKS - move * moves) // dwells
    begin, end = [], []
    for kind, start, stop in stretches:
        length = stop - start
        parts = int(np.clip(length / interval, 1, move if kind in MOVING else rest))
        if kind in MOVING or parts < 3:
            shares = np.linspace(0.0, 1.0, parts + 1)
        else:
            first = max(2.0 * interval / length, _EARLY, _LONGER ** (1.0 - parts))
            shares = np.concatenate([[0.0], np.geomspace(min(first, 0.5), 1.0, parts)])
        begin.append(start + length * shares[:-1])
        end.append(start + length * shares[1:])
    return np.concatenate(begin), np.concatenate(end)


@dataclass(frozen=True, eq=False)
class Products:
    """The products of the whitened f_h and A_h in each of T tests, or series of tests."""

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

    @cached_property
    def _volumes(self) -> list[Array]:
        """Log det M (T,)."""
        return [np.linalg.slogdet(M)[1] for M in self.precisions]

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

    def bhattacharyya(self, i: int, j: int) -> Array:
        """Return the Bhattacharyya distance (T,) of the predictions of two explanations."""
        apart, volume = _distance(self._between(i, j), 0.5)
        more = volume - 0.5 * (self._volumes[i] + self._volumes[j])
        return 0.125 * apart + 0.5 * np.maximum(more, 0.0)

    def kullback(self, i: int, j: int) -> Array:
        """Return the Kullback-Leibler divergence D_ij (T,)."""
        every, own = self._between(i, j), 1 + self.belief.explanations[j].size
        apart, volume = _distance(every[:, :own, :own], 1.0)
        jj, ij, ii = every[:, 1:own, 1:own], every[:, own:, 1:own], every[:, own:, own:]
        solved = np.linalg.solve(self.precisions[j], jj + np.swapaxes(ij, 1, 2) @ ij)
        trace = np.einsum("tff->t", ii) - np.einsum("tff->t", solved)
        return 0.5 * np.maximum(trace + apart + volume - self._volumes[i], 0.0)

    def bits_for_cause(self) -> tuple[Array, Array]:
        """Return bounds (T,) from below and above of the bits about which cause is right."""
        weights, p = self.belief.shares, np.array(list(self.belief.causes.values()))
        near = _grouped(np.sqrt(weights), np.exp(-self._pairs(self.bhattacharyya)))
        far = np.exp(-_grouped(weights, self._pairs(self.kullback)))
        bounds = []
        for factor in (np.minimum(near, 1.0), far):
            factor[:, range(len(p)), range(len(p))] = 1.0
            bits = -np.log2(factor @ p) @ p
            bounds.append(np.clip(bits, 0.0, max(self.belief.entropy, 0.0)))
        return bounds[0], bounds[1]

    def _pairs(self, distance: Callable[[int, int], Array]) -> Array:
        """Return a distance (H, H, T) between all explanations."""
        zero, count = np.zeros(len(self.values)), range(len(self.belief.explanations))
        return np.array([[zero if i == j else distance(i, j) for j in count] for i in count])

    def evidence(self) -> Array:
        """Return the least expected 2 ln(Bayes factor) (T,) of two causes' explanations."""
        causes = [one.cause for one in self.belief.explanations]
        pairs = [(i, j) for i, a in enumerate(causes) for j, b in enumerate(causes) if a != b]
        if not pairs:
            return np.zeros(len(self.values))
        return np.asarray(2.0 * np.min([self.kullback(i, j) for i, j in pairs], axis=0))


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
