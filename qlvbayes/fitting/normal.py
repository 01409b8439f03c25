"""A normal distribution over the flat vector: what an optimum and its curvature give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class NormalApproximation:
    """Mean (D,) and covariance (D, D) over theta."""

    mean: np.ndarray
    covariance: np.ndarray

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, D) draws."""
        root = np.linalg.cholesky(self.covariance)
        return self.mean + rng.standard_normal((count, self.mean.size)) @ root.T


LARGEST_SD = 3.0  # of a direction that the data leave open; theta's units are of order one


def covariance_from(curvature: np.ndarray) -> np.ndarray:
    """Inverse of a curvature matrix (D, D), with sds of ``LARGEST_SD`` at most."""
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    kept = np.maximum(values, 1.0 / LARGEST_SD**2)
    return (vectors / kept) @ vectors.T
