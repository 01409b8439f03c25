"""Errors of the rig's encoder and load cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from math import inf

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError

ENCODER_STEP = 0.001
"""Resolution of the paper's encoder, mm."""


@dataclass(frozen=True)
class Noise:
    """Load-cell noise: white plus a stationary Ornstein-Uhlenbeck process.

    cov(s, t) = white^2 [s = t] + correlated^2 e^{-|s - t| / correlation_time}
    """

    # white, correlated: standard deviations, N
    white: float = 0.006
    correlated: float = 0.008
    correlation_time: float = 0.5  # s

    def __post_init__(self) -> None:
        if not (0 <= self.white < inf and 0 <= self.correlated < inf):
            raise InputError(f"a noise's standard deviation must be at least 0, not {self}")
        if not 0 < self.correlation_time < inf:
            raise InputError(f"a noise's correlation time must be above 0, not {self}")

    def draw(self, times: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw one realisation (N) at ascending `times` (s), exact for any spacing."""
        white, kicks = rng.standard_normal((2, times.size))
        return self.white * white + self.correlated * self._walk(times, kicks)

    def _walk(self, times: NDArray[np.float64], kicks: NDArray[np.float64]) -> NDArray[np.float64]:
        """Walk a unit Ornstein-Uhlenbeck process, stationary as its first value is a kick."""
        memory = np.exp(-np.diff(times) / self.correlation_time)
        spread = np.sqrt(-np.expm1(-2 * np.diff(times) / self.correlation_time))
        kicks = np.append(kicks[:1], spread * kicks[1:])
        steps: Iterator[float] = iter(memory.tolist())
        walk = accumulate(kicks.tolist(), lambda x, kick: next(steps) * x + kick)
        return np.fromiter(walk, np.float64, count=times.size)


NOISES = {
    "correlated": Noise(),
    "white": Noise(white=0.01, correlated=0.0),
    "none": Noise(white=0.0, correlated=0.0),
}
"""Kinds of noise by name; the first two have the same total of 0.01 N."""


def encode(displacement: NDArray[np.float64], step: float = ENCODER_STEP) -> NDArray[np.float64]:
    """Return the displacement (mm) as an encoder with resolution `step` (mm) reads it."""
    return np.round(displacement / step) * step + 0.0
