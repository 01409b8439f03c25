"""Load cells, amplifiers and clocks with errors beyond white and correlated noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.simulate.sensors import Noise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LoadCell:
    r"""Errors of force and clock.

    cov(s, t) = f(s) f(t) {white^2 [s = t] + correlated^2 e^{-r/time}
    + low^2 (1 + r/lag) e^{-r/lag}},

    r = abs(s - t), f = 1 + growth F / peak; the last term is white noise behind two equal low
    passes of time constant lag. Then the reading is rounded to `step`.
    """

    # white, correlated, low: standard deviations, N; time, lag: s
    white: float = 0.0
    correlated: float = 0.0
    time: float = 0.5
    low: float = 0.0
    lag: float = 0.005
    growth: float = 0.0  # of the standard deviations, from no force to the peak
    step: float = 0.0  # step of the analogue-digital converter, N; 0 for none
    jitter: float = 0.0  # standard deviation of the moment at which the force is read, s
    encoder: float = 0.001  # step of the encoder, mm; 0 for none

    def draw(self, times: Array, rng: np.random.Generator) -> Array:
        """Draw errors (N) at ascending times (s) before growth and rounding."""
        both = Noise(self.white, self.correlated, self.time).draw(times, rng)
        return both + self.low * _twice_filtered(np.diff(times) / self.lag, rng)

    def moments(self, times: Array, rng: np.random.Generator) -> Array:
        """Return when the force is really read, s: within 0.4 of a spacing of the stated times."""
        if self.jitter == 0.0 or times.size < 2:
            return times
        most = 0.4 * np.min(np.diff(times))
        late = np.clip(self.jitter * rng.standard_normal(times.size), -most, most)
        return np.clip(times + late, times[0], times[-1])

    def read(self, force: Array, errors: Array, peak: float) -> Array:
        """Return the reading (N) of a true force with the errors drawn."""
        noisy = force + errors * (1.0 + self.growth * np.abs(force) / peak)
        return np.round(noisy / self.step) * self.step if self.step else noisy

    def position(self, displacement: Array) -> Array:
        """Return the encoder's reading, mm."""
        if not self.encoder:
            return displacement
        return np.round(displacement / self.encoder) * self.encoder + 0.0

    def covariance(
        self, times: Array, force: Array, slope: Array, speed: Array, peak: float
    ) -> Array:
        """Return the covariance (n, n), N^2, of readings about the force at the read displacement.

        Rounding counts as white noise of step^2/12; the clock and the encoder count with the
        force's slopes, by time (N/s) and by displacement (slope/speed).
        """
        apart = np.abs(times[:, None] - times)
        stretch = 1.0 + self.growth * np.abs(force) / peak
        memory = self.correlated**2 * np.exp(-apart / self.time)
        memory += self.low**2 * (1.0 + apart / self.lag) * np.exp(-apart / self.lag)
        moving = np.abs(speed) > 1e-3  # mm/s: below, the encoder's error stays what it is
        stiffness = np.where(moving, slope / np.where(moving, speed, 1.0), 0.0)
        white = self.step**2 / 12.0 + (self.jitter * slope) ** 2
        white = white + (self.encoder * stiffness) ** 2 / 12.0
        return memory * np.outer(stretch, stretch) + np.diag((self.white * stretch) ** 2 + white)


def _twice_filtered(steps: Array, rng: np.random.Generator) -> Array:
    """Unit process with covariance (1 + r) e^{-r} at steps r >= 0 after the first value.

    State (x, x'), x'' = -2 x' - x + noise, stationary with unit variances and no correlation.
    """
    kicks = rng.standard_normal((steps.size + 1, 2))
    x, slope = kicks[0].tolist()
    values = [x]
    fade = np.exp(-steps)
    push = [fade * (1 + steps), fade * steps, -fade * steps, fade * (1 - steps)]
    xx = np.maximum(1.0 - push[0] ** 2 - push[1] ** 2, 0.0)
    xs = -push[0] * push[2] - push[1] * push[3]
    ss = np.maximum(1.0 - push[2] ** 2 - push[3] ** 2, 0.0)
    low = np.sqrt(xx)
    cross = np.where(low > 0.0, xs / np.where(low > 0.0, low, 1.0), 0.0)
    rest = np.sqrt(np.maximum(ss - cross**2, 0.0))
    noise = np.column_stack([low * kicks[1:, 0], cross * kicks[1:, 0] + rest * kicks[1:, 1]])
    for a, b, c, d, e, f in zip(*(p.tolist() for p in push), *noise.T.tolist(), strict=True):
        x, slope = a * x + b * slope + e, c * x + d * slope + f
        values.append(x)
    return np.array(values)


def draw_cell(kind: str, peak: float, hold: float, rng: np.random.Generator) -> LoadCell:
    """Draw a load cell of one kind, for a pad with a peak force (N) and a longest hold (s).

    The noise has 0.2 to 0.8 % of the peak in all. ``usual`` is white and correlated; ``white`` is
    white noise alone; ``long_memory`` has a correlation time of a quarter of the longest hold;
    ``exact`` has no error at all, and no encoder step.

    Raises KeyError where there is no such kind.
    """
    size = peak * float(np.exp(rng.uniform(np.log(0.002), np.log(0.008))))
    white, slow = 0.6 * size, 0.8 * size
    time = float(np.exp(rng.uniform(np.log(0.2), np.log(1.5))))
    baseline = {"white": white, "correlated": slow, "time": time}
    kinds: dict[str, dict[str, float]] = {
        "usual": baseline,
        "all_correlated": {"correlated": size, "time": time},
        "low_passed": {"low": size, "lag": rng.uniform(0.002, 0.02), "correlated": 0.3 * size},
        "quantised": baseline | {"step": size * rng.uniform(0.5, 3.0)},
        "growing": baseline | {"growth": rng.uniform(1.0, 4.0)},
        "clock_and_encoder": baseline | {"jitter": 2e-4, "encoder": 0.005},
        "long_memory": {"white": white, "correlated": slow, "time": 0.25 * hold},
        "exact": {"encoder": 0.0},
        "white": {"white": size},
    }
    return LoadCell(**kinds[kind])


CELLS = (
    "usual", "all_correlated", "low_passed", "quantised", "growing", "clock_and_encoder",
    "long_memory", "exact",
)  # fmt: skip
"""Kinds of load cells of the wide population."""
