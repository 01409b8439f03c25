r"""Materials beyond the paper's law: other elastic curves, other relaxation.

Every relaxation is approximated by a sum of Prony modes that the simulator fits by itself, by
non-negative least squares of the closed form on 26 rates even in the logarithm; the largest misfit
is below 1e-3 of g(0) (`tests/validation/test_blind_studies.py`), and the fitted sum is the truth of
the data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import log

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.special import exp1

Array = NDArray[np.float64]

_RATES = np.logspace(-4.5, 6.0, 26)  # 1/s: from hours to far below a sample
_TIMES = np.append(0.0, np.logspace(-6.0, 4.0, 240))  # s
_LEAST = 1e-7  # share below which a mode is left out


def exponential(d: Array, m: float, b: float) -> Array:
    """Return the force m/b (e^{b d} - 1); N/mm, 1/mm."""
    return m / b * np.expm1(b * d)


def hertz(d: Array, k: float) -> Array:
    """Return the force of Hertz: k d^1.5 where d > 0, else 0; N/mm^1.5."""
    return k * np.maximum(d, 0.0) ** 1.5


def polynomial(d: Array, k: float, second: float, third: float) -> Array:
    """Return the cubic force k (d + second d^2 + third d^3); N/mm, 1/mm, 1/mm^2."""
    return k * d * (1.0 + d * (second + third * d))


def toe(d: Array, k: float, b: float, depth: float) -> Array:
    """Return k d up to `depth`, then k depth + k/b (e^{b (d - depth)} - 1); N/mm, 1/mm."""
    beyond = np.maximum(d - depth, 0.0)
    return k * np.minimum(d, depth) + k / b * np.expm1(b * beyond)


def box(t: Array, c: float, short: float, long: float) -> Array:
    """Return Fung's {1 + c [E1(t/long) - E1(t/short)]} / {1 + c ln(long/short)}; in s."""
    whole = c * log(long / short)
    with np.errstate(invalid="ignore"):
        middle = np.where(t > 0.0, exp1(t / long) - exp1(np.maximum(t / short, 1e-300)), whole / c)
    return (1.0 + c * middle) / (1.0 + whole)


def power(t: Array, rest: float, time: float, exponent: float) -> Array:
    """Return rest + (1 - rest) (1 + t/time)^-exponent; s."""
    return rest + (1.0 - rest) * (1.0 + t / time) ** -exponent


def stretched(t: Array, rest: float, time: float, exponent: float) -> Array:
    """Return rest + (1 - rest) e^{-(t/time)^exponent}; s."""
    return rest + (1.0 - rest) * np.exp(-((t / time) ** exponent))


def prony2(t: Array, c1: float, v1: float, c2: float, v2: float) -> Array:
    """Return 1 - c1 (1 - e^{-v1 t}) - c2 (1 - e^{-v2 t}); 1/s."""
    return 1.0 + c1 * np.expm1(-v1 * t) + c2 * np.expm1(-v2 * t)


def prony3(t: Array, c1: float, v1: float, c2: float, v2: float, c3: float, v3: float) -> Array:
    """Return g(t) of three Prony modes."""
    return prony2(t, c1, v1, c2, v2) + c3 * np.expm1(-v3 * t)


ELASTIC: dict[str, Callable[..., Array]] = {
    "exponential": exponential,
    "hertz": hertz,
    "polynomial": polynomial,
    "toe": toe,
}
"""Elastic curves by name."""

RELAXATION: dict[str, Callable[..., Array]] = {
    "prony:2": prony2,
    "prony:3": prony3,
    "power-law": power,
    "fung": box,
    "stretched": stretched,
}
"""Reduced relaxation functions by name, g(0) = 1."""


