r"""An effect in a form other than the list's law: what it adds, times a smooth factor.

.. math:: F = F_0 + (F_1 - F_0) \Big(1 + \sum_{k=1}^3 a_k P_k(x) + \sum_{k=1}^3 b_k P_k(y)\Big)

F_1, F_0: the force with the effect and without it; P_k: Legendre polynomials; x, y: depth and the
pad's clock, each over its range in the study. a_k and b_k have normal priors about 0, where the
factor is 1. A drag that grows with depth or a drift that levels off is then still a drag or a
drift.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from numpy.polynomial import legendre
from scipy.stats import norm

from qlvbayes.diagnosis.samples import Samples
from qlvbayes.experiment import Experiment, Trial
from qlvbayes.inference import linearised
from qlvbayes.inference.gaussnewton import (
    Point,
    ascend,
    noise_along,
    pad_directions,
    positive_part,
    predict_along,
)
from qlvbayes.inference.subset import Ensemble, Subset

_ORDERS = 3
_SDS = np.tile(0.7 / np.arange(1, _ORDERS + 1), 2)  # of the coefficients' priors: (J,)


@dataclass(frozen=True, eq=False)
class OtherForm:
    """One effect of a model, free to change its form; see the module.

    A place is theta (D,) of the ensemble followed by the coefficients (J,).
    """

    experiment: Experiment
    ensemble: Ensemble
    subset: Subset
    effect: str

    @property
    def free(self) -> np.ndarray:
        """Places of the free numbers, the coefficients last."""
        size = self.ensemble.posterior.size
        return np.append(self.subset.theta, np.arange(size, size + _SDS.size))

    def split(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Theta (..., D) and coefficients (..., J)."""
        size = self.ensemble.posterior.size
        return place[..., :size], place[..., size:]

    def fit(self, point: Point, weight: np.ndarray | None = None, steps: int = 30) -> Point:
        """The highest point, from a fit in the list's own form or in another one."""
        start = np.zeros(self.ensemble.posterior.size + _SDS.size)
        start[: point.theta.size] = point.theta
        return ascend(lambda place: self._evaluate(place, weight), start, self.free, steps)

    def factor(self, depth: np.ndarray, clock: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """What the effect is multiplied by (..., N) at depths (N,) and clock times (N,)."""
        scales = self.experiment.scales
        return 1.0 + np.tensordot(
            coefficients, _curves(depth / scales.depth, clock / scales.clock), 1
        )

    def trial_factor(
        self, trial: Trial, time: np.ndarray, coefficients: np.ndarray
    ) -> np.ndarray:
        """The factor (..., N) at times of one trial."""
        clock = trial.test.start_s - self.experiment.clock_zero + time
        return self.factor(trial.trajectory.displacement(time), clock, coefficients)

    def without(self, constants: np.ndarray) -> np.ndarray:
        """Constants (..., P) with the effect at its null."""
        found = np.array(constants)
        for name, value in self.ensemble.effect(self.effect).null.items():
            found[..., self.ensemble.names.index(f"{self.effect}.{name}")] = value
        return found

    def predict(self, samples: Samples, points: list[Point]) -> list[list[np.ndarray]]:
        """Force of some points at each trial's samples: [W][T] arrays (n,)."""
        constants = np.stack([point.constants for point in points])
        full, base = samples.predict(constants), samples.predict(self.without(constants))
        found = []
        for point, with_it, without in zip(points, full, base, strict=True):
            _, coefficients = self.split(point.theta)
            factors = [
                self.trial_factor(trial, trial.test.time[rows], coefficients)
                for trial, rows in zip(samples.trials, samples.rows, strict=True)
            ]
            found.append(
                [b + (f - b) * x for f, b, x in zip(with_it, without, factors, strict=True)]
            )
        return found

    @cached_property
    def curves(self) -> np.ndarray:
        """(J, T, B) polynomials of depth and clock at the blocks."""
        record, scales = self.ensemble.posterior.record, self.experiment.scales
        motion = record.motion
        middle = 0.5 * (np.asarray(record.blocks.first) + np.asarray(record.blocks.last))
        places = zip(middle, np.asarray(motion.time), np.asarray(motion.displacement), strict=True)
        depth = np.stack([np.interp(t, time, displacement) for t, time, displacement in places])
        clock = np.asarray(motion.start)[:, None] + middle
        return _curves(depth / scales.depth, clock / scales.clock)

    def along(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """Block means (T, B) at a point, and slopes (K, T, B) along its free numbers, padded."""
        _, coefficients = self.split(point.theta)
        directions = point.slopes.T[: self.subset.theta.size]
        predicted, slopes = self._along(point.constants, directions, coefficients)
        return predicted, _padded(slopes)

    def _along(
        self, constants: np.ndarray, directions: np.ndarray, coefficients: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Block means (T, B) and slopes (F + J, T, B) along directions (F, P) and coefficients."""
        off = self.without(constants)
        moving = np.where(off == constants, directions, 0.0)  # at its null the effect stays there
        full, slopes = predict_along(self.ensemble, constants, directions)
        base, base_slopes = predict_along(self.ensemble, off, moving)
        factor = 1.0 + np.tensordot(coefficients, self.curves, 1)
        own = base_slopes + (slopes - base_slopes) * factor
        added = full - base
        return base + added * factor, np.concatenate([own, added * self.curves])

    def _evaluate(self, place: np.ndarray, weight: np.ndarray | None) -> Point:
        """Density and its derivatives; tests count by ``weight`` (T,)."""
        posterior, free = self.ensemble.posterior, self.subset.theta
        theta, coefficients = self.split(place)
        terms = linearised.prior_terms(posterior, jnp.asarray(theta))
        constants = self.subset.nulled(np.asarray(terms.constants))
        slopes = np.asarray(terms.slopes)[:, free] * np.isnan(self.subset.null)[:, None]
        predicted, own = self._along(constants, slopes.T, coefficients)
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
        gradient[free.size :] += coefficients / _SDS**2
        hessian = np.asarray(terms.hessian)[np.ix_(free, free)]
        curvature[: free.size, : free.size] += positive_part(-hessian)
        curvature[free.size :, free.size :] += np.diag(_SDS**-2.0)
        prior = np.asarray(terms.log_prior)[self.subset.priors].sum()
        prior += norm.logpdf(coefficients, 0.0, _SDS).sum()
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


def _padded(slopes: np.ndarray) -> np.ndarray:
    """(K, T, B) filled up with zeros to a multiple of 16, so that few sizes are compiled."""
    missing = -len(slopes) % 16
    return np.concatenate([slopes, np.zeros((missing, *slopes.shape[1:]))])


def _curves(depth: np.ndarray, clock: np.ndarray) -> np.ndarray:
    """(J, ...) Legendre polynomials of depth and clock, both over their range."""
    depth, clock = np.clip(depth, 0.0, 1.0), np.clip(clock, 0.0, 1.0)
    orders = np.eye(_ORDERS + 1)[1:]
    return np.stack([legendre.legval(2.0 * x - 1.0, o) for x in (depth, clock) for o in orders])
