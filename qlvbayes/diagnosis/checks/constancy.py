r"""The test for imitations: whether an effect has the same constants wherever it acts.

Something unmodelled may look like a candidate effect, but it obeys another law: such an imitation
fits each test by another strength. The force e(x) that an effect adds at a mode is allowed to be
stronger or weaker in each test and in each kind of phase (loading, hold, unloading, recovery),

.. math:: e(x)\,(1 + \delta_{test} + \delta_{phase}), \qquad \delta \sim N(0, \tau^2),

with tau = 0.3 for an imitation, and 0.05 for the effect itself, as no real pad keeps a law exactly
(`DiagnosisSettings.imitation`).
With V its whitened parts, J and H the Jacobian and curvature of the hypothesis, and Q of
`inference.errors.discrepancy`, to the first order (a random-effects score; Verbeke & Molenberghs
2003, doi:10.1111/1541-0420.00032),

.. math:: A = V Q V^T - V Q J^T H^{-1} J Q V^T, \quad b = V Q r, \quad
          \ln L(\tau) = \tfrac12 b^T (A + \tau^{-2})^{-1} b - \tfrac12 \ln |1 + \tau^2 A|

and B = L(0.3) / L(0.05) is the Bayes factor of an imitation. Only what neither the constants nor
the discrepancy take speaks for an imitation. For a true effect the mean of B is 1, so that B
exceeds 20 in one pad of twenty at most (Markov's inequality).
"""

from __future__ import annotations

import math

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.settings import Imitation
from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.features import Locations
from qlvbayes.inference.starts import transferred
from qlvbayes.io.arrays import Array


def varies(search: Search, samples: Samples, candidate: Candidate, effect: str) -> bool:
    """Return whether one effect of a candidate is rather an imitation."""
    imitation = search.settings.imitation
    odds = log_odds_of_varying(search.density, samples, candidate, effect, imitation)
    return odds > math.log(imitation.odds)


def log_odds_of_varying(
    density: Density,
    samples: Samples,
    candidate: Candidate,
    effect: str,
    imitation: Imitation,
) -> float:
    """Return the log Bayes factor that one effect of a candidate is an imitation."""
    point, space = candidate.point, density.space
    less = candidate.hypothesis.less(effect)
    theta = transferred(point.own, point.theta, space.parameters(less))
    without = space.forces(less, space.parameters(less).constants(theta[None]))[0]
    parts = _parts(samples, point.predicted - without)
    sized = density.discrepancy.at(candidate.mode.size, point.separation)
    gradient, free = point.added_terms(density.whitener(parts), sized)
    return log_bayes_factor(free, -gradient, imitation)


def log_bayes_factor(free: Array, slope: Array, imitation: Imitation) -> float:
    """Return log B of G strengths, from A (G, G) and the slope b (G,) of their log likelihood."""
    values, axes = np.linalg.eigh(0.5 * (free + free.T))
    squares, values = (axes.T @ slope) ** 2, np.maximum(values, 0.0)
    holds = _log_likelihood(squares, values, imitation.holds)
    return _log_likelihood(squares, values, imitation.varies) - holds


def _log_likelihood(squares: Array, values: Array, tau: float) -> float:
    """Return ln L(tau) along the axes of A, on which b has these squares and A these values."""
    volume = np.log1p(tau**2 * values).sum()
    return float(0.5 * (squares / (values + tau**-2)).sum() - 0.5 * volume)


def _parts(samples: Samples, force: Array) -> Array:
    """Return the parts (G, T, B) of a force (T, B) in each test and in each kind of phase.

    Where there is only one test, its phases take the part of the tests.
    """
    real = samples.space.real
    locations = Locations.from_blocks(
        samples.experiment, samples.trials, samples.space.record.blocks
    )
    masks = [out for out, _, _ in samples.left_out()]
    masks += [locations.phase == kind for kind in np.unique(locations.phase)]
    parts = np.zeros((len(masks), *force.shape))
    for one, mask in zip(parts, masks, strict=True):
        one[real] = np.where(mask, force[real], 0.0)
    return parts
