"""Depth, speeds and frequencies of a comparison, which both pads' tests cover."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from qlvbayes.comparison.contrast import ReadAt
from qlvbayes.io.checks import InputError
from qlvbayes.motion.facts import Covered

_ROUND = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
_UNKNOWN = Covered(depth=1.0, slowest=0.1, fastest=10.0, quickest=0.1, hold=30.0, tests=0)
_STEP = 0.1  # of the hold: a ramp that takes less is over when the hold is
_NEAR = 1.05  # of a range, that still counts as inside it


@dataclass(frozen=True)
class ReadingSettings:
    """Values at which quantities are read, as in `ReadAt`, and the tests' ranges, if known."""

    depth: float
    rates: tuple[float, ...]
    frequencies: tuple[float, ...]
    hold: float
    reach: Covered
    known: bool

    @property
    def after(self) -> float:
        """Round time (s) within which every pad was held."""
        return _round_below(self.hold)

    @property
    def relaxes_further(self) -> bool:
        """True if a step and the whole hold leave another force than the fastest ramp and `after`.

        One number would be told twice where both times are one and the ramp is a step beside them.
        """
        ramp = self.depth / max(self.rates)
        return self.hold > self.after or ramp > _STEP * self.hold

    @property
    def deeper(self) -> bool:
        """True if the depth is beyond a pad's tests."""
        return self.known and self.depth > _NEAR * self.reach.depth

    def outside_rates(self, rate: float) -> bool:
        """Return whether a speed is beyond a pad's tests."""
        reach = self.reach
        return self.known and not reach.slowest / _NEAR <= rate <= _NEAR * reach.fastest

    def outside_frequencies(self, frequency: float) -> bool:
        """Return whether a frequency is beyond a pad's tests."""
        low, high = _band(self.reach)
        return self.known and not low / _NEAR <= frequency <= _NEAR * high

    @property
    def as_record(self) -> ReadAt:
        """The settings as the comparison's record stores them."""
        return ReadAt(self.depth, self.rates, self.frequencies, self.hold)


def choose(
    reaches: Sequence[Covered | None],
    depth: float | None = None,
    rates: Sequence[float] | None = None,
    frequencies: Sequence[float] | None = None,
) -> ReadingSettings:
    """Return what was asked for, else a depth, three speeds and frequencies inside all tests."""
    known = [reach for reach in reaches if reach is not None]
    reach = _common(known) if known else _UNKNOWN
    for what, values in (("depth", [depth]), ("rate", rates), ("frequency", frequencies)):
        for number in values or ():
            if number is not None and not (math.isfinite(number) and number > 0.0):
                raise InputError(f"{what} {number:g} is not above 0", remedy="give a positive one")
    return ReadingSettings(
        depth=_round_below(reach.depth) if depth is None else float(depth),
        rates=tuple(map(float, rates or _spread(reach.slowest, reach.fastest))),
        frequencies=tuple(map(float, frequencies or _series(*_band(reach)))),
        hold=float(f"{reach.hold:.2g}"),
        reach=reach,
        known=bool(known),
    )


def _common(reaches: Sequence[Covered]) -> Covered:
    """Return the ranges that all of them cover."""
    return Covered(
        depth=min(reach.depth for reach in reaches),
        slowest=max(reach.slowest for reach in reaches),
        fastest=min(reach.fastest for reach in reaches),
        quickest=max(reach.quickest for reach in reaches),
        hold=min(reach.hold for reach in reaches),
        tests=min(reach.tests for reach in reaches),
    )


def _band(reach: Covered) -> tuple[float, float]:
    return 1.0 / reach.hold, 0.25 / reach.quickest


def _round_below(value: float) -> float:
    """Return the largest round number that is not above ``value``."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(r * power for r in _ROUND if r * power <= value * (1.0 + 1e-6))


def _series(low: float, high: float) -> list[float]:
    """Return 1, 3, 10, 30, ... inside a range, or its middle if there is none."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = [float(f"{r}e{k}") for k in decades for r in (1, 3)]
    inside = [x for x in steps if low / _NEAR <= x <= high * _NEAR]
    return inside or [float(f"{math.sqrt(low * high):.2g}")]


def _spread(low: float, high: float) -> list[float]:
    """Return slowest, middle and fastest of the series."""
    series = _series(low, high)
    return sorted({series[0], series[len(series) // 2], series[-1]})
