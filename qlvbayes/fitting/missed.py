r"""What a fit misses at any samples of a pad, drawn given the tests that were fitted.

Of a discrepancy of size s beside a floor of scale phi the coefficients w of smooth functions are
normal given the fitted tests' whitened residuals r (`discrepancy.Discrepancy.weights`, at the size
s / phi). At a sample x the features phi(x) leave out a part of the smooth functions (what is the
sample's test's own, if that was not fitted), which has the variance

.. math:: s^2 \left(g^2 - \phi(x)^T \phi(x) + \rho\right)

together with the rough part.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from qlvbayes.fitting import compiled
from qlvbayes.inference.discrepancy import ROUGH, Discrepancy
from qlvbayes.inference.features import Features, Places
from qlvbayes.model.posterior import Posterior
from qlvbayes.preprocess.experiment import Experiment, Trial

Array = NDArray[np.float64]

BATCH = 100
"""Draws that are run at once."""


def missed(
    experiment: Experiment,
    posterior: Posterior,
    fitted: Sequence[Trial],
    constants: Array,
    places: Places,
    rng: np.random.Generator,
) -> Array:
    """(R, N) draws of the discrepancy (N) at places, one for each row (R, P) of constants.

    posterior: of the fitted trials; the last two of its constants are the factor of the noise and
    the size of the discrepancy. What the features leave out is drawn sample by sample.
    """
    sizes, scales = constants[:, -1], constants[:, -2]
    found = np.zeros((len(constants), places.size.size))
    rows = np.flatnonzero(sizes > 0.0)
    if not rows.size:
        return found
    blocks = posterior.record.blocks
    predicted = compiled.in_batches(compiled.predictions, posterior, constants[rows], size=BATCH)
    made = Discrepancy.on(experiment, fitted, blocks)
    residuals = made.whitener(np.asarray(blocks.force) - predicted)
    features = Features.of(Places.of_blocks(experiment, fitted, blocks))(places)
    ratios = sizes[rows] / scales[rows]
    own = np.maximum(places.size**2 - np.sum(features**2, axis=0), 0.0) + ROUGH
    for ratio in np.unique(ratios):
        at = ratios == ratio
        mean, root = made.weights(residuals[at], float(ratio))
        draws = mean + scales[rows[at], None] * (rng.standard_normal(mean.shape) @ root)
        noise = rng.standard_normal((len(draws), own.size)) * np.sqrt(own)
        found[rows[at]] = draws @ features + sizes[rows[at], None] * noise
    return found
