"""Medians and intervals as text, to the digits that the interval allows."""

from __future__ import annotations

from math import floor, log10

from qlvbayes.comparison.contrast import Interval

_SMALL = 1e-4


def written(value: Interval) -> tuple[str, str, str]:
    """Median, low and high; the interval's half-width keeps one to two digits."""
    numbers = value.median, value.low, value.high
    half = 0.5 * (value.high - value.low)
    if half <= 0.0 or max(map(abs, numbers)) < _SMALL:
        median, low, high = (f"{x:.3g}" for x in numbers)
        return median, low, high
    decimals = max(0, -floor(log10(half / 2.5)))
    median, low, high = (f"{x:z.{decimals}f}" for x in numbers)
    return median, low, high


def with_interval(value: Interval) -> str:
    """``1.07 [1.04, 1.10]``."""
    median, low, high = written(value)
    return f"{median} [{low}, {high}]"
