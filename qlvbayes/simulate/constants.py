"""Constants of the pads: the paper's Table 1, and random ones like them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import exp, inf, log

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError


@dataclass(frozen=True)
class Constants:
    """Constants of the quasi-linear law with any number of Prony modes.

    Elastic force m/b (e^{b d} - 1), reduced relaxation g(t) = c0 + sum c_i e^{-v_i t}, g(0) = 1.
    """

    m: float  # stiffness at zero displacement, N/mm
    b: float  # growth of stiffness, 1/mm
    # (c0, c1, ..., cr), shares of the force, sum 1; c0 is the share that never relaxes
    c: tuple[float, ...]
    v: tuple[float, ...] = ()  # (v1, ..., vr), relaxation rates, 1/s

    def __post_init__(self) -> None:
        if not all(0 < x < inf for x in (self.m, self.b, *self.v)):
            raise InputError(f"m, b and every rate v must be above 0, not {self}")
        if len(self.c) != len(self.v) + 1:
            raise InputError(f"{len(self.v)} rates need {len(self.v) + 1} shares c, not {self}")
        if not all(x >= 0 for x in self.c) or abs(sum(self.c) - 1.0) > 1e-9:
            raise InputError(f"the shares c must be at least 0 and sum to 1, not {self.c}")

    def force(self, depth: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force (N) of an infinitely fast test to `depth` (mm): m/b (e^{b d} - 1)."""
        return self.m / self.b * np.expm1(self.b * depth)

    def stiffness(self, depth: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the slope of the elastic force (N/mm): m e^{b d}."""
        return self.m * np.exp(self.b * depth)


TABLE_1 = {
    "A": Constants(0.518, 0.577, (0.3076, 0.6200, 0.0724), (6.235, 0.175)),
    "B": Constants(0.340, 1.165, (0.2955, 0.6300, 0.0745), (6.215, 0.140)),
    "C": Constants(0.975, 0.519, (0.3290, 0.6300, 0.0410), (6.215, 0.140)),
}
"""Pads of the paper: A sealed without fluid, B lubricant oil, C glycerin."""


SPECIMENS = TABLE_1 | {
    "homogeneous": Constants(1.1, 0.35, (0.50, 0.30, 0.20), (2.5, 0.08)),
    "finger": Constants(0.25, 2.0, (0.35, 0.35, 0.30), (14.0, 0.7)),
}
"""Pads of the paper, and two other specimens.

homogeneous: a pad of one solid, stiffer and with less to relax; made up. finger: stiffness of 1 to
6 N/mm under 0.4 to 3 N, relaxation times of 70 ms and 1.4 s as Pawluk & Howe 1999
(doi:10.1115/1.2835100) measured in vivo, with one of 4 ms for which this rig is too slow; the
shares are made up.
"""

_STIFFNESS_SPREAD, _RATE_SPREAD = 0.2, 0.15  # sds of the logarithms between specimens of a kind
_SHARES_ALIKE = 300.0  # Dirichlet concentration of their shares: sds of about 0.03


def specimens_of(
    words: Iterable[str], rng: np.random.Generator
) -> tuple[dict[str, Constants], dict[str, str]]:
    """Return constants by name, and the kind of each specimen of several."""
    specimens: dict[str, Constants] = {}
    kinds: dict[str, str] = {}
    for word in words:
        kind, several, number = word.partition(":")
        if kind not in SPECIMENS or (several and not (number.isdecimal() and int(number) > 0)):
            raise InputError(
                f"no pad '{word}'", remedy=f"choose of {', '.join(SPECIMENS)}, or as finger:4"
            )
        if not several:
            specimens[kind] = SPECIMENS[kind]
            continue
        for k in range(1, int(number) + 1):
            specimens[f"{kind}-{k}"], kinds[f"{kind}-{k}"] = _another(SPECIMENS[kind], rng), kind
    return specimens, kinds


def _another(kind: Constants, rng: np.random.Generator) -> Constants:
    """Draw a specimen like others of its kind."""
    m, b = np.array([kind.m, kind.b]) * np.exp(_STIFFNESS_SPREAD * rng.standard_normal(2))
    v = np.array(kind.v) * np.exp(_RATE_SPREAD * rng.standard_normal(len(kind.v)))
    c = rng.dirichlet(_SHARES_ALIKE * np.array(kind.c))
    return Constants(float(m), float(b), tuple(c.tolist()), tuple(v.tolist()))


def draw_constants(rng: np.random.Generator) -> Constants:
    """Draw random two-mode constants around the paper's pads."""
    c0, c1, c2 = 0.03 + 0.91 * rng.dirichlet([3.0, 5.0, 1.0])
    return Constants(
        m=_log_uniform(rng, 0.2, 1.2),
        b=_log_uniform(rng, 0.3, 1.5),
        c=(float(c0), float(c1), float(c2)),
        v=(_log_uniform(rng, 2.0, 15.0), _log_uniform(rng, 0.05, 0.5)),
    )


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return exp(rng.uniform(log(low), log(high)))
