r"""Describe what a model leaves beyond noise: a discrepancy of unknown size.

The block means are y = f + B w + u + e. The `features` B (M, n) have coefficients w ~ N(0, s^2).
The rough part u ~ N(0, rho s^2), independent from block to block, stands for kinks and for whatever
no smooth function follows. The noise is e. With whitened features and the variances lambda of
`whitening`, everything but f is integrated out in closed form (Kennedy & O'Hagan 2001,
doi:10.1111/1467-9868.00294, with a finite basis):

.. math:: Q^{-1} = D + s^2 B^T B, \quad D = 1 + \rho s^2 / \lambda, \quad
          -2 \ln L(s) = r^T Q r + \ln |Q^{-1}|

Without the rough part, whatever the features cannot follow of a wrong model's error would be
weighted by the noise alone, however large it is, and the likeliest fit would be one that follows it
and nothing else.

The size s runs over a grid from zero to a third of the peak force. Half of its prior mass is at
zero. The other half falls as 1/(1 + s/t) per factor beyond the tolerance t, so that a larger size
is less probable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from qlvbayes.inference.errors.features import UNDECIDED, DiscrepancyPrior, Features, Locations
from qlvbayes.inference.errors.scatter import NONE, Scatter, ScatterPrior, likeliest
from qlvbayes.inference.errors.separation import DiscrepancyOfSize, Separation
from qlvbayes.inference.errors.whitening import Whitener, stage_changes
from qlvbayes.io.arrays import Array
from qlvbayes.laws.scales import TOLERANCE
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.record import Blocks


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """The features of a pad's block means, and the sizes that the discrepancy may have."""

    features: Array  # (M, T, B): in N, for unit size
    whitener: Whitener
    peak: float  # largest force (N)
    sizes: Array  # (S,): in N, the first is 0
    log_prior: Array  # (S,): of the sizes
    rough: float  # variance ratio rho
    scatter: ScatterPrior | None = None  # prior of the scatter between tests; None without any
    kept: int | None = None  # sizes of which matrices are kept, all of the grid if None
    _by_size: dict[float, DiscrepancyOfSize] = field(default_factory=dict)

    @classmethod
    def from_features(
        cls,
        features: Array,
        whitener: Whitener,
        peak: float,
        tolerance: float,
        prior: DiscrepancyPrior = UNDECIDED,
        scatter: ScatterPrior | None = None,
    ) -> Discrepancy:
        """Return the discrepancy of features (M, T, B), with the prior's grid of sizes."""
        densities = 1.0 / (1.0 + prior.shares / max(tolerance, prior.smallest))
        weights = np.concatenate([[prior.none], (1.0 - prior.none) * densities / densities.sum()])
        sizes = peak * np.concatenate([[0.0], prior.shares])
        return cls(features, whitener, peak, sizes, np.log(weights), prior.rough, scatter)

    @classmethod
    def from_blocks(
        cls,
        experiment: Experiment,
        trials: Sequence[Trial],
        blocks: Blocks,
        tolerance: float = TOLERANCE,
        prior: DiscrepancyPrior = UNDECIDED,
        scatter: ScatterPrior | None = None,
    ) -> Discrepancy:
        """Return the discrepancy of block means (T, B) of some trials, under the noise floor.

        Errors that tests of one stage share in their contact are part of the noise.
        """
        peak = experiment.scales.force
        locations = Locations.from_blocks(experiment, trials, blocks, prior)
        values = Features.from_locations(locations)(locations)
        real = np.asarray(blocks.real)
        features = np.zeros((len(values), *real.shape))
        features[:, real] = values
        whitener = Whitener.from_floor(experiment.floor, blocks, peak)
        whitener = whitener.with_common(stage_changes(trials, blocks))
        several = scatter if len(trials) > 1 else None
        return cls.from_features(features, whitener, peak, tolerance, prior, several)

    @classmethod
    def none(cls, whitener: Whitener, peak: float) -> Discrepancy:
        """Return a discrepancy whose only size is zero; peak: largest force (N)."""
        nothing = np.zeros((0, *np.shape(whitener.blocks)))
        return cls(nothing, whitener, peak, np.zeros(1), np.zeros(1), 0.0)

    def with_features(self, features: Sequence[Array]) -> Discrepancy:
        """Return the discrepancy with more features (T, B), of unit size."""
        if not len(features):
            return self
        real = np.stack(self.whitener.blocks)
        extended = np.concatenate([self.features, np.where(real, features, 0.0)])
        return replace(self, features=extended, _by_size={})

    def with_whitener(self, whitener: Whitener, kept: int | None = None) -> Discrepancy:
        """Return the discrepancy under other noise; kept: sizes of which matrices are kept."""
        return replace(self, whitener=whitener, kept=kept, _by_size={})

    @cached_property
    def shapes(self) -> Array:
        """Return the whitened features (M, n)."""
        return self.whitener(self.features)

    @cached_property  # once for all points: a diagnosis keeps hundreds
    def block_features(self) -> Array:
        """Return the features (M, n), not whitened, at the blocks that count."""
        return self.whitener.flattened(self.features)

    def separated(
        self,
        responses: Array,
        lengths: Array,
        parts: Callable[[], Array] | None = None,
        scatter: Scatter = NONE,
        errors: Array | None = None,
    ) -> Separation:
        """Return the separation from what the derivatives (F, T, B) of the force can follow."""
        counted = responses if len(self.features) else responses[:0]
        if self.scatter is None:
            parts, scatter = None, NONE
        own = self.whitener, self.block_features, counted, lengths[: len(counted)], parts
        return Separation(*own, scatter, errors)

    def at(self, size: float, separation: Separation | None = None) -> DiscrepancyOfSize:
        """Return the discrepancy at a size (N), separated if a separation is given."""
        whole = self._by_size.get(size)
        if whole is None:
            variances = 1.0 + self.rough * size**2 * self.whitener.precisions
            root = variances**-0.5
            scaled = size * self.shapes * root if size > 0.0 else np.zeros((0, root.size))
            factor = np.linalg.cholesky(np.eye(len(scaled)) + scaled @ scaled.T)
            volume = np.log(variances).sum() + 2.0 * np.log(np.diag(factor)).sum()
            axes = solve_triangular(factor, scaled, lower=True, check_finite=False)
            whole = DiscrepancyOfSize.whole(size, root, axes, float(volume))
            # a size off the grid is one mode's own: to keep it would take a megabyte a mode
            if size in self.sizes:
                self._by_size[size] = whole
                if self.kept is not None and len(self._by_size) > self.kept:
                    self._by_size.pop(next(iter(self._by_size)))
        return whole if separation is None else separation.at(whole)

    def log_likelihoods(
        self,
        residuals: Array,
        separation: Separation | None = None,
        sizes: Sequence[int] | None = None,
    ) -> Array:
        """Return log likelihoods (K, S) of whitened residuals (K, n), plus log priors of sizes.

        Only sizes of the indices ``sizes`` are computed, if given; the others have none.
        """
        logs = np.full((len(residuals), self.sizes.size), -np.inf)
        for k in range(self.sizes.size) if sizes is None else sizes:
            discrepancy = self.at(float(self.sizes[k]), separation)
            logs[:, k] = self.log_prior[k] - 0.5 * (
                discrepancy.squares(residuals) + discrepancy.log_volume
            )
        return logs

    def likeliest_size(
        self, residual: Array, guess: float = 0.0, separation: Separation | None = None
    ) -> float:
        """Return the size (N) of highest density given a whitened residual (n,), as `likeliest`."""

        def loss(k: int) -> tuple[float, Scatter]:
            return -float(self.log_likelihoods(residual[None], separation, [k])[0, k]), NONE

        return self._descended(guess, loss)[0]

    def likeliest(
        self, residual: Array, guess: float, separation: Separation
    ) -> tuple[float, Scatter]:
        """Return the size (N) and the scatter of highest density given a whitened residual (n,)."""
        alone = separation.with_scatter(NONE)
        if self.scatter is None or alone.parts is None:
            return self.likeliest_size(residual, guess, alone), NONE
        prior, groups = self.scatter, alone.scaled_rows[1]
        vectors = np.concatenate([residual[None], alone.separated_rows])

        def loss(index: int) -> tuple[float, Scatter]:
            discrepancy = self.at(float(self.sizes[index]), alone)
            products = discrepancy.products(vectors)
            own = 0.5 * (float(products[0, 0]) + discrepancy.log_volume)
            more, scatter = likeliest(products[1:, 1:], products[0, 1:], groups, prior)
            return own - float(self.log_prior[index]) + more, scatter

        return self._descended(guess, loss)

    def _descended(
        self, guess: float, loss_at: Callable[[int], tuple[float, Scatter]]
    ) -> tuple[float, Scatter]:
        """Return the size (N) of the lowest loss, and the scatter with it."""
        count = self.sizes.size
        at_zero = 0.0, *loss_at(0)
        if count == 1:
            return 0.0, at_zero[2]
        index = int(np.argmin(np.abs(self.sizes - guess))) if guess > 0.0 else count // 3
        lowest, scatter = loss_at(index)
        for step in (1, -1):
            first = index
            while 0 < index + step < count and (found := loss_at(index + step))[0] < lowest:
                index, (lowest, scatter) = index + step, found
            if index != first:
                break
        above = self.sizes[index].item(), lowest, scatter
        size, _, scatter = min(at_zero, above, key=lambda one: one[1])
        return size, scatter

    def weights(
        self, residual: Array, size: float, count: int | None = None
    ) -> tuple[Array, Array]:
        """Return mean and covariance root of the features' coefficients w at a size (N) above 0."""
        discrepancy = self.at(size)
        shapes = self.shapes[:count] * discrepancy.root
        precision = shapes @ shapes.T + np.eye(len(shapes)) / size**2
        mean = np.linalg.solve(precision, shapes @ (residual * discrepancy.root).T).T
        return np.asarray(mean), np.linalg.inv(np.linalg.cholesky(precision))
