"""The noise floor and its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from qlvbayes.io.arrays import Array
from qlvbayes.motion.noisefloor.posterior import Dwells, NoiseConstants

_SPREAD = 40  # draws that show the spread
_KEPT = 0.95  # probability of the floors that are averaged
_MOST = 5.0  # a wider prior would say nothing


@dataclass(frozen=True)
class NoiseFloor:
    r"""White noise of sd ``white`` plus a correlated process of sd ``ou``, both times s(F).

    cov(t, t') = s(F) s(F') {white^2 [t = t'] + ou^2 rho(|t - t'|/tau)}, rho(x) = e^{-x} (an
    Ornstein-Uhlenbeck process), or e^{-x} (cos x + sin x) where ``smooth``
    (white noise through a second-order low-pass, Butterworth's, of cut-off 2^{1/2}/tau);
    s(F) = (1 + growth |F|)/(1 + growth level).

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
    smooth: bool = False
    weighted_by_sds: bool = False
    testable: bool = True
    notices: tuple[str, ...] = ()
    dwells: Dwells | None = field(default=None, repr=False, compare=False)

    @property
    def total(self) -> float:
        """Sd of a single reading."""
        return float(np.hypot(self.white, self.ou))

    @property
    def memory(self) -> float:
        """Correlation time (s) of the Ornstein-Uhlenbeck process with the same slow part."""
        return self.tau

    @property
    def is_sure(self) -> bool:
        """True if the dwells determine the kind of noise."""
        return self.dwells is None or self.dwells.is_sure

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
        if self.dwells is None:
            return [self] * count
        return [self._like(one) for one in self.dwells.draw(count)]

    def weighted(self, count: int) -> tuple[list[NoiseFloor], Array]:
        """Return noise floors with weights (count,) of sum 1; see ``draws``."""
        if self.dwells is None:
            return [self], np.ones(1)
        draws, weights = self.dwells.weighted(count)
        return [self._like(one) for one in draws], weights

    def likely(self) -> tuple[list[NoiseFloor], Array]:
        """Return floors with weights of sum 1, without the twentieth with the most slow noise."""
        if self.weighted_by_sds:
            return [self], np.ones(1)
        floors, weights = self.weighted(_SPREAD)
        order = np.argsort([one.ou**2 * one.tau for one in floors])
        below = np.minimum(np.cumsum(weights[order]), _KEPT)
        kept = np.diff(below, prepend=0.0) / _KEPT
        return [floors[k] for k in order], kept

    def expected(self) -> NoiseFloor:
        """Return the floor whose variances are the means over those of ``likely``."""
        floors, weights = self.likely()
        white, ou, tau = np.array([(one.white**2, one.ou**2, one.tau) for one in floors]).T
        correlated = float(weights @ ou)
        memory = float(weights @ (ou * tau)) / correlated if correlated > 0.0 else self.tau
        return replace(
            self, white=float(np.sqrt(weights @ white)), ou=float(np.sqrt(correlated)), tau=memory,
            dwells=None,
        )  # fmt: skip

    def rounded(self) -> NoiseFloor:
        """Return the floor with at least the variance that rounding to ``step`` makes."""
        least = np.sqrt(max(self.step**2 / 12.0 - self.ou**2, 0.0))
        return replace(self, white=max(self.white, float(least)))

    def _like(self, noise: NoiseConstants) -> NoiseFloor:
        return replace(self, **noise._asdict()).rounded()
