"""Measurement of the load cell's noise at rest, without a model of the material."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import Bounds, minimize

from qlvbayes.io.wording import plain
from qlvbayes.motion.badreadings import outlying
from qlvbayes.motion.noisefloor.cycles import find_cycles
from qlvbayes.motion.noisefloor.dwells import (
    Dwell,
    MeasuredTest,
    Readings,
    find_dwells,
    find_strokes,
)
from qlvbayes.motion.noisefloor.floor import Dwells, NoiseFloor, prior_log_tau
from qlvbayes.motion.noisefloor.pool import Pool
from qlvbayes.motion.phases import Phase
from qlvbayes.motion.sensor import encoder_step, sensor_noise

_TREND_RATIOS = (2.0, 1.4)  # between neighbouring relaxation times of the trend
_QUIET = 1e-3  # of the force range: below, the coarser trend would leave more than the noise
_TAUS = 5
_RATIOS = np.arange(-6.0, 10.0, 3.5)  # log of correlated over white variance
_LEAST_RATIO = -9.0
_MOST_RATIO = 9.2  # white sd 1 % of the correlated one: no model of the latter is any better
_LONGEST = 0.5  # of the median dwell: a longer memory cannot be distinguished from the trend
_DECISIVE = 2.0  # log-likelihood by which correlated noise must win
_GROWTHS = np.array([0.3, 1.0, 3.0, 10.0, 30.0])  # growth over the peak force, that is tried
_NEUTRAL = 0.1  # of a dwell: memory where none is seen
_GROWS = 4.0  # log-likelihood by which noise that grows with the force must win
_STEP_SAMPLES = 20_000  # readings that show the step of a digitised force
_LEAST_STEP = 1e-4  # of the largest force: a smaller step is the file's last digit
EXACT = 3e-4  # of the peak force: the motion between the readings is not known any better,
_ROUNDED = 1.0 / np.sqrt(12.0)  # of an encoder step: sd of the displacement's rounding
_WEIGHTED = (
    "the readings are not equally good: each has an sd, by which the fit and the errors over "
    "several phases are weighted"
)
_OF_CYCLES = (
    "no hold or recovery shows the noise: it is what does not repeat from one cycle to the next"
)
_TINY = float(np.finfo(np.float64).tiny) ** 0.5


def measure(
    tests: Sequence[MeasuredTest],
    phases: Sequence[Sequence[Phase]],
    *,
    of_a_step: float = 0.0,
    read: Sequence[MeasuredTest] | None = None,
) -> NoiseFloor:
    """Return the noise seen in the holds and recoveries of the tests, pooled.

    of_a_step: change of the force (N) for one step of the encoder; read: the tests with the force
    as it was read, where that of ``tests`` has the errors of the displacement too.
    """
    tests = [_without_outliers(test) for test in tests]
    peak = max((float(np.abs(t.force).max()) for t in tests if t.force.size), default=0.0)
    step = _force_step(read or tests)
    dwells = find_dwells(tests, phases, step)
    weighted = any(test.force_sd is not None for test in tests)
    known = 0.0 if weighted else peak
    if dwells:
        floor = _pooled(dwells, known)
    elif cycles := find_cycles(tests, phases):
        floor = replace(_pooled(cycles, known), notices=(_OF_CYCLES,))
    else:
        floor = _without_dwells(tests, phases, known)
    if weighted:
        floor = replace(floor, weighted_by_sds=True, notices=(*floor.notices, _WEIGHTED))
    return _at_least(floor, step, float(np.hypot(EXACT * peak, _ROUNDED * of_a_step)))


def _without_outliers(test: MeasuredTest) -> MeasuredTest:
    outliers = outlying(test.time, test.force)
    if not outliers.any():
        return test
    sound, sd = ~outliers, test.force_sd
    return Readings(
        test.time[sound],
        test.displacement[sound],
        test.force[sound],
        None if sd is None else sd[sound],
    )


def _force_step(tests: Sequence[MeasuredTest]) -> float:
    """Return the step of the digitised force; 0 if there is none or only the file's last digit."""
    steps = [encoder_step(t.force[:_STEP_SAMPLES]) for t in tests if t.force.size > 2]
    # of a force that is held the range is rounding, and the largest one counts
    size = max((float(np.abs(t.force).max()) for t in tests if t.force.size), default=0.0)
    step = min(steps, default=0.0)
    return step if step > _LEAST_STEP * size else 0.0


def _without_dwells(
    tests: Sequence[MeasuredTest], phases: Sequence[Sequence[Phase]], peak: float
) -> NoiseFloor:
    """Measure the noise about smooth curves of strokes, with a prior where these leave it open."""
    length = max((float(np.ptp(t.time)) for t in tests if t.time.size), default=0.0) or 1.0
    strokes = find_strokes(tests, phases)
    if strokes:
        floor = _pooled(strokes, peak, length)
        about = "it is measured about smooth curves of single strokes"
    else:
        scatters = [sensor_noise(t.time, t.force) for t in tests]
        # one load cell reads all tests: one fast against its readings shows more than noise
        white = min((noise for noise in scatters if noise > 0.0), default=0.0)
        floor = NoiseFloor(white, 0.0, float(np.exp(prior_log_tau(length))))
        about = "its white part comes from neighbouring readings"
    if floor.ou == 0.0:
        floor = replace(floor, ou=floor.white, dwells=None)
        about += ", and correlated noise of the same size is taken to be there"
    notice = (
        f"no hold or recovery shows the noise: {about}; a systematic error that looks like "
        "correlated noise cannot be distinguished from it (not testable)"
    )
    return replace(floor, testable=False, notices=(notice,))


