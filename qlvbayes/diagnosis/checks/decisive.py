r"""The decisive readings: in how many readings the evidence for an effect lies.

With C = L L^T the covariance of noise and discrepancy of a hypothesis at its likeliest size, the
log likelihood is a sum over the block means, each given the ones before it in its test,

.. math:: \ln p(y_k \mid y_1 \dots y_{k-1}) = -\tfrac12 z_k^2 - \ln L_{kk} - \tfrac12 \ln 2 \pi,
          \quad z = L^{-1} (y - f)

The differences between a hypothesis with an effect and the same without it, the largest first, say
how many block means hold half of the gain in log likelihood. For an effect that acts in whole
phases there are many; evidence that lies in a handful of them may as well be a fault of these
readings.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np
from scipy.linalg import cholesky, solve_triangular

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.result import Decisive
from qlvbayes.inference.density import Density
from qlvbayes.io.arrays import Array
from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.phases import phase_index

_HALF = 0.5  # of the difference of the log likelihoods


def log_densities(density: Density, candidate: Candidate) -> Array:
    """Return the log density (n,) of every block mean given those before it, at a mode."""
    whitener, point = density.whitener, candidate.point
    force = np.asarray(density.space.record.blocks.force)
    left = whitener.flattened((force - point.predicted)[None])[0]
    covariance = whitener.covariance
    covariance += density.discrepancy.covariance(candidate.mode.size, point.separation)
    root = cholesky(covariance, lower=True, check_finite=False)
    errors = solve_triangular(root, left, lower=True, check_finite=False)
    return np.asarray(-0.5 * errors**2 - np.log(np.diag(root)) - 0.5 * np.log(2.0 * np.pi))


def fewest(gains: Array) -> int:
    """Return how many of the gains (n,) at least add up to half of their sum, which is above 0."""
    sums = np.cumsum(np.sort(gains)[::-1])
    return int(np.searchsorted(sums, _HALF * gains.sum())) + 1


def decisive(
    density: Density, trials: Sequence[Trial], candidate: Candidate, without: Candidate
) -> Decisive | None:
    """Return the fewest block means that hold half of the evidence for an effect."""
    gains = log_densities(density, candidate) - log_densities(density, without)
    if not gains.sum() > 0.0:
        return None
    blocks = jax.tree.map(np.asarray, density.space.record.blocks)
    middle = density.whitener.flattened(0.5 * (blocks.first + blocks.last)[None])[0]
    first = int(np.argmax(gains))
    trial = trials[int(density.whitener.tests[first])]
    phase = trial.phases[int(phase_index(trial.phases, middle[first : first + 1])[0])]
    return Decisive(
        blocks=fewest(gains),
        of=gains.size,
        test=trial.name,
        phase=phase.kind,
        time=float(middle[first]),
    )
