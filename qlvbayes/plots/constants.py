"""Draw constants: of all pads with their intervals, and one pad's joint posterior."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, StrMethodFormatter
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from qlvbayes.fitting.fit import Fit
from qlvbayes.fitting.results import Saved
from qlvbayes.fitting.summary import Entry
from qlvbayes.io.wording import ends, pad_title
from qlvbayes.model.drawn import described_fields
from qlvbayes.plots.naming import parameter_label, parameter_lines
from qlvbayes.plots.panels import legend_entries
from qlvbayes.plots.style import DOUBLE, MM, canvas, colours, narrow, shortened, style

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


_RIGHT, _TOP, _TOP_TIGHT = 2.0, 13.0, 22.0  # mm around the panels
_TICK, _LINE = 3.4, 3.2  # mm: before and behind an axis's numbers, and a line of a label
_GAP = 0.08  # gap between two panels, over a panel's width
_LABEL_LETTER, _DIGIT = 1.5, 1.65  # mm: of a label, of a number
_ROOM = 4.5  # mm between two numbers
_NUMBER = StrMethodFormatter("{x:.6g}")
_INSIDE = 0.12  # share of an axis at either end that has no numbers
_UPRIGHT = 16.0  # mm of a panel below which its label is written upright
_SHARES, _SHADES = (0.9, 0.5), (0.28, 0.75)  # of the draws in a region, and its opacity
_BINS, _SMOOTH = 36, 1.6  # bins of a histogram, and the width of its blur in bins
_AROUND = 0.15  # share of the range of the draws that is added on either side
_MOST = 4000  # draws that are used, evenly out of all


def plot_pairs(fit: Fit | Saved, *, width: float = DOUBLE) -> list[Axes]:
    """Draw every pair of the model's constants that were fitted.

    The regions hold 50 and 90 % of the draws of two constants; the diagonal has the density of
    each, with its median. ``fit`` is a fit or saved results, ``width`` in mm; returns the panels,
    row by row.
    """
    draws, units = _draws(fit), _units(fit)
    names, count = list(draws), max(len(draws), 1)
    top, gaps = _TOP_TIGHT if narrow(width) else _TOP, count + _GAP * (count - 1)
    high = max(min((width - 20.0) / gaps, 24.0), 12.0)
    spans = {name: _span(values) for name, values in draws.items()}
    ticks = {name: _round_numbers(span, high) for name, span in spans.items()}
    digits = max(len(f"{x:.6g}") for one in ticks.values() for x in one) * _DIGIT + _TICK
    most = max(int(high / _LABEL_LETTER), 5)
    labels = {name: parameter_lines(name, units[name], most) for name in names}
    margin = digits + _LINE * max(text.count("\n") + 1 for text in labels.values()) + 1.0
    cell = (width - margin - _RIGHT) / gaps
    upright = cell < _UPRIGHT
    # a narrow figure leaves the effect out of the columns' labels, which the rows name
    short = {name: name.rpartition(".")[2] for name in names}
    under = {n: parameter_label(short[n], units[n]) if upright else labels[n] for n in names}
    longest = max(len(short[name]) + len(units[name]) + 3 for name in names)
    bottom = digits + _LABEL_LETTER * longest + 2.0 if upright else margin
    height = top + high * gaps + bottom
    with style():
        figure = Figure((width * MM, height * MM))
        grid = figure.add_gridspec(
            count, count, left=margin / width, right=1.0 - _RIGHT / width, bottom=bottom / height,
            top=1.0 - top / height, wspace=_GAP, hspace=_GAP,
        )  # fmt: skip
        axes = []
        for r, below in enumerate(names):
            for c, along in enumerate(names[: r + 1]):
                axis = figure.add_subplot(grid[r, c])
                if r == c:
                    _density(axis, draws[along], spans[along])
                else:
                    _regions(axis, draws[along], draws[below], (spans[along], spans[below]))
                    axis.set_yticks(ticks[below])
                    axis.yaxis.set_major_formatter(_NUMBER)
                axis.set_xticks(ticks[along])
                axis.xaxis.set_major_formatter(_NUMBER)
                axis.xaxis.set_tick_params(rotation=90)
                axis.tick_params(labelbottom=r == count - 1, labelleft=c == 0 < r)
                if r == count - 1:
                    axis.set_xlabel(under[along], va="top", rotation=90.0 * upright)
                    axis.xaxis.set_label_coords(0.5, -digits / high)
                if c == 0:
                    axis.set_ylabel(labels[below] if r else "density", va="bottom")
                    axis.yaxis.set_label_coords(-digits / cell, 0.5)
                axes.append(axis)
        _legend(figure, fit.pad, columns=1 if narrow(width) else 3)
    return axes


def _draws(fit: Fit | Saved) -> dict[str, np.ndarray]:
    """Return draws of each constant that varies, without those of the noise."""
    flat = np.reshape(fit.constants, (-1, len(fit.names)))
    flat = flat[:: max(1, -(-len(flat) // _MOST))]
    return {
        name: values
        for name, values in zip(fit.names, flat.T, strict=True)
        if not name.startswith("noise.") and np.ptp(values) > 0.0
    }


def _units(fit: Fit | Saved) -> dict[str, str]:
    if isinstance(fit, Fit):
        return dict(zip(fit.names, fit.units, strict=True))
    fields = described_fields(fit.choices)
    return {name: fit.units.of(field.unit) for field in fields for name in field.names}


def _span(values: np.ndarray) -> tuple[float, float]:
    """Return where an axis that shows these draws begins and ends."""
    low, high = np.quantile(values, [0.002, 0.998])
    margin = _AROUND * (high - low) or 0.5
    return float(low - margin), float(high + margin)


def _regions(
    axis: Axes, x: np.ndarray, y: np.ndarray, spans: tuple[tuple[float, float], ...]
) -> None:
    """Draw the smallest regions that hold 90 and 50 % of the draws, from a smoothed histogram."""
    counts, *edges = np.histogram2d(x, y, bins=_BINS, range=spans)
    density = gaussian_filter(counts, _SMOOTH)
    ordered = np.sort(density.ravel())[::-1]
    held = np.cumsum(ordered)
    levels = [float(ordered[np.searchsorted(held, share * held[-1])]) for share in _SHARES]
    centres = [0.5 * (edge[1:] + edge[:-1]) for edge in edges]
    for level, top, shade in zip(levels, [levels[1], density.max()], _SHADES, strict=True):
        if top > level:
            axis.contourf(*centres, density.T, [level, top], colors=[colours()[0]], alpha=shade)
    axis.set(xlim=spans[0], ylim=spans[1])


def _density(axis: Axes, values: np.ndarray, span: tuple[float, float]) -> None:
    """Draw the density of one constant: its 90 % interval shaded, a line at the median."""
    counts, edges = np.histogram(values, bins=2 * _BINS, range=span)
    density, colour = gaussian_filter1d(counts.astype(float), _SMOOTH), colours()[0]
    centres = 0.5 * (edges[1:] + edges[:-1])
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
    inside = (centres >= low) & (centres <= high)
    axis.fill_between(
        centres, density, where=inside.tolist(), color=colour, alpha=_SHADES[0], linewidth=0
    )
    axis.plot(centres, density, color=colour)
    axis.axvline(median, color=colour, linestyle="--", linewidth=0.7, gid="median")
    axis.set(xlim=span, ylim=(0.0, 1.15 * float(density.max())), yticks=[])
    axis.spines["left"].set_visible(False)


def _round_numbers(span: tuple[float, float], length: float) -> list[float]:
    """Return round numbers away from the ends of an axis of ``length`` mm, as many as fit."""
    margin = _INSIDE * (span[1] - span[0])
    low, high = span[0] + margin, span[1] - margin
    for count in (3, 2, 1):
        values = [float(x) for x in MaxNLocator(count).tick_values(low, high) if low <= x <= high]
        step = length * np.min(np.diff(values), initial=np.inf) / (span[1] - span[0])
        if values and step >= _ROOM:
            return values
    return [float(f"{0.5 * (low + high):.3g}")]


def _legend(figure: Figure, pad: str, columns: int) -> None:
    colour = colours()[0]
    handles = [
        Patch(facecolor=colour, alpha=0.8, linewidth=0),
        Patch(facecolor=colour, alpha=0.28, linewidth=0),
        Line2D([], [], color=colour, linestyle="--", linewidth=0.7),
    ]
    figure.suptitle(
        f"{pad_title(shortened(pad, 24))}: joint posterior", x=0.01, y=0.995, ha="left", va="top"
    )
    figure.legend(
        handles, ["50 % of the draws", "90 %", "median"], loc="upper left",
        bbox_to_anchor=(0.0, 1.0 - 4.0 * MM / figure.get_figheight()), ncols=columns,
    )  # fmt: skip
