"""Student-t clouds that a posterior is sampled from.

A half-normal number y = log A is drawn as A too: the force is linear in an amplitude, so that its
posterior is nearly a normal cut off at A = 0, and the ridge along which the other constants make up
for it is straight in A and bent in log A. Where a factor and a rate trade off, it is straight in
log A instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import multivariate_t

_TAIL = 5.0  # degrees of freedom


@dataclass(frozen=True, eq=False)
class Cloud:
    """A Student-t of free numbers (F,), of which those at ``linear`` (F,) enter exponentiated.

    Its shape is in units of ``sds`` (F,), as these differ by many decades.
    """

    centre: np.ndarray
    sds: np.ndarray
    shape: multivariate_t
    linear: np.ndarray

    @classmethod
    def about(cls, top: np.ndarray, covariance: np.ndarray, linear: np.ndarray) -> Cloud:
        """About a top (F,) with the covariance (F, F) of the free numbers there."""
        scale = np.where(linear, np.exp(np.where(linear, top, 0.0)), 1.0)
        return _cloud(_entered(top, linear), covariance * np.outer(scale, scale), linear)

    def like(self, draws: np.ndarray, weights: np.ndarray) -> Cloud:
        """The cloud with the mean and covariance of weighted draws (N, F)."""
        places = _entered(draws, self.linear)
        centre = weights @ places
        apart = places - centre
        return _cloud(centre, (weights[:, None] * apart).T @ apart, self.linear)

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, F) free numbers; nan where an amplitude came out below zero."""
        found = self.centre + self.sds * self.shape.rvs(count, rng).reshape(count, -1)
        real = np.where(self.linear & (found <= 0.0), np.nan, found)
        return np.where(self.linear, np.log(np.where(self.linear, real, 1.0)), real)

    def log_density(self, numbers: np.ndarray) -> np.ndarray:
        """(N,) per unit of the free numbers (N, F)."""
        places = _entered(numbers, self.linear)
        volume = np.sum(np.where(self.linear, numbers, 0.0), axis=1) - np.log(self.sds).sum()
        return self.shape.logpdf((places - self.centre) / self.sds) + volume


def _cloud(centre: np.ndarray, covariance: np.ndarray, linear: np.ndarray) -> Cloud:
    sds = np.sqrt(np.diag(covariance))
    return Cloud(centre, sds, multivariate_t(None, covariance / np.outer(sds, sds), _TAIL), linear)


def _entered(numbers: np.ndarray, linear: np.ndarray) -> np.ndarray:
    """Free numbers as they enter the cloud."""
    return np.where(linear, np.exp(np.where(linear, numbers, 0.0)), numbers)
