r"""Whether an effect acts by the same constants wherever it acts, or each test would need its own.

What is on no list may look like an effect of the list, but it obeys another law: an imitation fits
each test by another strength. The force e(x) that an effect adds at a mode is let free to be
stronger or weaker in each test and in each kind of phase (loading, hold, unloading, recovery),

.. math:: e(x)\,(1 + \delta_{test} + \delta_{phase}), \qquad \delta \sim N(0, \tau^2),

with tau = 0.3 for an imitation, and 0.05 for the effect itself, as no real pad keeps a law exactly
(`Settings.imitation`).
With V its whitened parts, J and H the Jacobian and curvature of the hypothesis and Q of
`discrepancy`, to the first order (a random-effects score; Verbeke & Molenberghs 2003,
doi:10.1111/1541-0420.00032),

.. math:: A = V Q V^T - V Q J^T H^{-1} J Q V^T, \quad b = V Q r, \quad
          \ln L(\tau) = \tfrac12 b^T (A + \tau^{-2})^{-1} b - \tfrac12 \ln |1 + \tau^2 A|

and B = L(0.3) / L(0.05) is the Bayes factor of an imitation. The constants and the discrepancy come
first: only what neither takes speaks for it. Of an effect that is what it is called the mean of B
is 1, so that it exceeds 20 in one pad of twenty at most (Markov's inequality).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.settings import Imitation
from qlvbayes.diagnosis.weighed import Weighed
from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.features import Locations
from qlvbayes.inference.starts import transferred

Array = NDArray[np.float64]


def varies(search: Search, samples: Samples, found: Weighed, effect: str) -> bool:
    """Whether one effect of a hypothesis is rather an imitation."""
    imitation = search.settings.imitation
    found_odds = log_odds_of_varying(search.density, samples, found, effect, imitation)
    return found_odds > math.log(imitation.odds)


def log_odds_of_varying(
    density: Density,
    samples: Samples,
    found: Weighed,
    effect: str,
    imitation: Imitation,
) -> float:
    """Log Bayes factor of an imitation, of one effect of a hypothesis, at its mode."""
    point, space = found.point, density.space
    less = found.hypothesis.less(effect)
    theta = transferred(point.own, point.theta, space.parameters(less))
    without = space.forces(less, space.parameters(less).constants(theta[None]))[0]
    parts = _parts(samples, point.predicted - without)
    sized = density.discrepancy.at(found.mode.size, point.separation)
    gradient, free = point.added_terms(density.whitener(parts), sized)
    return log_bayes_factor(free, -gradient, imitation)


def log_bayes_factor(free: Array, slope: Array, imitation: Imitation) -> float:
    """Log B of strengths (G,) whose log likelihood has the slope b and minus the curvature A."""
    values, axes = np.linalg.eigh(0.5 * (free + free.T))
    squares, values = (axes.T @ slope) ** 2, np.maximum(values, 0.0)
    holds = _log_likelihood(squares, values, imitation.holds)
    return _log_likelihood(squares, values, imitation.varies) - holds


def _log_likelihood(squares: Array, values: Array, tau: float) -> float:
    volume = np.log1p(tau**2 * values).sum()
    return float(0.5 * (squares / (values + tau**-2)).sum() - 0.5 * volume)


def _parts(samples: Samples, force: Array) -> Array:
    """(G, T, B) of a force (T, B): in each test (phase, of one alone), each kind of phase."""
    real = samples.space.real
    places = Locations.from_blocks(samples.experiment, samples.trials, samples.space.record.blocks)
    masks = [out for out, _, _ in samples.left_out()]
    masks += [places.phase == kind for kind in np.unique(places.phase)]
    found = np.zeros((len(masks), *force.shape))
    for one, mask in zip(found, masks, strict=True):
        one[real] = np.where(mask, force[real], 0.0)
    return found
