r"""What a model leaves beyond noise: smooth functions (`features`), of an unknown size.

Block means are y = f + B w + e, with the whitened shapes B (M, n), coefficients w ~ N(0, s^2) and
noise e of unit variance. With B's singular values :math:`\sqrt{\lambda_m}` and the unit vectors
u_m, the coefficients are integrated out in closed form (Kennedy & O'Hagan 2001,
doi:10.1111/1467-9868.00294, with a finite basis):

.. math:: -2 \ln L(s) = |r|^2 - \sum_m k_m (u_m \cdot r)^2 + \sum_m \ln(1 + s^2 \lambda_m),
          \quad k_m = \frac{s^2 \lambda_m}{1 + s^2 \lambda_m}

The size s runs over a grid from nothing to a third of the peak force. Its prior has half its mass
at nothing and falls as 1/(1 + s/t) per factor beyond the tolerance t, so that a size has to be paid
for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SIZES = np.geomspace(3e-4, 0.3, 19)  # of the peak force: below the least, noise hides it
_NONE = 0.5  # prior probability that there is none
_NEGLIGIBLE = 1e-10  # of the largest strength


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """Shapes of n whitened block means, and the sizes they may have.

    shapes (M, n): whitened, as given; axes (M', n): unit vectors u_m; strengths (M',): lambda_m
    (1/N^2); sizes (S,): N, the first is 0; log_prior (S,).
    """

    shapes: Array
    axes: Array
    strengths: Array
    sizes: Array
    log_prior: Array

    @classmethod
    def of(cls, shapes: Array, peak: float, tolerance: float) -> Discrepancy:
        """Of whitened shapes (M, n); peak: largest force (N), of which tolerance is a share."""
        strengths, rotation = np.linalg.eigh(shapes @ shapes.T)
        kept = strengths > _NEGLIGIBLE * max(strengths.max(initial=0.0), 1e-200)
        strengths = strengths[kept]
        axes = (rotation[:, kept] / np.sqrt(strengths)).T @ shapes
        falling = 1.0 / (1.0 + _SIZES / max(tolerance, _SIZES[0]))
        weights = np.concatenate([[_NONE], (1.0 - _NONE) * falling / falling.sum()])
        sizes = peak * np.concatenate([[0.0], _SIZES])
        return cls(shapes, axes, strengths, sizes, np.log(weights))

    @property
    def peak(self) -> float:
        """Largest force (N), of which sizes are shares."""
        return float(self.sizes[-1] / _SIZES[-1])

    def of_some(self, rows: NDArray[np.bool_]) -> Discrepancy:
        """Of some of the n numbers only."""
        fewer = Discrepancy.of(self.shapes[:, rows], self.peak, 1.0)
        return Discrepancy(fewer.shapes, fewer.axes, fewer.strengths, self.sizes, self.log_prior)

    def taken(self, size: float | Array) -> Array:
        """(..., M') share k_m of each axis that a discrepancy of a size (..., 1) (N) takes."""
        return 1.0 - 1.0 / (1.0 + size**2 * self.strengths)

    def log_volume(self, size: float | Array) -> Any:
        """(...) sum of ln(1 + s^2 lambda_m) at a size (..., 1) (N)."""
        return np.log1p(size**2 * self.strengths).sum(axis=-1)

    def losses(self, squares: Array) -> Array:
        """(S,) what every size adds to the loss |r|^2/2 of squares (M',) of a residual's parts."""
        strengths = self.sizes[:, None] ** 2 * self.strengths
        return 0.5 * (np.log1p(strengths) - strengths / (1.0 + strengths) * squares).sum(axis=1)