def _at_least(floor: NoiseFloor, step: float, least: float) -> NoiseFloor:
    """Count the variance of rounding to a step, and no less than the motion makes."""
    notices = floor.notices
    if step > 0.0:
        notices = (*notices, f"the force is digitised in steps of {plain(step)}, counted as noise")
    floor = replace(floor, white=max(floor.white, _TINY), step=step, notices=notices).rounded()
    if floor.total >= least:
        return floor
    notice = (
        f"next to no noise is seen ({plain(floor.total, 2)}): a noise floor of "
        f"{plain(least, 2)} is used, "
        "because the motion between the readings is not known better than that"
    )
    return replace(
        floor, white=least / np.sqrt(2.0), ou=least / np.sqrt(2.0), growth=0.0,
        dwells=None, notices=(*notices, notice),
    )  # fmt: skip


def _pooled(dwells: list[Dwell], peak: float, length: float = 0.0) -> NoiseFloor:
    """Return white sd, correlated sd, its time and the growth, by restricted maximum likelihood."""
    pool = _pool(dwells)
    lengths = [float(np.ptp(r.time)) for r in dwells]
    # a memory that less than half of the dwells are long enough to show may be one's relaxation
    typical = float(np.median(lengths))
    neutral, memory = _NEUTRAL * typical, _LONGEST * typical
    if length > 0.0:  # strokes: the prior's median is the longest memory that they show
        typical, neutral = length, float(np.exp(prior_log_tau(length)))
        memory = neutral
    if not np.any(pool.y):
        return NoiseFloor(0.0, 0.0, neutral)
    posterior = _fitted(pool, memory, typical)
    growth, level = 0.0, float(np.mean(np.abs(pool.force)))
    if peak > 0.0 and (grown := _growth(posterior, peak, level)) is not None:
        growth, scaled = grown
        posterior = _fitted(scaled, memory, typical)
    pool = posterior.pool
    alone, variance = pool.of_white()
    if posterior.best - alone < _DECISIVE:
        white = float(np.sqrt(variance))
        return NoiseFloor(white, 0.0, neutral, growth, level, dwells=posterior)
    white = float(np.sqrt(pool.likelihood(posterior.ratio, posterior.tau)[1]))
    ou, tau = white * float(np.exp(0.5 * posterior.ratio)), float(np.exp(posterior.tau))
    return NoiseFloor(white, ou, tau, growth, level, dwells=posterior)


def _pool(dwells: list[Dwell]) -> Pool:
    """Return the pooled dwells, with the finer trend if the coarser one leaves more than noise."""
    span = max(float(np.ptp(r.force)) for r in dwells)
    for ratio in _TREND_RATIOS:
        pool = Pool.from_dwells(dwells, ratio)
        averaged = pool.y[pool.count == pool.count.max()]
        if np.sqrt(np.mean(averaged**2)) > _QUIET * span:
            break
    return pool


def _fitted(pool: Pool, memory: float, typical: float) -> Dwells:
    """Return the posterior at its mode, over the log ratio of variances and the log time."""
    gaps = pool.gaps[np.isfinite(pool.gaps)]
    shortest = 3.0 * float(np.quantile(gaps, 0.1))
    taus = np.log([shortest, max(memory, 2.0 * shortest)])
    bounds = np.array([[_LEAST_RATIO, taus[0]], [_MOST_RATIO, taus[1]]])
    posterior = Dwells(pool, 0.0, 0.0, 0.0, bounds, prior_log_tau(typical), correlated=False)
    starts = [(r, t) for t in np.linspace(float(taus[0]), float(taus[1]), _TAUS) for r in _RATIOS]
    start = min(starts, key=lambda at: posterior.loss(np.array(at)))
    best = minimize(
        posterior.loss, np.array(start), method="L-BFGS-B", bounds=Bounds(*bounds),
        options={"maxiter": 15, "ftol": 1e-6},
    )  # fmt: skip
    ratio, tau = map(float, best.x)
    gain = pool.likelihood(ratio, tau)[0]
    sure = gain - pool.of_white()[0] > 3.0 * _DECISIVE
    return replace(posterior, best=gain, ratio=ratio, tau=tau, correlated=sure)


def _growth(posterior: Dwells, peak: float, level: float) -> tuple[float, Pool] | None:
    """Return the growth (1/force) of the sd with force, and the dwells divided by it; else None."""
    best = None
    least = posterior.best + _GROWS
    for growth in _GROWTHS / peak:
        scale = (1.0 + growth * np.abs(posterior.pool.force)) / (1.0 + growth * level)
        scaled = posterior.pool.scaled(scale)
        gain = scaled.likelihood(posterior.ratio, posterior.tau)[0]
        if gain > least:
            least, best = gain, (float(growth), scaled)
    return best
