"""Set up time axes for whole tests: milliseconds and half-minutes, logarithmic and linear."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.phases import MOVING

_DECADES = 10.0  # ratio of highest to lowest rate from which on time is logarithmic too
_EARLIEST = 0.01  # beginning of logarithmic time over the shortest first movement
_POINTS = 60  # samples of a phase that are drawn, evenly spread in time and in its logarithm


def decades(trials: Iterable[Trial]) -> bool:
    """Return whether the loading rates of some tests differ ten times or more."""
    rates = [trial.rate for trial in trials if np.isfinite(trial.rate)]
    return bool(rates) and max(rates) >= _DECADES * min(rates)


def since_contact(trial: Trial, time: np.ndarray) -> np.ndarray:
    """Return the time (s) since the test's first movement began."""
    return time - first_movement(trial)[0]


def first_movement(trial: Trial) -> tuple[float, float]:
    """Return when the first ramp or unload began and ended (s)."""
    phases = trial.phases
    phase = next((p for p in phases if p.kind in MOVING), phases[0])
    return phase.start, phase.stop


def logarithmic(axis: Axes, trials: Iterable[Trial], *, ticks: int = 6) -> None:
    """Make time logarithmic, from a hundredth of the shortest first movement on."""
    spans = [stop - start for start, stop in map(first_movement, trials)]
    axis.set_xscale("log")
    axis.set_xlim(left=_EARLIEST * min(spans))
    axis.xaxis.set_major_locator(LogLocator(numticks=ticks))
    axis.xaxis.set_minor_formatter(NullFormatter())


def shown_samples(trial: Trial) -> np.ndarray:
    """Return rows of a test that draw its curve as well as all of them."""
    time, times = trial.whole.time, []
    for phase in trial.phases:
        length = phase.stop - phase.start
        times += [phase.start + length * np.linspace(0.0, 1.0, _POINTS)]
        times += [phase.start + length * np.geomspace(1e-4, 1.0, _POINTS)]
    rows = np.searchsorted(time, np.concatenate(times))
    return np.unique(np.clip(rows, 0, time.size - 1))
