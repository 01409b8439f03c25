"""Draw a prescribed programme and the specimen's response, with posterior bands."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    canvas,
    colours,
    displacement_label,
    force_label,
    narrow,
    shortened,
    style,
)
from qlvbayes.use.prescribed.forecast import Forecast

_PANEL, _FRAME = 42.0, 16.0  # mm: a row of panels, and the margins
_BANDS = ((0.9, 0.25), (0.5, 0.5))  # share of the draws, opacity
_DECADES = 30.0  # ratio of whole to first stretch beyond which time is logarithmic too
_TITLE, _TITLE_TIGHT = 110, 48  # characters of a programme


def plot_prediction(forecast: Forecast, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the prescribed quantity above, and below it the response: median, 50 and 90 % band.

    Where a programme's first stretch is a thirtieth of it or less, a second column in logarithmic
    time shows it. ``forecast`` is that of ``predict_program``, ``width`` in mm; returns the panels.
    """
    tight = narrow(width)
    with style():
        quick = _DECADES * _first(forecast) <= forecast.time[-1] - forecast.time[0]
        scales = ["linear", "log"] if quick and not tight else ["linear"]
        figure = canvas(width, 2.0 * _PANEL + _FRAME)
        axes = figure.subplots(2, len(scales), sharex="col", sharey="row", squeeze=False)
        for column, scale in zip(axes.T, scales, strict=True):
            _draw(column, forecast, scale)
        units, moved = forecast.units, forecast.program.quantity == "displacement"
        labels = [displacement_label(units), force_label(units)]
        for axis, label in zip(axes[:, 0], labels if moved else labels[::-1], strict=True):
            axis.set_ylabel(label)
            axis.yaxis.set_major_locator(MaxNLocator(4))
        figure.align_ylabels(axes[:, 0])
        most = _TITLE_TIGHT if tight else _TITLE
        figure.suptitle(shortened(f"{forecast.pad}: {forecast.program.title}", most))
        handles, names = axes[1, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=3)
    return list(axes.flat)


def _draw(column: np.ndarray, forecast: Forecast, scale: str) -> None:
    above, below = column
    colour, time = colours()[0], forecast.time - forecast.time[0]
    above.plot(time, forecast.given, color=BLACK)
    for share, opacity in _BANDS:
        low, high = forecast.band(share)
        below.fill_between(
            time,
            low,
            high,
            color=colour,
            alpha=opacity,
            linewidth=0,
            label=f"{100 * share:.0f} % band",
        )
    below.plot(time, forecast.median, color=colour, label="posterior median")
    below.set_xlabel("time (s)")
    if scale == "log":
        below.set_xscale("log")
        below.set_xlim(left=0.1 * _first(forecast))
        below.xaxis.set_major_locator(LogLocator(numticks=6))
        below.xaxis.set_minor_formatter(NullFormatter())


def _first(forecast: Forecast) -> float:
    """Return the time (s) until the slope of the prescribed quantity first changes."""
    slopes = np.diff(forecast.given) / np.maximum(np.diff(forecast.time), 1e-300)
    change = np.abs(np.diff(slopes)) > 1e-3 * np.max(np.abs(slopes))
    ends = np.flatnonzero(change)
    last = int(ends[0]) + 1 if ends.size else forecast.time.size - 1
    return float(forecast.time[last] - forecast.time[0])
