r"""Draw the errors of a fit at any samples of a pad: noise, and discrepancy given the fitted tests.

Given a discrepancy of size s and a floor of scale phi, the coefficients w of its smooth functions
are normal given the fitted tests' whitened residuals r (`discrepancy.Discrepancy.weights`, at the
size s / phi). At a sample x the features phi(x) leave out a part of the smooth functions (namely
the function of the sample's own test, if that was not fitted). Together with the rough part it has
the variance

.. math:: s^2 \left(g^2 - \phi(x)^T \phi(x) + \rho\right).

Realisations of the noise floor at single readings are drawn separately.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.fitting.posterior import Predictor
from qlvbayes.inference.common_errors import stage_changes, with_common_errors
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.features import Features, Locations
from qlvbayes.io.arrays import Array
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.record import Blocks


def realisations(
    floors: Sequence[NoiseFloor], samples: Blocks, rng: np.random.Generator
) -> np.ndarray:
    """Return one realisation of each of F floors at n single readings, (F, n) in N."""
    time, weight, scale = (np.asarray(x) for x in (samples.first, samples.weight, samples.scale))
    extra, timing = np.asarray(samples.extra), np.asarray(samples.timing)
    white, ou, tau = (
        np.array([getattr(floor, name) for floor in floors])[:, None]
        for name in ("white", "ou", "tau")
    )
    shape = (len(floors), time.size)
    errors = scale * (
        white * weight * rng.standard_normal(shape) + ou * _walk(time, tau[:, 0], rng)
    )
    errors += extra * rng.standard_normal((len(floors), 1))
    errors += timing * rng.standard_normal(shape)
    contact = np.asarray(samples.contact)
    if contact.any():
        errors += contact * rng.standard_normal((len(floors), 1))
    return np.asarray(errors)


def _walk(time: np.ndarray, tau: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return unit Ornstein-Uhlenbeck processes (D, n) of correlation times tau (D,)."""
    memory = np.exp(-np.diff(time) / tau[:, None])
    kicks = rng.standard_normal((tau.size, time.size))
    kicks[:, 1:] *= np.sqrt(1.0 - memory**2)
    for k in range(1, time.size):
        kicks[:, k] += memory[:, k - 1] * kicks[:, k - 1]
    return kicks


def discrepancy_draws(
    experiment: Experiment,
    predictor: Predictor,
    fitted: Sequence[Trial],
    constants: Array,
    locations: Locations,
    rng: np.random.Generator,
) -> Array:
    """Return draws (R, N) in N of the discrepancy at N locations, one for each row of constants."""
    sizes, scales = constants[:, -1], constants[:, -2]
    draws = np.zeros((len(constants), locations.size.size))
    rows = np.flatnonzero(sizes > 0.0)
    if not rows.size:
        return draws
    blocks = predictor.record.blocks
    discrepancy = Discrepancy.from_blocks(experiment, fitted, blocks)
    discrepancy = with_common_errors(discrepancy, stage_changes(fitted, blocks))
    residuals = discrepancy.whitener(predictor.residuals(constants[rows]))
    features = Features.from_locations(Locations.from_blocks(experiment, fitted, blocks))(locations)
    ratios = sizes[rows] / scales[rows]
    left_out = np.maximum(locations.size**2 - np.sum(features**2, axis=0), 0.0) + discrepancy.rough
    for ratio in np.unique(ratios):
        same = ratios == ratio
        mean, root = discrepancy.weights(residuals[same], float(ratio))
        coefficients = mean + scales[rows[same], None] * (rng.standard_normal(mean.shape) @ root)
        noise = rng.standard_normal((len(coefficients), left_out.size)) * np.sqrt(left_out)
        draws[rows[same]] = coefficients @ features + sizes[rows[same], None] * noise
    return draws
