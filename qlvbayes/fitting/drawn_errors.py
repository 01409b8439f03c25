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

_TINY = 1e-300  # avoids 0/0 where no time has passed


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
    walk = _smooth_walk if floors[0].smooth else _walk
    errors = scale * (white * weight * rng.standard_normal(shape) + ou * walk(time, tau[:, 0], rng))
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


def _smooth_walk(time: np.ndarray, tau: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return unit processes (D, n) of correlation e^-x (cos x + sin x), x = t/tau."""
    values = np.empty((tau.size, time.size))
    value, slope = rng.standard_normal((2, tau.size))
    values[:, 0] = value
    for k, gap in enumerate(np.diff(time), start=1):
        x = gap / tau
        decay, sine, cosine = np.exp(-x), np.sin(x), np.cos(x)
        mixed = np.sqrt(2.0) * sine
        variance = 1.0 - decay**2 * (2.0 + np.sin(2.0 * x) - np.cos(2.0 * x))
        variance = np.where(x < 1e-2, 8.0 / 3.0 * x**3 * (1.0 - 1.5 * x), variance)
        slope_variance = 1.0 - decay**2 * (2.0 - np.cos(2.0 * x) - np.sin(2.0 * x))
        slope_on_value = (
            decay**2 * 2.0 * np.sqrt(2.0) * sine**2 / np.sqrt(np.maximum(variance, _TINY))
        )
        first, second = rng.standard_normal((2, tau.size))
        value, slope = (
            decay * ((cosine + sine) * value + mixed * slope) + np.sqrt(variance) * first,
            decay * ((cosine - sine) * slope - mixed * value)
            + slope_on_value * first
            + np.sqrt(np.maximum(slope_variance - slope_on_value**2, 0.0)) * second,
        )
        values[:, k] = value
    return values


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
