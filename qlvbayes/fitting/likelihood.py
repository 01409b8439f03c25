r"""Compute the likelihood under measured noise and a discrepancy whose size is summed over.

The noise floor has the covariance :math:`\phi^2 \Sigma` and the discrepancy :math:`s^2 K`, of which
only the scale :math:`\phi` and the size s are unknown. With :math:`A \Sigma A^T = 1` and :math:`A K
A^T = \text{diag}(\kappa)`, residuals r of n block means become independent, z = A r, at any scale
and size, and

.. math:: \ln L = \ln \sum_{\phi, s} p(\phi) p(s) \exp\left(-\tfrac12 \sum_j \left[
          \frac{z_j^2}{\phi^2 + s^2 \kappa_j} + \ln (\phi^2 + s^2 \kappa_j) \right]\right)
          - \tfrac12 \ln |2 \pi \Sigma|

Under independent noise (``--noise white``) the block means are independent as they are, A = 1, and
the sum is over the values of its sd.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import softmax

from qlvbayes.io.arrays import Array


@dataclass(frozen=True, eq=False)
class NoiseLikelihood:
    """The likelihood of one record of n block means, for many residuals at once."""

    real: NDArray[np.bool_]  # (T, B): the n block means that are not padding
    axes: Array  # (n, n): A, in 1/N
    precisions: Array  # (C, n): 1/variance of z for each of C choices of scale and size
    noise: Array  # (C, n) or (C, 1): the part of that variance that is noise
    heights: Array  # (C,): log likelihood and log prior of a choice without the sum of squares
    constants: Array  # (C, Q): the noise's constants for each choice, in the order of its fields

    def white(self, vectors: Array) -> Array:
        """Return z (K, n) of block means (K, T, B) in N."""
        return np.asarray(vectors[:, self.real] @ self.axes.T)

    def log_choices(self, white: Array) -> Array:
        """Return (K, C) logarithms of likelihood times prior of each choice, for z (K, n)."""
        return np.asarray(self.heights - 0.5 * (white**2 @ self.precisions.T))

    def log_likelihood(self, residuals: Array) -> Array:
        """Return the log likelihoods (K,) of residuals (K, T, B) in N, all tests together."""
        logs = self.log_choices(self.white(residuals))
        largest = logs.max(axis=1)  # scipy's function of this name takes ten times as long
        return np.asarray(largest + np.log(np.exp(logs - largest[:, None]).sum(axis=1)))

    def drawn(self, residuals: Array, shares: Array) -> Array:
        """Return the constants (K, Q) of the choice at a share (K,), 0 to 1, of their posterior."""
        logs = self.log_choices(self.white(residuals))
        below = np.cumsum(softmax(logs, axis=1), axis=1)
        index = np.sum(below < (shares * below[:, -1])[:, None], axis=1)
        return np.asarray(self.constants[np.minimum(index, len(self.constants) - 1)])

    def choices_of(self, constants: Array) -> NDArray[np.intp]:
        """Return the choice (K,) of each of the noise's constants (K, Q).

        Raises KeyError where they are those of no choice.
        """
        known = {tuple(row): k for k, row in enumerate(self.constants.tolist())}
        return np.array([known[tuple(row)] for row in constants.tolist()])

    def conditional(self, residuals: Array, choices: NDArray[np.intp]) -> Array:
        """Return log densities (K, n) of each block mean given those before it in the record."""
        flat, back = residuals[:, self.real], np.linalg.inv(self.axes)
        logs = np.empty_like(flat)
        for choice in np.unique(choices):
            same = choices == choice
            root = np.linalg.cholesky((back / self.precisions[choice]) @ back.T)
            errors = solve_triangular(root, flat[same].T, lower=True).T
            logs[same] = -0.5 * errors**2 - np.log(np.diag(root)) - 0.5 * np.log(2.0 * np.pi)
        return logs

    def replicates(
        self, residuals: Array, choices: NDArray[np.intp], rng: np.random.Generator
    ) -> Array:
        """Return new errors (K, n) in N: new noise, and the discrepancy that residuals imply."""
        noise = self.noise[choices]
        share = noise * self.precisions[choices]
        draws = rng.standard_normal((2, *share.shape))
        left = np.sqrt(np.maximum(1.0 - share, 0.0))
        white = (1.0 - share) * self.white(residuals)
        white += np.sqrt(noise) * (left * draws[0] + draws[1])
        return np.asarray(white @ np.linalg.inv(self.axes).T)
