"""A whole test on one axis: milliseconds and half-minutes, in logarithmic and in linear time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.phases import MOVING

_DECADES = 10.0  # highest over lowest rate, from where on time is logarithmic too
_EARLIEST = 0.01  # of the shortest first movement: from there on time is logarithmic
_PLACES = 60  # samples of a phase that are drawn, evenly spread in time and in its logarithm


def decades(trials: Iterable[Trial]) -> bool:
    """Whether the loading rates of some tests differ ten times or more."""
    rates = [trial.rate for trial in trials if np.isfinite(trial.rate)]
    return bool(rates) and max(rates) >= _DECADES * min(rates)


def since_contact(trial: Trial, time: np.ndarray) -> np.ndarray:
    """Time (s) since the test's first movement began."""
    return time - first_movement(trial)[0]


def first_movement(trial: Trial) -> tuple[float, float]:
    """When the first ramp or unload began and ended (s)."""
    phases = trial.phases
    found = next((p for p in phases if p.kind in MOVING), phases[0])
    return found.start, found.stop


def logarithmic(axis: Axes, trials: Iterable[Trial], *, numbers: int = 6) -> None:
    """Logarithmic time, from a hundredth of the shortest first movement on."""
    spans = [stop - start for start, stop in map(first_movement, trials)]
    axis.set_xscale("log")
    axis.set_xlim(left=_EARLIEST * min(spans))
    axis.xaxis.set_major_locator(LogLocator(numticks=numbers))
    axis.xaxis.set_minor_formatter(NullFormatter())


def shown_samples(trial: Trial) -> np.ndarray:
    """Rows of a test that draw its curve as well as all of them."""
    time, places = trial.test.time, []
    for phase in trial.phases:
        length = phase.stop - phase.start
        places += [phase.start + length * np.linspace(0.0, 1.0, _PLACES)]
        places += [phase.start + length * np.geomspace(1e-4, 1.0, _PLACES)]
    rows = np.searchsorted(time, np.concatenate(places))
    return np.unique(np.clip(rows, 0, time.size - 1))
