r"""Compute the likelihood under measured noise and a discrepancy whose size is summed over.

The noise floor has the covariance :math:`\phi^2 \Sigma` and the discrepancy :math:`s^2 K`, of which
only the scale :math:`\phi` and the size s are unknown. With :math:`A \Sigma A^T = 1` and :math:`A K
A^T = \text{diag}(\kappa)`, residuals r of n block means become independent, z = A r, at any scale
and size, and

.. math:: \ln L = \ln \sum_{\phi, s} p(\phi) p(s) \exp\left(-\tfrac12 \sum_j \left[
          \frac{z_j^2}{\phi^2 + s^2 \kappa_j} + \ln (\phi^2 + s^2 \kappa_j) \right]\right)
          - \tfrac12 \ln |2 \pi \Sigma|
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.pytree import Pytree


class FloorLikelihood(Pytree):
    """Likelihood of one record of n block means, padding left out.

    ``indices`` (n,) are those of the block means in the flattened (T, B) record. ``axes`` (n, n) is
    A (1/N). ``precisions`` (C, n) are 1/(phi^2 + s^2 kappa) for each of C pairs of a scale and a
    size, and ``heights`` (C,) are a pair's log likelihood and log prior without the sum of squares.
    ``constants`` (C, 5) are the noise's, as `noise.Floor` has them; the last two are phi and s.
    """

    indices: Array
    axes: Array
    precisions: Array
    heights: Array
    constants: Array

    def log_likelihood(self, residuals: Array) -> Array:
        """Return the log likelihood of residuals (T, B) in N, for all tests together."""
        return jax.nn.logsumexp(self.log_pairs(residuals))

    def log_pairs(self, residuals: Array) -> Array:
        """Return (C,) logarithms of likelihood times prior of each pair."""
        white = self.axes @ jnp.reshape(residuals, -1)[self.indices]
        return self.heights - 0.5 * (self.precisions @ white**2)

    def drawn(self, residuals: Array, share: Array) -> Array:
        """Return the (5,) constants of the pair at this share (0 to 1) of the pairs' posterior."""
        below = jnp.cumsum(jax.nn.softmax(self.log_pairs(residuals)))
        index = jnp.searchsorted(below, share * below[-1])
        return self.constants[jnp.minimum(index, below.size - 1)]
