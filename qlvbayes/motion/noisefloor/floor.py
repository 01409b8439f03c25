"""The noise floor and its uncertainty, given the dwells: white sd, correlated sd and its time."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from qlvbayes.io.arrays import Array
from qlvbayes.motion.noisefloor.pool import Pool

_POINTS = 32  # of the importance sample over (log ratio, log tau), about the mode
_PRIOR_POINTS = 64  # the same, from the prior
_HEAVY = 5.0  # degrees of freedom of its Student-t
_STEP = 0.1  # of both numbers, in the curvature's differences
_WIDEST = 2.0  # sd of that t where the dwells say little
_MEDIAN_TAU = 0.05  # of a dwell: a longer memory looks like the trend, so that there is a weak
_TAU_SD = 1.5  # prior, log-normal with this sd (a quarter of a dwell is one away)
_RATIO_SD = 3.0  # prior of the log ratio of variances: sds that differ up to 4.5 times, usually
_SPREAD = 40  # draws that show the spread
_KEPT = 0.95  # probability of the floors that are averaged
_MOST = 5.0  # a wider prior would say nothing
_AVERAGED = 400  # readings at most, evenly chosen, whose correlations are averaged


@dataclass(frozen=True, eq=False)
class Dwells:
    """The pooled dwells, and the noise of highest restricted likelihood."""

    pool: Pool
    best: float
    # ratio, tau: logarithms of the correlated variance over the white one, and of its time
    ratio: float
    tau: float
    bounds: Array  # (2, 2) lowest and highest of both
    prior_log_tau: float  # log of the prior's median time
    # whether the correlated part is beyond doubt (else white noise alone has half the prior
    # probability)
    correlated: bool

    def chosen(self, count: int, power: float = 1.0) -> tuple[Array, Array]:
        """Return noises drawn by a power of their probability, with weights (count,) of sum 1.

        Of each (count, 3) the white sd, the correlated sd and its time, the same at every call. By
        the power 1 they are equally likely; by a smaller one unlikely ones are included.
        """
        # here and below, as it takes longer to load than a first look takes
        from scipy.stats import chi2

        points, variances, weights = self._sample
        drawn, shares = weights**power, (np.arange(count) + 0.5) / count
        chosen = np.searchsorted(np.cumsum(drawn), shares * drawn.sum())
        chosen = np.clip(chosen, 0, weights.size - 1)
        freedom, mixed = self.pool.freedom, np.random.default_rng(0).permutation(count)
        scales = np.sqrt(freedom / chi2.ppf(shares[mixed], freedom))
        white, (ratio, tau) = np.sqrt(variances[chosen]) * scales, points[chosen].T
        left = weights[chosen] ** (1.0 - power)
        draws = np.stack([white, white * np.exp(0.5 * ratio), np.exp(tau)], axis=1)
        return draws, left / left.sum()

    @cached_property
    def _sample(self) -> tuple[Array, Array, Array]:
        """Points (n, 2) of (log ratio, log tau), their white variances and weights (n,).

        Importance sampling from a Student-t at the mode and from the prior together (each weight by
        the density of both; Veach & Guibas 1995): where the dwells say little, nothing near the
        mode reaches what they leave open. -inf for log ratio is white noise alone.
        """
        from scipy.stats import chi2, norm, qmc, truncnorm

        mode, root = np.array([self.ratio, self.tau]), self._spread()
        uniform = np.clip(qmc.Sobol(3, seed=0).random(_POINTS), 1e-4, 1.0 - 1e-4)
        width = np.sqrt(_HEAVY / chi2.ppf(uniform[:, 2:], _HEAVY))
        near = mode + (norm.ppf(uniform[:, :2]) * width) @ root.T
        middle, sds = np.array([0.0, self.prior_log_tau]), np.array([_RATIO_SD, _TAU_SD])
        prior = truncnorm(*((self.bounds - middle) / sds), loc=middle, scale=sds)
        drawn = prior.ppf(qmc.Sobol(2, seed=0).random(_PRIOR_POINTS))
        points = np.concatenate([near, np.clip(drawn, *self.bounds)])
        inside = np.all((points >= self.bounds[0]) & (points <= self.bounds[1]), axis=1)
        points = points[inside]
        z = np.linalg.solve(root, (points - mode).T)
        peak = 2.0 * np.pi * abs(float(np.linalg.det(root)))
        about = (1.0 + np.sum(z**2, axis=0) / _HEAVY) ** (-0.5 * (_HEAVY + 2.0)) / peak
        density = _POINTS * about + _PRIOR_POINTS * prior.pdf(points).prod(axis=1)
        logs, variances = np.array([self.pool.likelihood(*point) for point in points.tolist()]).T
        weights = np.exp(logs - self.best) * norm.pdf(points, middle, sds).prod(axis=1) / density
        if not self.correlated:  # and white noise alone, as likely a priori
            log_white, variance = self.pool.of_white
            points = np.concatenate([points, [[-np.inf, self.prior_log_tau]]])
            variances = np.append(variances, variance)
            weights = np.append(weights, np.exp(log_white - self.best))
        return points, variances, weights / weights.sum()

    def loss(self, at: Array) -> float:
        """Return minus the log posterior at (log ratio, log tau), up to a constant."""
        prior = -0.5 * ((at[1] - self.prior_log_tau) / _TAU_SD) ** 2
        return -self.pool.likelihood(float(at[0]), float(at[1]))[0] - float(prior)

    def _spread(self) -> Array:
        """Square root (2, 2) of the covariance at the mode; wide in directions left open."""
        mode, ranges = np.array([self.ratio, self.tau]), self.bounds[1] - self.bounds[0]
        room = np.minimum(_STEP, 0.5 * ranges)
        mode = np.clip(mode, self.bounds[0] + room, self.bounds[1] - room)
        here = self.loss(mode)
        e = _STEP * np.eye(2)
        up, down = ([self.loss(mode + sign * row) for row in e] for sign in (1.0, -1.0))
        both = self.loss(mode + e[0] + e[1]) + self.loss(mode - e[0] - e[1])
        diagonal = np.array(up) + np.array(down) - 2.0 * here
        cross = 0.5 * (both - 2.0 * here - diagonal.sum())
        curvature = np.array([[diagonal[0], cross], [cross, diagonal[1]]]) / _STEP**2
        curvature += np.diag(12.0 / ranges**2)
        values, vectors = np.linalg.eigh(curvature)
        sds = 1.2 / np.sqrt(np.maximum(values, (1.2 / _WIDEST) ** 2))
        return np.asarray(vectors * sds)


def prior_log_tau(longest: float) -> float:
    """Return the log of the prior's median correlation time for dwells of this length (s)."""
    return float(np.log(_MEDIAN_TAU * longest))


