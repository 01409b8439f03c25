"""Draw all pads' constants with their intervals and reference values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from qlvbayes.fitting.summary import Entry
from qlvbayes.io.wording import ends, pad_title
from qlvbayes.plots.naming import parameter_label
from qlvbayes.plots.panels import legend_entries
from qlvbayes.plots.style import DOUBLE, canvas, colours, narrow, shortened, style

_ROW, _PANEL, _FRAME = 7.5, 12.0, 14.0  # mm: a pad, a panel's margins, the figure's margins
_COLUMNS, _COLUMNS_TIGHT = 4, 2
_SHORT = 5  # characters of a number of which four stand under a panel; of longer ones, fewer
_LETTER = 1.35  # mm, of the numbers in a panel
_DOWN = 0.15  # share of a row by which its bar is below its middle
_NAME = 12  # characters of a pad's name


def plot_constants(
    entries: Sequence[Entry], *, reference: str = "reference", width: float = DOUBLE
) -> list[Axes]:
    """Draw each constant of all pads: median, 90 % interval, and the reference where there is one.

    ``entries`` are those of ``constants_table`` (constants of the noise are left out),
    ``reference`` names the references in the legend, ``width`` is in mm; returns a panel for each
    constant, and for each of its units.
    """
    shown = [entry for entry in entries if not entry.parameter.startswith("noise.")]
    pads = list(dict.fromkeys(entry.pad for entry in shown))
    names = list(dict.fromkeys((entry.parameter, entry.unit) for entry in shown))
    columns = min(_COLUMNS_TIGHT if narrow(width) else _COLUMNS, max(len(names), 1))
    rows = -(-len(names) // columns)
    with style():
        height = _FRAME + rows * (_PANEL + _ROW * max(len(pads), 2))
        figure = canvas(width, height)
        grid = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
        for axis in grid[len(names) :]:
            axis.remove()
        axes = list(grid[: len(names)])
        for axis, name in zip(axes, names, strict=True):
            own = [entry for entry in shown if (entry.parameter, entry.unit) == name]
            wide = max(len(_values_text(entry)) for entry in own) > (width / columns - 8) / _LETTER
            _draw(axis, own, pads, shortened(reference, 36), gap="\n" if wide else " ")
        for axis in axes:
            axis.set_ylim(len(pads) - 0.45, -0.75)
            axis.set_yticks(range(len(pads)), [pad_title(shortened(pad, _NAME)) for pad in pads])
            axis.tick_params(axis="y", length=0)
        if any(entry.reference is not None for entry in shown):
            figure.legend(*legend_entries(figure), loc="outside upper left", ncols=2)
    return axes


def _draw(
    axis: Axes, entries: Sequence[Entry], pads: Sequence[str], reference: str, *, gap: str
) -> None:
    ink = colours()
    for entry in entries:
        row = pads.index(entry.pad)
        values = _values_text(entry).replace(" ", gap, 1)
        axis.text(0.02, row - 0.2 + 0.15 * values.count("\n"), values, va="bottom",
                  transform=axis.get_yaxis_transform(), fontsize="small",
                  linespacing=1.0).set_in_layout(False)  # fmt: skip
        look: dict[str, Any] = {"color": ink[0], "markersize": 3.6, "linewidth": 1.6}
        axis.plot([entry.low, entry.high], [row + _DOWN] * 2, gid="interval", **look)
        label = "median (bar: 90 % interval)"
        axis.plot(entry.median, row + _DOWN, "o", gid="median", label=label, **look)
        if entry.reference is not None:
            axis.plot(
                entry.reference, row + _DOWN, "D", color=ink[1], markerfacecolor="none",
                markersize=6.0, markeredgewidth=0.9, gid="reference",
                label=reference,
            )  # fmt: skip
    for row in range(len(pads)):
        axis.axhline(row + _DOWN, color="0.92", linewidth=0.4, zorder=0)
    axis.margins(x=0.12)
    long = max(len(text) for e in entries for text in ends(e.median, e.low, e.high)) > _SHORT
    axis.xaxis.set_major_locator(MaxNLocator(2 if long else 3, min_n_ticks=1 if long else 2))
    first = entries[0]
    axis.set_xlabel(parameter_label(first.parameter, first.unit))
    if np.ptp([x for e in entries for x in (e.low, e.high, e.median)]) == 0.0:
        axis.set_xlim(first.median - 0.5, first.median + 0.5)


def _values_text(entry: Entry) -> str:
    median, low, high = ends(entry.median, entry.low, entry.high)
    return f"{median} (fixed)" if entry.low == entry.high else f"{median} ({low} to {high})"
