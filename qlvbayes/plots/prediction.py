"""A program and what a specimen answers to it, with bands of the posterior."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from qlvbayes.plots.style import BLACK, DOUBLE, MM, colours, narrow, quantity, shortened, style
from qlvbayes.use.prescribed.forecast import Forecast

_PANEL, _FRAME = 42.0, 16.0  # mm: a row of panels, and what is around them
_BANDS = ((0.9, 0.25), (0.5, 0.5))  # share of the draws, opacity
_DECADES = 30.0  # longest over shortest stretch, from where on time is logarithmic too
_TITLE, _TITLE_TIGHT = 110, 48  # characters of a program


def plot_prediction(found: Forecast, *, width: float = DOUBLE) -> list[Axes]:
    """Draw what was prescribed above, and beneath it the answer: median, 50 and 90 % band.

    Where a program's first stretch is a thirtieth of it or less there is a second column in
    logarithmic time, which shows the stretch; in one column of a journal it is left out.

    width: of the figure (mm). Returns the panels, row by row.
    """
    tight = narrow(width)
    with style():
        scales = ["linear", "log"] if _quick(found) and not tight else ["linear"]
        figure = Figure((width * MM, (2.0 * _PANEL + _FRAME) * MM), layout="constrained")
        axes = figure.subplots(2, len(scales), sharex="col", sharey="row", squeeze=False)
        for column, scale in zip(axes.T, scales, strict=True):
            _draw(column, found, scale)
        units, moved = found.units, found.program.quantity == "displacement"
        labels = [
            quantity(units.displacement_name, units.displacement),
            quantity(units.force_name, units.force),
        ]
        for axis, label in zip(axes[:, 0], labels if moved else labels[::-1], strict=True):
            axis.set_ylabel(label)
            axis.yaxis.set_major_locator(MaxNLocator(4))
        figure.align_ylabels(axes[:, 0])
        most = _TITLE_TIGHT if tight else _TITLE
        figure.suptitle(shortened(f"{found.pad}: {found.program.told}", most))
        handles, names = axes[1, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=3)
    return list(axes.flat)


def _draw(column: np.ndarray, found: Forecast, scale: str) -> None:
    above, beneath = column
    colour, time = colours()[0], found.time - found.time[0]
    above.plot(time, found.given, color=BLACK)
    for share, opacity in _BANDS:
        low, high = found.band(share)
        beneath.fill_between(
            time,
            low,
            high,
            color=colour,
            alpha=opacity,
            linewidth=0,
            label=f"{100 * share:.0f} % band",
        )
    beneath.plot(time, found.median, color=colour, label="posterior median")
    beneath.set_xlabel("time (s)")
    if scale == "log":
        beneath.set_xscale("log")
        beneath.set_xlim(left=0.1 * _first(found))
        beneath.xaxis.set_major_locator(LogLocator(numticks=6))
        beneath.xaxis.set_minor_formatter(NullFormatter())


def _first(found: Forecast) -> float:
    """How long (s) until the slope of what is prescribed first changes for good, or all of it."""
    slopes = np.diff(found.given) / np.maximum(np.diff(found.time), 1e-300)
    change = np.abs(np.diff(slopes)) > 1e-3 * np.max(np.abs(slopes))
    ends = np.flatnonzero(change)
    last = int(ends[0]) + 1 if ends.size else found.time.size - 1
    return float(found.time[last] - found.time[0])


def _quick(found: Forecast) -> bool:
    return _DECADES * _first(found) <= found.time[-1] - found.time[0]
