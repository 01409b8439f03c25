r"""Fit by least squares from the positions of the sliders.

For block means with residual r and slopes J, weighted by the measured noise of each as if blocks
were independent, the loss

.. math:: \ell = \tfrac12 r^T r - \ln \pi(\theta)

is minimised by damped Gauss-Newton steps within the priors' bounds; the priors \pi hold the
constants that the tests do not determine.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.density import Density, Point, Terms
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import bounded_step, predicted_decrease

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STEPS = 60  # most steps that are tried
_ENOUGH = 1e-3  # relative decrease of the loss below which a predicted step ends the search
_DAMPING = (1e-3, 1e-7, 1e9)  # first, least, most


@dataclass(frozen=True, eq=False)
class Squares:
    """Compute the sum of squares of a density's block means.

    ``weights`` (n,) are one over a block's standard deviation (1/N).
    """

    density: Density
    weights: Array
    _force: Array = field(init=False)

    def __post_init__(self) -> None:
        force = np.asarray(self.density.space.record.blocks.force)
        object.__setattr__(self, "_force", force[self.density.space.real])

    @classmethod
    def from_density(cls, density: Density, white: float, correlated: float) -> Squares:
        """Return the sum of squares under white and correlated noise of these sds (N) of a reading.

        The white noise averages out in a block.
        """
        blocks = density.space.record.blocks
        count, weight = (np.asarray(x)[density.space.real] for x in (blocks.count, blocks.weight))
        return cls(density, 1.0 / np.hypot(white * weight / np.sqrt(count), correlated))

    def without(self, left_out: Mask) -> Squares:
        """Return the sum of squares with some of the n block means left out."""
        return Squares(self.density, np.where(left_out, 0.0, self.weights))

    def weighted(self, force: Array) -> Array:
        """Return (..., n) block means of a force (..., T, B) over their noise."""
        return np.asarray(force[..., self.density.space.real] * self.weights)

    def residual(self, point: Point) -> Array:
        """Return (n,) measured less modelled, over the noise."""
        return (self._force - point.predicted[self.density.space.real]) * self.weights

    def terms(self, point: Point) -> Terms:
        """Return loss, gradient and curvature at a point."""
        residual, slopes = self.residual(point), self.weighted(point.responses)
        return Terms(
            0.5 * float(residual @ residual) + point.prior.loss,
            point.prior.gradient - slopes @ residual,
            point.prior.curvature + slopes @ slopes.T,
        )

    def costs(self, hypothesis: Hypothesis, thetas: Array) -> Array:
        """Return (K,) sums of squares of thetas (K, F); they are infinite where a force is."""
        own = self.density.space.parameters(hypothesis)
        force = self.density.space.forces(hypothesis, own.constants(thetas))
        residuals = (self._force - force[:, self.density.space.real]) * self.weights
        with np.errstate(over="ignore"):
            return np.nan_to_num(np.sum(residuals**2, axis=1), nan=np.inf)

    def least(self, hypothesis: Hypothesis, theta: Array) -> Point | None:
        """Return the point of least loss reached from theta (F,).

        Return None where the force is not finite at theta.
        """
        point = self.density.at(hypothesis, theta)
        if point is None:
            return None
        here, (damping, least, most) = self.terms(point), _DAMPING
        for _ in range(_STEPS):
            step = bounded_step(here, damping, point)
            predicted = predicted_decrease(here, step)
            if predicted < _ENOUGH * max(abs(here.loss), 1.0) and damping <= 1.0:
                break
            tried = self.density.at(hypothesis, point.own.within(point.theta + step))
            after = self.terms(tried) if tried is not None else None
            if tried is None or after is None or not after.loss < here.loss:
                damping *= 10.0
                if damping > most:
                    break
                continue
            gain = (here.loss - after.loss) / max(predicted, 1e-300)
            damping = max(damping * (0.1 if gain > 0.5 else 1.0 if gain > 0.1 else 4.0), least)
            point, here = tried, after
        return point
