"""Draws of one quantity of two pads as a contrast."""

from __future__ import annotations

import numpy as np

from qlvbayes.comparison.contrast import DECIDED, EQUAL, SHARE, Contrast, Interval
from qlvbayes.comparison.readings import Reading


def contrast(reading: Reading, first: np.ndarray, second: np.ndarray, region: float) -> Contrast:
    """Set draws (n,) of the first against draws (n,) of the second, independent of each other."""
    positive = bool(np.min(first) > 0.0 and np.min(second) > 0.0)
    direction = float(np.mean(first > second) + 0.5 * np.mean(first == second))
    equivalence = float(np.mean(alike(first, second, region)))
    return Contrast(
        quantity=reading.quantity,
        first=interval(first),
        second=interval(second),
        unit=reading.unit,
        difference=interval(first - second),
        ratio=interval(first / second) if positive else None,
        direction=direction,
        equivalence=equivalence,
        answer=answer(direction, equivalence),
        group=reading.group,
        extrapolated=reading.extrapolated,
    )


def interval(draws: np.ndarray) -> Interval:
    """Median and central 90 %."""
    tail = 0.5 * (1.0 - SHARE)
    low, median, high = np.quantile(draws, [tail, 0.5, 1.0 - tail])
    return Interval(float(median), float(low), float(high))


def alike(first: np.ndarray, second: np.ndarray, region: float) -> np.ndarray:
    """Whether the ratio lies within 1/(1 + region) .. 1 + region; two zeros are alike."""
    larger = np.maximum(np.abs(first), np.abs(second))
    return np.abs(first - second) <= larger * (region / (1.0 + region))


def answer(direction: float, equivalence: float) -> str:
    """Equal before different: what differs within the region is practically equal."""
    if equivalence >= EQUAL:
        return "equal"
    if direction >= DECIDED:
        return "greater"
    return "less" if direction <= 1.0 - DECIDED else "cannot tell"
