"""A model with something of free form in it: what is common to all of them."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre
from scipy.stats import norm

from qlvbayes.experiment import Experiment
from qlvbayes.inference import linearised
from qlvbayes.inference.gaussnewton import Point, ascend, noise_along, pad_directions, positive_part
from qlvbayes.inference.subset import Ensemble, Subset


@dataclass(frozen=True, eq=False)
class AbstractFreeForm:
    """A subset of an ensemble and coefficients (J,) of its own, whose priors are normal about 0.

    A place is theta (D,) of the ensemble followed by the coefficients.
    """

    experiment: Experiment
    ensemble: Ensemble
    subset: Subset

    @property
    @abstractmethod
    def sds(self) -> np.ndarray:
        """(J,) of the coefficients' priors."""

    @abstractmethod
    def combine(
        self, constants: np.ndarray, directions: np.ndarray, coefficients: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Block means (T, B) and slopes (F + J, T, B) along directions (F, P) and coefficients."""

    @property
    def free(self) -> np.ndarray:
        """Places of the free numbers, the coefficients last."""
        size = self.ensemble.posterior.size
        return np.append(self.subset.theta, np.arange(size, size + self.sds.size))

    def split(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Theta (..., D) and coefficients (..., J)."""
        size = self.ensemble.posterior.size
        return place[..., :size], place[..., size:]

    def fit(
        self,
        point: Point,
        weight: np.ndarray | None = None,
        steps: int = 30,
        worth: float = -math.inf,
    ) -> Point:
        """The highest point, from a fit without the coefficients or with them; see ``ascend``."""
        start = np.zeros(self.ensemble.posterior.size + self.sds.size)
        start[: point.theta.size] = point.theta

        def at(place: np.ndarray) -> Point:
            return self._evaluate(place, weight)

        return ascend(at, start, self.free, steps, worth)

    def highest(self, start: Point, worth: float) -> Point:
        """The highest point found, from a fit without the coefficients; given up as in ``fit``."""
        return self.fit(start, worth=worth)

    def along(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """Block means (T, B) at a point, and slopes (K, T, B) along its free numbers, padded."""
        _, coefficients = self.split(point.theta)
        directions = point.slopes.T[: self.subset.theta.size]
        predicted, slopes = self.combine(point.constants, directions, coefficients)
        return predicted, _padded(slopes)

    def _evaluate(self, place: np.ndarray, weight: np.ndarray | None) -> Point:
        """Density and its derivatives; tests count by ``weight`` (T,)."""
        posterior, free = self.ensemble.posterior, self.subset.theta
        theta, coefficients = self.split(place)
        terms = linearised.prior_terms(posterior, theta)
        constants = self.subset.nulled(np.asarray(terms.constants))
        slopes = np.asarray(terms.slopes)[:, free] * np.isnan(self.subset.null)[:, None]
        predicted, own = self.combine(constants, slopes.T, coefficients)
        still = np.zeros((constants.size, coefficients.size))
        slopes = np.concatenate([slopes, still], axis=1)
        noise, noise_slopes = noise_along(posterior.noise, constants, pad_directions(slopes.T))
        judged = linearised.likelihood_terms(
            noise, noise_slopes, posterior.record, predicted, _padded(own)
        )
        losses, gradients, information = (np.asarray(x) for x in judged)
        weight = np.ones(losses.size) if weight is None else weight
        gradient = (weight @ gradients)[: len(own)]
        curvature = np.einsum("t,tij->ij", weight, information)[: len(own), : len(own)]
        gradient[: free.size] -= np.asarray(terms.gradient)[free]
        gradient[free.size :] += coefficients / self.sds**2
        hessian = np.asarray(terms.hessian)[np.ix_(free, free)]
        curvature[: free.size, : free.size] += positive_part(-hessian)
        curvature[free.size :, free.size :] += np.diag(self.sds**-2.0)
        prior = np.asarray(terms.log_prior)[self.subset.priors].sum()
        prior += norm.logpdf(coefficients, 0.0, self.sds).sum()
        return Point(
            subset=self.subset,
            theta=place,
            constants=constants,
            loss=float(weight @ losses - prior),
            losses=losses,
            gradient=gradient,
            curvature=curvature,
            slopes=slopes,
        )


@dataclass(frozen=True, eq=False)
class AbstractCurvedForm(AbstractFreeForm):
    """Its coefficients are those of curves over depth and the pad's clock."""

    @abstractmethod
    def curves(self, depth: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """(J, ...) at depths and clock times, both from 0 to 1."""

    @cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Depth and clock time (T, B) of the blocks, both from 0 to 1."""
        record, scales = self.ensemble.posterior.record, self.experiment.scales
        motion = record.motion
        middle = 0.5 * (np.asarray(record.blocks.first) + np.asarray(record.blocks.last))
        places = zip(middle, np.asarray(motion.time), np.asarray(motion.displacement), strict=True)
        depth = np.stack([np.interp(t, time, displacement) for t, time, displacement in places])
        clock = np.asarray(motion.start)[:, None] + middle
        return depth / scales.depth, clock / scales.clock

    @cached_property
    def at_blocks(self) -> np.ndarray:
        """(J, T, B) the curves at the blocks."""
        return self.curves(*self.places)


def _padded(slopes: np.ndarray) -> np.ndarray:
    """(K, T, B) filled up with zeros to a multiple of 16, so that few sizes are compiled."""
    missing = -len(slopes) % 16
    return np.concatenate([slopes, np.zeros((missing, *slopes.shape[1:]))])


def polynomials(x: np.ndarray, orders: int) -> np.ndarray:
    """(orders, ...) Legendre polynomials of order 1 and up over x from 0 to 1."""
    x = np.clip(x, 0.0, 1.0)
    return np.stack([legendre.legval(2.0 * x - 1.0, row) for row in np.eye(orders + 1)[1:]])


def slopes_of_polynomials(x: np.ndarray, orders: int) -> np.ndarray:
    """(orders, ...) their slopes, 0 outside of 0 to 1."""
    inside = (x >= 0.0) & (x <= 1.0)
    rows = np.eye(orders + 1)[1:]
    slopes = [2.0 * legendre.legval(2.0 * x - 1.0, legendre.legder(row)) for row in rows]
    return np.stack(slopes) * inside