@dataclass(frozen=True)
class Law:
    """A quasi-linear material with any elastic curve and any relaxation, by their names."""

    # elastic, relaxation: keys of `ELASTIC` and `RELAXATION`
    elastic: str
    # curve, fading: their constants in the order of the functions' arguments
    curve: tuple[float, ...]
    relaxation: str
    fading: tuple[float, ...]

    def force(self, depth: Array) -> Array:
        """Return the force (N) of an infinitely fast test to `depth` (mm)."""
        return ELASTIC[self.elastic](depth, *self.curve)

    def stiffness(self, depth: Array) -> Array:
        """Return its slope (N/mm), by central differences over 2e-6 mm."""
        step = 1e-6
        return (self.force(depth + step) - self.force(depth - step)) / (2.0 * step)

    def fade(self, t: Array) -> Array:
        """Return the reduced relaxation at times t (s)."""
        return RELAXATION[self.relaxation](t, *self.fading)

    @property
    def c(self) -> tuple[float, ...]:
        """Shares (c0, c1, ...) of the Prony sum that approximates the relaxation."""
        return self._spectrum[0]

    @property
    def v(self) -> tuple[float, ...]:
        """Its rates (v1, ...), 1/s."""
        return self._spectrum[1]

    @cached_property
    def _spectrum(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        if self.relaxation.startswith("prony"):
            shares, rates = self.fading[::2], self.fading[1::2]
            return (1.0 - sum(shares), *shares), rates
        return _fitted(self.relaxation, self.fading)

    @property
    def constants(self) -> tuple[float, ...]:
        """Return all constants, those of the elastic curve first."""
        return (*self.curve, *self.fading)

    def with_constants(self, constants: tuple[float, ...]) -> Law:
        """Return the same law with other constants."""
        cut = len(self.curve)
        return Law(self.elastic, constants[:cut], self.relaxation, constants[cut:])


@lru_cache(maxsize=64)
def _fitted(name: str, fading: tuple[float, ...]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the shares and rates of the Prony sum, fastest first; shares sum to 1."""
    matrix = np.column_stack([np.ones_like(_TIMES), np.exp(-np.outer(_TIMES, _RATES))])
    weights, _ = nnls(matrix, RELAXATION[name](_TIMES, *fading))
    weights /= weights.sum()
    kept = np.flatnonzero(weights[1:] > _LEAST)[::-1]
    shares = weights[1:][kept]
    return (float(1.0 - shares.sum()), *shares.tolist()), tuple(_RATES[kept].tolist())


def draw_law(elastic: str, relaxation: str, rng: np.random.Generator, depth: float) -> Law:
    """Draw constants that give a peak elastic force of 0.6 to 3 N at `depth` (mm).

    Growth, toe and the terms of the polynomial are such that the stiffness rises by a factor of 1.5
    to 8 over the depth; times and shares are around those of the paper's pads.
    """
    curve = _curve(elastic, rng, depth)
    peak = float(ELASTIC[elastic](np.array([depth]), *curve)[0])
    size = log_uniform(rng, 0.6, 3.0) / peak
    return Law(elastic, (curve[0] * size, *curve[1:]), relaxation, _fading(relaxation, rng))


def _curve(elastic: str, rng: np.random.Generator, depth: float) -> tuple[float, ...]:
    growth = log_uniform(rng, 0.5, 2.0) / depth
    return {
        "exponential": (1.0, growth),
        "hertz": (1.0,),
        "polynomial": (1.0, rng.uniform(0.1, 0.8) / depth, rng.uniform(0.2, 1.0) / depth**2),
        "toe": (1.0, 2.0 * growth, rng.uniform(0.15, 0.4) * depth),
    }[elastic]


def _fading(relaxation: str, rng: np.random.Generator) -> tuple[float, ...]:
    fast, slow = log_uniform(rng, 4.0, 15.0), log_uniform(rng, 0.05, 0.3)
    shares = rng.uniform(0.55, 0.85) * rng.dirichlet([4.0, 2.0, 2.0])
    rest = rng.uniform(0.1, 0.4)
    return {
        "prony:2": (float(shares[0]), fast, float(shares[1] + shares[2]) / 2.0, slow),
        "prony:3": (
            float(shares[0]), fast, float(shares[1]), (fast * slow) ** 0.5, float(shares[2]), slow,
        ),
        "power-law": (rest, log_uniform(rng, 0.01, 0.1), rng.uniform(0.15, 0.4)),
        "fung": (
            log_uniform(rng, 0.1, 0.6),
            log_uniform(rng, 0.005, 0.05),
            log_uniform(rng, 10.0, 300.0),
        ),
        "stretched": (rest, log_uniform(rng, 0.1, 2.0), rng.uniform(0.4, 0.7)),
    }[relaxation]  # fmt: skip


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a log-uniform number between two bounds."""
    return float(np.exp(rng.uniform(log(low), log(high))))
