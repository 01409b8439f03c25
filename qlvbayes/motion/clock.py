"""Errors of a record's time stamps."""

from __future__ import annotations

import numpy as np

from qlvbayes.io.arrays import Array

_ALIKE = 0.4  # of their mean: neighbouring intervals that differ by more are not meant to be equal
_CLIPPED = 5.0  # times the median: larger changes are gaps
_DENSE = 3.0  # times the shorter intervals (their quartile): up to these, readings are dense
_EXACT = 1e-6  # of an interval: less is rounding of the computer's
_DECIMALS = range(10)  # digits after the point to which a file may round


def clock_error(time: Array) -> float:
    """Return the sd (s) of each time stamp (n,) of a record; 0 where they are exact."""
    if time.size < 3:
        return 0.0
    gaps = np.diff(time)
    if _on_a_lattice(gaps):
        return 0.0
    mean = 0.5 * (gaps[1:] + gaps[:-1])
    change = np.diff(gaps)
    typical = float(np.median(np.abs(change) / mean))
    if typical > _ALIKE:
        return last_decimal(gaps) / float(np.sqrt(12.0))
    alike = np.abs(change) < max(_ALIKE, _CLIPPED * typical) * mean
    dense = mean < _DENSE * float(np.quantile(gaps, 0.25))
    pairs = (alike & dense)[1:] & (alike & dense)[:-1]
    if not pairs.any():
        return 0.0
    variance = -float(np.mean((change[1:] * change[:-1])[pairs])) / 4.0
    error = np.sqrt(max(variance, 0.0))
    return float(error) if error > _EXACT * float(mean.min()) else 0.0


def _on_a_lattice(gaps: Array) -> bool:
    """Return whether all intervals are multiples of one, or of several last decimals."""
    if _multiples(gaps, float(gaps.min())):
        return True
    step = last_decimal(gaps)
    return step > 0.0 and int(np.gcd.reduce(np.round(gaps / step).astype(np.int64))) > 1


def last_decimal(values: Array) -> float:
    """Return the coarsest of 1, 0.1, ... 1e-9 of which all values are multiples; 0 if none."""
    for decimals in _DECIMALS:
        if _multiples(values, 10.0**-decimals):
            return float(10.0**-decimals)
    return 0.0


def _multiples(values: Array, step: float) -> bool:
    counts = values / step
    return bool(np.all(np.abs(counts - np.round(counts)) < 1e-3))
