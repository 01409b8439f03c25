r"""What a model leaves beyond noise: smooth functions and a rough part, of an unknown size.

Block means are y = f + B w + u + e, with `features` B (M, n), coefficients w ~ N(0, s^2), a rough
part u ~ N(0, rho s^2), independent from block to block, which stands for kinks and all else that
no smooth function follows, and noise e. With whitened features and the variances lambda of
`whitening`, everything but f is integrated out in closed form (Kennedy & O'Hagan 2001,
doi:10.1111/1467-9868.00294, with a finite basis):

.. math:: Q^{-1} = D + s^2 B^T B, \quad D = 1 + \rho s^2 / \lambda, \quad
          -2 \ln L(s) = r^T Q r + \ln |Q^{-1}|

Without the rough part, what a wrong model leaves beside the features would be weighed by the noise
alone, however large it is, and the likeliest fit would be one that follows it and nothing else.

The size s runs over a grid from nothing to a third of the peak force. Its prior has half its mass
at nothing and falls as 1/(1 + s/t) per factor beyond the tolerance t, so that a size has to be paid
for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from qlvbayes.inference.errors.features import UNDECIDED, DiscrepancyPrior, Features, Places
from qlvbayes.inference.errors.separation import Separated, Separation, Sized
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.laws.scales import TOLERANCE
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.record import Blocks

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """Features of the block means of a pad, and the sizes that it may have.

    features (M, T, B): N of unit size; peak: largest force (N); sizes (S,): N, the first is 0;
    log_prior (S,); rough: rho.
    """

    features: Array
    whitener: Whitener
    peak: float
    sizes: Array
    log_prior: Array
    rough: float
    _sized: dict[float, Sized] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        features: Array,
        whitener: Whitener,
        peak: float,
        tolerance: float,
        prior: DiscrepancyPrior = UNDECIDED,
    ) -> Discrepancy:
        """Of any size; tolerance: share of the peak force (N)."""
        falling = 1.0 / (1.0 + prior.shares / max(tolerance, prior.smallest))
        weights = np.concatenate([[prior.none], (1.0 - prior.none) * falling / falling.sum()])
        every = peak * np.concatenate([[0.0], prior.shares])
        return cls(features, whitener, peak, every, np.log(weights), prior.rough)

    @classmethod
    def on(
        cls,
        experiment: Experiment,
        trials: Sequence[Trial],
        blocks: Blocks,
        tolerance: float = TOLERANCE,
        prior: DiscrepancyPrior = UNDECIDED,
    ) -> Discrepancy:
        """Of block means (T, B) of some trials of a pad, under its noise floor."""
        peak = experiment.scales.force
        places = Places.of_blocks(experiment, trials, blocks, prior)
        shapes = Features.of(places)(places)
        real = np.asarray(blocks.real)
        full = np.zeros((len(shapes), *real.shape))
        full[:, real] = shapes
        whitener = Whitener.of(experiment.floor, blocks, peak)
        return cls.of(full, whitener, peak, tolerance, prior)

    @classmethod
    def none(cls, whitener: Whitener, peak: float) -> Discrepancy:
        """Of no size but nothing; peak: largest force (N)."""
        nothing = np.zeros((0, *np.shape(whitener.blocks)))
        return cls(nothing, whitener, peak, np.zeros(1), np.zeros(1), 0.0)

    def beside(self, features: Sequence[Array]) -> Discrepancy:
        """With more features (T, B), of unit size."""
        if not len(features):
            return self
        real = np.stack(self.whitener.blocks)
        found = np.concatenate([self.features, np.where(real, features, 0.0)])
        return replace(self, features=found, _sized={})

    def under(self, whitener: Whitener) -> Discrepancy:
        """The same under other noise."""
        return replace(self, whitener=whitener, _sized={})

    @cached_property
    def shapes(self) -> Array:
        """(M, n) whitened."""
        return self.whitener(self.features)

    @cached_property
    def plain(self) -> Array:
        """(M, n) not whitened."""
        return self.whitener.plain(self.features)

    def separated(self, responses: Array, lengths: Array, kept: float = 0.0) -> Separation:
        """From what slopes (F, T, B) of the force can follow.

        lengths (F,): natural ones; kept: share of the variance of what the slopes can follow.
        """
        slopes = self.whitener.plain(responses)
        if not len(self.features):
            slopes = np.zeros((0, slopes.shape[1]))

        def tied(rows: Array) -> tuple[Array, Array]:
            ties = (rows @ self.plain.T) @ self.plain
            ties -= 0.5 * (1.0 + kept) * (ties @ rows.T) @ rows
            return ties, self._tied_moments(rows)

        return Separation(slopes, lengths[: len(slopes)], tied, self.whitener.of_plain)

    def _tied_moments(self, rows: Array) -> Array:
        """(R, n) Q T (1 - P), of the variances T of what is not known of moments."""
        moments = rows * np.concatenate(self.whitener.timing)
        return np.asarray(moments - (moments @ rows.T) @ rows)

    def covariance(self, size: float, separation: Separation) -> Array:
        """(n, n) what a discrepancy of a size (N), separated, adds to the noise's covariance."""
        count = self.plain.shape[1]
        if size == 0.0:
            return np.zeros((count, count))
        rows = separation.rows
        rest = self.plain - (self.plain @ rows.T) @ rows
        moments = rows.T @ self._tied_moments(rows)
        found = size**2 * (rest.T @ rest + self.rough * np.eye(count))
        return np.asarray(found - moments - moments.T)

    def at(self, size: float, separation: Separation | None = None) -> Sized | Separated:
        """Of a size (N), as it is or separated from what a model's slopes can follow."""
        plain = self._at(size)
        return plain if separation is None else separation.at(plain)

    def _at(self, size: float) -> Sized:
        if size not in self._sized:
            variances = 1.0 + self.rough * size**2 * self.whitener.precisions
            root = variances**-0.5
            own = size * self.shapes * root if size > 0.0 else np.zeros((0, root.size))
            factor = np.linalg.cholesky(np.eye(len(own)) + own @ own.T)
            volume = np.log(variances).sum() + 2.0 * np.log(np.diag(factor)).sum()
            axes = solve_triangular(factor, own, lower=True, check_finite=False)
            self._sized[size] = Sized(size, root, axes, float(volume))
        return self._sized[size]

    def loss(self, residual: Array, place: int, separation: Separation | None = None) -> float:
        """Minus log likelihood of a whitened residual (n,) at a size, less the size's log prior."""
        own = self.at(float(self.sizes[place]), separation)
        loss = 0.5 * (float(own.squares(residual[None])[0]) + own.log_volume)
        return loss - float(self.log_prior[place])

    def log_likelihoods(self, residuals: Array, separation: Separation | None = None) -> Array:
        """(K, S) of whitened residuals (K, n) at each size, with the sizes' log prior."""
        found = np.empty((len(residuals), self.sizes.size))
        for k, size in enumerate(self.sizes.tolist()):
            own = self.at(size, separation)
            found[:, k] = self.log_prior[k] - 0.5 * (own.squares(residuals) + own.log_volume)
        return found

    def likeliest(
        self, residual: Array, near: float = 0.0, separation: Separation | None = None
    ) -> float:
        """Size (N) of highest density given a whitened residual (n,).

        Downhill along the sizes from ``near`` (N), as the loss has one valley there; none at all is
        tried by itself, as its prior stands apart.
        """
        count = self.sizes.size
        none = self.loss(residual, 0)
        if count == 1:
            return 0.0
        place = int(np.argmin(np.abs(self.sizes - near))) if near > 0.0 else count // 3
        here = self.loss(residual, place, separation)
        for way in (1, -1):
            first = place
            while 0 < place + way < count:
                there = self.loss(residual, place + way, separation)
                if there >= here:
                    break
                place, here = place + way, there
            if place != first:
                break
        return 0.0 if none <= here else float(self.sizes[place])

    def weights(
        self, residual: Array, size: float, count: int | None = None
    ) -> tuple[Array, Array]:
        """Coefficients w of the first M = count features, or of all, at a size (N) above 0.

        residual: whitened, (n,) or (R, n). Returns their means, (M,) or (R, M), and a root (M, M)
        of their covariance, root^T root.
        """
        own = self._at(size)
        shapes = self.shapes[:count] * own.root
        precision = shapes @ shapes.T + np.eye(len(shapes)) / size**2
        mean = np.linalg.solve(precision, shapes @ (residual * own.root).T).T
        return np.asarray(mean), np.linalg.inv(np.linalg.cholesky(precision))
