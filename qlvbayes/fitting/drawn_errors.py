r"""What a fit misses at any samples of a pad, drawn given the tests that were fitted.

Of a discrepancy of size s beside a floor of scale phi the coefficients w of smooth functions are
normal given the fitted tests' whitened residuals r (`discrepancy.Discrepancy.weights`, at the size
s / phi). At a sample x the features phi(x) leave out a part of the smooth functions (what is the
sample's test's own, if that was not fitted), which has the variance

.. math:: s^2 \left(g^2 - \phi(x)^T \phi(x) + \rho\right)

together with the rough part. Realisations of the noise floor at single readings stand beside it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from qlvbayes.fitting import compiled
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.features import Features, Places
from qlvbayes.model.posterior import Posterior
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.record import Blocks

Array = NDArray[np.float64]

BATCH = 100
"""Draws that are run at once."""

_TINY = 1e-300  # variance gained over no time: no share of 0/0


def realisations(
    floors: Sequence[NoiseFloor], samples: Blocks, rng: np.random.Generator
) -> np.ndarray:
    """(len(floors), n) errors of single readings (n,), one realisation of each floor (N).

    An error of the motion is drawn once for all readings, that of its moments for each.
    """
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
    return np.asarray(errors + timing * rng.standard_normal(shape))


def _walk(time: np.ndarray, tau: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(D, n) unit Ornstein-Uhlenbeck processes of correlation times tau (D,)."""
    memory = np.exp(-np.diff(time) / tau[:, None])
    kicks = rng.standard_normal((tau.size, time.size))
    kicks[:, 1:] *= np.sqrt(1.0 - memory**2)
    for k in range(1, time.size):
        kicks[:, k] += memory[:, k - 1] * kicks[:, k - 1]
    return kicks


def _smooth_walk(time: np.ndarray, tau: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(D, n) unit processes of correlation e^-x (cos x + sin x), x = t/tau; state: their slopes."""
    found = np.empty((tau.size, time.size))
    value, slope = rng.standard_normal((2, tau.size))
    found[:, 0] = value
    for k, gap in enumerate(np.diff(time), start=1):
        x = gap / tau
        decay, sine, cosine = np.exp(-x), np.sin(x), np.cos(x)
        beside = np.sqrt(2.0) * sine
        own = 1.0 - decay**2 * (2.0 + np.sin(2.0 * x) - np.cos(2.0 * x))
        own = np.where(x < 1e-2, 8.0 / 3.0 * x**3 * (1.0 - 1.5 * x), own)
        rest = 1.0 - decay**2 * (2.0 - np.cos(2.0 * x) - np.sin(2.0 * x))
        tilt = decay**2 * 2.0 * np.sqrt(2.0) * sine**2 / np.sqrt(np.maximum(own, _TINY))
        first, second = rng.standard_normal((2, tau.size))
        value, slope = (
            decay * ((cosine + sine) * value + beside * slope) + np.sqrt(own) * first,
            decay * ((cosine - sine) * slope - beside * value)
            + tilt * first
            + np.sqrt(np.maximum(rest - tilt**2, 0.0)) * second,
        )
        found[:, k] = value
    return found


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
    own = np.maximum(places.size**2 - np.sum(features**2, axis=0), 0.0) + made.rough
    for ratio in np.unique(ratios):
        at = ratios == ratio
        mean, root = made.weights(residuals[at], float(ratio))
        draws = mean + scales[rows[at], None] * (rng.standard_normal(mean.shape) @ root)
        noise = rng.standard_normal((len(draws), own.size)) * np.sqrt(own)
        found[rows[at]] = draws @ features + sizes[rows[at], None] * noise
    return found
