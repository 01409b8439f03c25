r"""Noise that decays along a test, as a rheometer's in its first tenths of a second.

Of readings F_k at evenly growing times

.. math:: e_k = F_k - \tfrac16 \left(-F_{k-2} + 4 F_{k-1} + 4 F_{k+1} - F_{k+2}\right)

is the noise alone as long as the force is a cubic of the readings' number; independent noise of sd
sigma gives it the variance 35/18 sigma^2. In windows of readings its median size gives sigma; a sd
that does not rise from window to window is fitted to them (isotonic regression; Barlow et al.
1972). Where it falls by much and beyond doubt, every reading has the sd of the window about it, as
if the testing machine had reported it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import isotonic_regression

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Test
from qlvbayes.motion.phases import Phase

_WINDOW = 20
"""Readings: a sd from their median is known to a quarter."""
_FEWEST = 3
"""Windows in which a fall can be distinguished from a kink."""
_FALLS = 4.0
"""First sd over the last: more than noise that grows with a relaxing force makes of it."""
_DECISIVE = 20.0
"""Log-likelihood by which a falling sd must explain the readings better than one sd."""
_INDEPENDENT = 1.0 / 3.0
"""Share of the e_k that count as independent: neighbours share readings."""
_MARGIN = 3
"""Readings on either side of a change of phase that are no cubic of their number."""
_EVEN = 1.5
"""Ratio of neighbouring sampling intervals, above which a logger has changed its pace."""
_EXACT = 1e-4
"""Of the median force: no reading is known better, however many digits the file has."""
_VARIANCE = 35.0 / 18.0
_MEDIAN = 0.6744897501960817
"""Median size of a standard normal."""


def with_fading_sd(
    tests: Sequence[Test], phases: Sequence[Sequence[Phase]]
) -> tuple[list[Test], tuple[str, ...]]:
    """Return tests with an sd of each reading where the noise decays, and a sentence on each.

    No sd, measured or stated, is less than what rounding makes.
    """
    tests = [
        test if sd is None else replace(test, force_sd=np.maximum(sd, _least(test)))
        for test, sd in ((test, test.force_sd) for test in tests)
    ]
    sds = [None if test.force_sd is not None else _levels(test, cut) for test, cut in
           zip(tests, phases, strict=True)]  # fmt: skip
    fades = [sd is not None and falls(*sd) for sd in sds]
    if not any(fades):
        return list(tests), ()
    rescaled, notices = [], []
    for test, cut, sd, fading in zip(tests, phases, sds, fades, strict=True):
        if sd is None:
            rescaled.append(test)
            continue
        _, level = sd
        every = _of_each(test, cut) if fading else np.full(test.time.size, np.median(level))
        rescaled.append(replace(test, force_sd=every))
        if fading:
            begins, ends = every[0], every[-1]
            until = float(test.time[np.argmax(every < np.sqrt(begins * ends))])
            notices.append(
                f"the noise of test {test.name} dies away: its sd is {begins:.3g} at first and "
                f"{ends:.3g} at the end, most of it before {until:.3g} s; each reading is "
                "weighted by its own sd"
            )
    return rescaled, tuple(notices)


def falls(middle: Array, level: Array) -> bool:
    """Return whether the sds (W,) of windows decrease significantly."""
    if level.size < _FEWEST:
        return False
    own = _falling(level)
    freedom = _INDEPENDENT * _WINDOW
    together = np.sqrt(np.mean(level**2))
    # of normal readings of one sd for all, or of the fitted ones, given the windows' variances
    one = 0.5 * freedom * np.sum(2.0 * np.log(together) + level**2 / together**2)
    each = 0.5 * freedom * np.sum(2.0 * np.log(own) + level**2 / own**2)
    return bool(own[0] > _FALLS * own[-1] and one - each > _DECISIVE)


def _falling(level: Array) -> Array:
    """Return the nearest non-increasing sds, in their logarithms."""
    return np.asarray(np.exp(isotonic_regression(np.log(level), increasing=False).x))


def _levels(test: Test, phases: Sequence[Phase]) -> tuple[Array, Array] | None:
    """Return the middle reading and the sd (N) of each window (W,); None without noise."""
    if test.time.size < _FEWEST * _WINDOW:
        return None
    e, index = _deviations(test, phases)
    count = e.size // _WINDOW
    if count < _FEWEST:
        return None
    size, longer = divmod(e.size, count)
    cut = longer * (size + 1)  # the first windows have one reading more
    level = _by_window(np.median, np.abs(e), cut, size) / _MEDIAN
    middle = _by_window(np.mean, index, cut, size)
    if not np.all(level > 0.0):  # a force that repeats itself, by its digits or its steps
        return None
    return middle, np.maximum(level / np.sqrt(_VARIANCE), _least(test))


def _least(test: Test) -> float:
    """Return the sd (N) below which rounding would decide."""
    return _EXACT * float(np.median(np.abs(test.force)))


def _of_each(test: Test, phases: Sequence[Phase]) -> Array:
    """Return a falling sd (n,) of each reading, from windows about each; steps stay steps."""
    e, index = _deviations(test, phases)
    half = _WINDOW // 2
    whole = slice(half, -half)  # windows beyond the ends would repeat single readings
    size = median_filter(np.abs(e), 2 * half + 1)[whole] / _MEDIAN
    least = np.min(size[size > 0.0], initial=np.inf)  # of a force that repeats itself for a while
    own = _falling(np.maximum(size, least)) / np.sqrt(_VARIANCE)
    sds = np.exp(np.interp(np.arange(test.time.size), index[whole], np.log(own)))
    return np.maximum(sds, _least(test))


def _by_window(what: Callable[..., Any], values: NDArray[Any], cut: int, size: int) -> Array:
    """Return the values (W,) of windows of ``size`` readings, one more up to a cut."""
    parts = values[:cut].reshape(-1, size + 1), values[cut:].reshape(-1, size)
    return np.concatenate([what(part, axis=1) for part in parts])


def _deviations(test: Test, phases: Sequence[Phase]) -> tuple[Array, NDArray[np.intp]]:
    """Return the deviations e_k (n,) and the indices of their readings."""
    force, step = test.force, np.diff(test.time)
    e = force[2:-2] - (-force[:-4] + 4.0 * (force[1:-3] + force[3:-1]) - force[4:]) / 6.0
    ratio = np.maximum(step[1:] / step[:-1], step[:-1] / step[1:])
    even = np.max([ratio[k : ratio.size - 2 + k] for k in range(3)], axis=0) < _EVEN
    index = np.arange(2, force.size - 2)
    changes = np.searchsorted(test.time, [phase.stop for phase in phases[:-1]])
    away = np.all(np.abs(index[:, None] - changes) > _MARGIN, axis=1)
    kept = even & away
    return e[kept], index[kept]
