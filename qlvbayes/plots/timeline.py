"""Draw whole tests since the first movement: how pads were pressed, and a few of their rates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import pad_title, rated
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import KINDS, MOVING
from qlvbayes.plots.panels import by_rate, legend_entries, trial_name
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    LINES,
    MARKERS,
    canvas,
    colours,
    displacement_label,
    force_label,
    narrow,
    shortened,
    style,
    titled_legend,
)

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


_PANEL, _FRAME, _LINE = 48.0, 16.0, 3.6  # mm: a panel, the margins, a line of the legend
_SIGNS: dict[str, str] = dict(zip(KINDS, ("^", "s", "v", "o"), strict=True))
_NAME = 16  # characters of a test's name


def plot_programme(experiment: Experiment, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the displacement, as measured, of every test of a pad since its first movement.

    Where the loading rates span a decade there are two panels: logarithmic time, which shows every
    ramp, and linear time. ``experiment`` is the pad's, ``width`` in mm; returns the panels.
    """
    tight, trials = narrow(width), sorted(experiment.trials, key=lambda t: by_rate(t.rate))
    scales = ["log", "linear"] if decades(trials) else ["linear"]
    with style():
        columns = 2 if tight else 4
        lines = -(-(len(trials) + len(_SIGNS)) // columns) + 2
        rows = len(scales) if tight else 1
        height = _FRAME + _PANEL * rows + _LINE * lines
        figure = canvas(width, height)
        shape = (len(scales), 1) if tight else (1, len(scales))
        axes = figure.subplots(*shape, sharey=True, squeeze=False).ravel()
        for axis, scale in zip(axes, scales, strict=True):
            for k, trial in enumerate(trials):
                _draw_programme(axis, trial, trial_name(trial, experiment.units, _NAME), k)
            if scale == "log":
                logarithmic(axis, trials)
            axis.set_xlabel("time since the first movement (s)")
        for axis in axes if tight else axes[:1]:
            units = experiment.units
            axis.set_ylabel(displacement_label(units))
        handles, labels = legend_entries(figure)
        order = sorted(range(len(labels)), key=lambda n: labels[n].endswith(" begins"))
        title = f"{pad_title(shortened(experiment.pad))}: displacement programme"
        entry = [handles[n] for n in order], [labels[n] for n in order]
        titled_legend(figure, title, *entry, ncols=columns)
    return list(axes)


def _draw_programme(axis: Axes, trial: Trial, name: str, k: int) -> None:
    palette = colours()
    look: dict[str, Any] = {"color": palette[k % len(palette)], "linestyle": LINES[k % len(LINES)]}
    rows, way = shown_samples(trial), trial.whole.displacement
    time = since_contact(trial, trial.whole.time[rows])
    axis.plot(time, way[rows], gid=trial.name, label=name, **look)
    open_sign: dict[str, Any] = {"markerfacecolor": "white", "markersize": 3.6, "zorder": 3}
    for kind, sign in _SIGNS.items():
        starts = np.array([phase.start for phase in trial.phases if phase.kind == kind])
        if starts.size:
            axis.plot(
                since_contact(trial, starts), trial.trajectory.displacement(starts), sign, gid=kind,
                color=look["color"], markeredgewidth=0.7, label=f"{kind} begins", **open_sign,
            )  # fmt: skip


RATES = (0.1, 1.0, 30.0)  # mm/s, the paper's Fig. 5
_RATES_PANEL, _RATES_FRAME, _RATES_LINE = (
    46.0,
    12.0,
    4.2,
)  # mm: a panel, the margins, a line of the legend
_TIME = "time since the first movement (s)"
_SAME = 0.02  # relative difference of rates below which pads share a label


def plot_forces_at_rates(
    predictions: Mapping[str, Sequence[Prediction]],
    units: UnitSystem,
    *,
    rates: Sequence[float] | None = None,
    width: float = DOUBLE,
) -> list[Axes]:
    """Draw measured and predicted force of each pad's tests nearest to some loading rates.

    Time since the first movement is logarithmic (upper panels; left in one column) and linear;
    where the rates do not span a decade, linear alone.

    Parameters
    ----------
    predictions, units, width
        The predictions by the pad's name, the units of displacement and force, the width (mm).
    rates
        In the unit of speed, the nearest in the logarithm are drawn; by default 0.1, 1 and 30 mm/s,
        or for specimens in strain the slowest, the middle and the fastest of the first.

    Returns
    -------
    list of Axes
        The panels, pad by pad.
    """
    tight = narrow(width)
    asked = rates or _default_rates(units, next(iter(predictions.values())))
    chosen = {name: _nearest(nearby, asked) for name, nearby in predictions.items()}
    trials = [p.trial for nearby in chosen.values() for p in nearby]
    scales = ["log", "linear"] if decades(trials) else ["linear"]
    every = range(max(map(len, chosen.values())))
    rates_of = [[p[k].trial.rate for p in chosen.values() if len(p) > k] for k in every]
    names = [_rates_text(rates, units.speed) for rates in rates_of]
    with style():
        shape = (len(chosen), len(scales)) if tight else (len(scales), len(chosen))
        lines = 3 if tight else 2
        figure = canvas(width, _RATES_FRAME + _RATES_PANEL * shape[0] + _RATES_LINE * lines)
        axes = figure.subplots(*shape, sharey=True, squeeze=False)
        by_pad = axes if tight else axes.T
        for (name, nearby), row in zip(chosen.items(), by_pad, strict=True):
            row[0].set_title(pad_title(shortened(name, 24)), loc="left", weight="bold")
            for axis, scale in zip(row, scales, strict=True):
                _draw_rates(axis, nearby, names)
                if scale == "log":
                    logarithmic(axis, trials, ticks=3 if tight else 6)
        for axis in axes[:, 0]:
            axis.set_ylabel(force_label(units))
        for axis in axes[-1]:
            axis.set_xlabel("time since the\nfirst movement (s)" if tight else _TIME)
        title, most = "marks: measured; lines: posterior mean", 2 if tight else len(names) + 1
        look: dict[str, Any] = {"loc": "outside upper center", "markerscale": 3.0, "ncols": most}
        figure.legend(*legend_entries(figure), title=title, **look)
    return list(by_pad.flat)


def _default_rates(units: UnitSystem, predictions: Sequence[Prediction]) -> tuple[float, ...]:
    if not units.dimensionless:
        return tuple(rate * units.mm_per_s for rate in RATES)
    rates = sorted(p.trial.rate for p in predictions if np.isfinite(p.trial.rate))
    return (rates[0], rates[len(rates) // 2], rates[-1]) if rates else ()


def _nearest(predictions: Sequence[Prediction], rates: Sequence[float]) -> list[Prediction]:
    """Return the test nearest to each rate, each once, slowest first; all where none has a rate."""
    rated_ones = [p for p in predictions if np.isfinite(p.trial.rate)]
    picked = {
        min(range(len(rated_ones)), key=lambda k: abs(np.log(rated_ones[k].trial.rate / rate)))
        for rate in rates
        if rated_ones
    }
    nearest = sorted((rated_ones[k] for k in picked), key=lambda p: p.trial.rate)
    return nearest or list(predictions)


def _draw_rates(axis: Axes, predictions: Sequence[Prediction], names: Sequence[str]) -> None:
    palette = colours()
    for k, (prediction, name) in enumerate(zip(predictions, names, strict=False)):
        colour, mark = palette[k % len(palette)], MARKERS[k % len(MARKERS)]
        time = since_contact(prediction.trial, prediction.time)
        look: dict[str, Any] = {"markersize": 1.5, "markeredgewidth": 0, "label": name}
        axis.plot(time, prediction.observed, mark, color=colour, gid="measured", **look)
        axis.plot(time, prediction.mean, LINES[k % len(LINES)], color=BLACK, linewidth=0.7)
        band = "90 % predictive band" if name == names[-1] else ""
        look = {"color": colour, "alpha": 0.3, "linewidth": 0, "label": band}
        axis.fill_between(time, prediction.low, prediction.high, **look)


def _rates_text(rates: Sequence[float], unit: str) -> str:
    low, high = min(rates), max(rates)
    if not np.isfinite(low):
        return "all tests"
    middle = rated(float(np.median(rates)), unit)
    same = high - low < _SAME * low
    return middle if same else f"{rated(low, unit)} to {rated(high, unit)}"