@dataclass(frozen=True)
class NoiseFloor:
    r"""White noise of sd ``white`` plus a correlated process of sd ``ou``, both times s(F).

    cov(t, t') = s(F) s(F') {white^2 [t = t'] + ou^2 e^{-|t - t'|/tau}} (an Ornstein-Uhlenbeck
    process), s(F) = (1 + growth |F|)/(1 + growth level).

    Sds in units of force, at a force of ``level``; ``tau`` in s; ``growth`` in 1/force, 0 where the
    noise does not grow with the force; ``step``: of the digitised force, 0 if none was seen, its
    variance of step^2/12 is in ``white``. ``ou`` is 0 where no correlation is seen; ``tau`` is then
    a neutral tenth of a hold. ``weighted_by_sds``: whether each reading has a measured sd.
    ``testable``: False where no hold shows whether the noise is correlated; ``notices``: what the
    reader must know, in words; ``dwells``: the readings behind it, None where there were none.
    """

    white: float
    ou: float
    tau: float
    growth: float = 0.0
    level: float = 0.0
    step: float = 0.0
    weighted_by_sds: bool = False
    testable: bool = True
    notices: tuple[str, ...] = ()
    dwells: Dwells | None = field(default=None, repr=False, compare=False)

    @property
    def total(self) -> float:
        """Sd of a single reading."""
        return float(np.hypot(self.white, self.ou))

    def sd_of_mean(self, time: Array) -> float:
        """Return the sd of the mean of readings at times (n,) in s."""
        some = time[:: -(-time.size // _AVERAGED)]
        alike = np.mean(np.exp(-np.abs(some[:, None] - some) / self.tau))
        return float(np.sqrt(self.white**2 / time.size + self.ou**2 * alike))

    @property
    def is_sure(self) -> bool:
        """True if the dwells show correlated noise beyond doubt."""
        return self.dwells is None or self.dwells.correlated

    def scale(self, force: ArrayLike) -> Array:
        """Return the sd at a force, of any shape, over the sd at ``level``."""
        size = np.abs(np.asarray(force, dtype=np.float64))
        return np.asarray((1.0 + self.growth * size) / (1.0 + self.growth * self.level))

    def factor(self, name: str) -> float:
        """Return the factor of one sd of uncertainty in ``white`` or ``tau``, at most 5."""
        if self.ou == 0.0:  # its time is nobody's then
            return 1.0
        spread = np.std(np.log([getattr(floor, name) for floor in self.draws(_SPREAD)]))
        return float(np.exp(min(spread, np.log(_MOST))))

    def draws(self, count: int) -> list[NoiseFloor]:
        """Return equally likely noise floors given the dwells (the same at every call)."""
        return [self] * count if self.dwells is None else self.weighted(count, 1.0)[0]

    def weighted(self, count: int, power: float = 0.5) -> tuple[list[NoiseFloor], Array]:
        """Return floors drawn by a power of their probability, with weights (count,) of sum 1."""
        if self.dwells is None:
            return [self], np.ones(1)
        draws, weights = self.dwells.chosen(count, power)
        every = [replace(self, white=sd, ou=ou, tau=tau) for sd, ou, tau in draws.tolist()]
        return [one.rounded() for one in every], weights

    def likely(self) -> tuple[list[NoiseFloor], Array]:
        """Return floors with weights of sum 1, without the twentieth with the most slow noise."""
        if self.weighted_by_sds:
            return [self], np.ones(1)
        floors, weights = self.weighted(_SPREAD)
        order = np.argsort([one.ou**2 * one.tau for one in floors])
        below = np.minimum(np.cumsum(weights[order]), _KEPT)
        return [floors[k] for k in order], np.diff(below, prepend=0.0) / _KEPT

    def as_white(self, sd: float) -> NoiseFloor:
        """Return white noise of one sd (N) alone, of which the dwells leave nothing open."""
        return replace(self, white=sd, ou=0.0, dwells=None)

    def expected(self) -> NoiseFloor:
        """Return the floor whose variances are the means over those of ``likely``."""
        floors, weights = self.likely()
        white, ou, tau = np.array([(one.white**2, one.ou**2, one.tau) for one in floors]).T
        correlated = float(weights @ ou)
        memory = float(weights @ (ou * tau)) / correlated if correlated > 0.0 else self.tau
        sds = float(np.sqrt(weights @ white)), float(np.sqrt(correlated))
        return replace(self, white=sds[0], ou=sds[1], tau=memory, dwells=None)

    def rounded(self) -> NoiseFloor:
        """Return the floor with at least the variance that rounding to ``step`` makes."""
        least = np.sqrt(max(self.step**2 / 12.0 - self.ou**2, 0.0))
        return replace(self, white=max(self.white, float(least)))
