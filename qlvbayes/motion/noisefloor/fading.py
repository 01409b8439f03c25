r"""Noise that decays along a test, as a rheometer's in its first tenths of a second.

Of readings F_k at evenly growing times

.. math:: e_k = F_k - \tfrac16 \left(-F_{k-2} + 4 F_{k-1} + 4 F_{k+1} - F_{k+2}\right)

is the noise alone as long as the force is a cubic of the readings' number; independent noise of sd
sigma gives it the variance 35/18 sigma^2. In windows of readings its median size gives sigma; a sd
that does not rise is fitted to them (isotonic regression; Barlow et al. 1972). Where it falls by
much and beyond doubt, every reading has the sd of the window about it, as if the testing machine
had reported it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import isotonic_regression

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Test
from qlvbayes.motion.phases import Phase

_WINDOW = 20  # readings: a sd from their median is known to a quarter
_FALLS = 4.0  # first sd over the last: more than noise that grows with a relaxing force makes of it
_DECISIVE = 20.0  # log-likelihood by which a falling sd must explain the readings better than one
_INDEPENDENT = 1.0 / 3.0  # share of the e_k that count as independent: neighbours share readings
_MARGIN = 3  # readings on either side of a change of phase that are no cubic of their number
_EVEN = 1.5  # ratio of neighbouring intervals, above which a logger has changed its pace
_EXACT = 1e-4  # of the median force: no reading is known better, however many digits the file has
_SD = 0.6744897501960817 * float(np.sqrt(35.0 / 18.0))  # median size of an e_k over sigma


def with_fading_sd(
    tests: Sequence[Test], phases: Sequence[Sequence[Phase]]
) -> tuple[list[Test], tuple[str, ...]]:
    """Return tests with an sd of each reading where the noise decays, and a sentence on each.

    No sd, measured or stated, is less than what rounding makes. Where one test's noise decays, the
    others of the pad have one sd each.
    """
    found = [_sds(test, cut) for test, cut in zip(tests, phases, strict=True)]
    any_fades = any(fades for _, fades in found)
    rescaled, notices = [], []
    for test, (sds, fades) in zip(tests, found, strict=True):
        least = _EXACT * float(np.median(np.abs(test.force)))
        if sds is None or (test.force_sd is None and not any_fades):
            rescaled.append(test)
            continue
        sds = np.maximum(sds, least)
        rescaled.append(replace(test, force_sd=sds))
        if fades:
            until = float(test.time[np.argmax(sds < np.sqrt(sds[0] * sds[-1]))])
            notices.append(
                f"the noise of test {test.name} dies away: its sd is {sds[0]:.3g} at first and "
                f"{sds[-1]:.3g} at the end, most of it before {until:.3g} s; each reading is "
                "weighted by its own sd"
            )
    return rescaled, tuple(notices)


def _sds(test: Test, phases: Sequence[Phase]) -> tuple[Array | None, bool]:
    """Return an sd (n,) of each reading, where it is stated or shows, and whether it fades."""
    if test.force_sd is not None:
        return test.force_sd, False
    size, index = _deviations(test, phases)
    parts = np.array_split(size, size.size // _WINDOW) if size.size >= 3 * _WINDOW else []
    level = np.array([np.median(part) for part in parts]) / _SD
    if level.size == 0 or not np.all(level > 0.0):  # a force repeats by its digits or its steps
        return None, False
    level = np.maximum(level, _EXACT * float(np.median(np.abs(test.force))))
    own, together = _falling(level), np.sqrt(np.mean(level**2))
    # log-likelihood of normal readings of the fitted sds, over that of one sd for all
    gain = np.log(together / own) + 0.5 * level**2 * (together**-2.0 - own**-2.0)
    decisive = _INDEPENDENT * _WINDOW * float(np.sum(gain)) > _DECISIVE
    if not (own[0] > _FALLS * own[-1] and decisive):
        return np.full(test.time.size, np.median(level)), False
    half = _WINDOW // 2
    whole = slice(half, -half)  # windows beyond the ends would repeat single readings
    about = median_filter(size, 2 * half + 1)[whole] / _SD
    about = np.maximum(about, np.min(about[about > 0.0], initial=np.inf))
    every = np.interp(np.arange(test.time.size), index[whole], np.log(_falling(about)))
    return np.exp(every), True


def _falling(level: Array) -> Array:
    """Return the nearest non-increasing sds, in their logarithms."""
    return np.asarray(np.exp(isotonic_regression(np.log(level), increasing=False).x))


def _deviations(test: Test, phases: Sequence[Phase]) -> tuple[Array, NDArray[np.intp]]:
    """Return the sizes of the deviations e_k (n,) and the indices of their readings."""
    force, step = test.force, np.diff(test.time)
    if force.size < 3 * _WINDOW:
        return np.zeros(0), np.zeros(0, dtype=np.intp)
    e = force[2:-2] - (-force[:-4] + 4.0 * (force[1:-3] + force[3:-1]) - force[4:]) / 6.0
    ratio = np.maximum(step[1:] / step[:-1], step[:-1] / step[1:])
    even = np.max([ratio[k : ratio.size - 2 + k] for k in range(3)], axis=0) < _EVEN
    index = np.arange(2, force.size - 2)
    changes = np.searchsorted(test.time, [phase.stop for phase in phases[:-1]])
    away = np.all(np.abs(index[:, None] - changes) > _MARGIN, axis=1)
    return np.abs(e[even & away]), index[even & away]
