"""Lay out a figure whose rows are tests and whose columns are phases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from qlvbayes.motion.experiment import Trial
from qlvbayes.plots.phases import DWELLS, WHOLE, PhaseSamples, panel_times, same_times

GREY = "#7f7f7f"
LABEL = "left out"
_LARGE = 4.5  # points: larger than a dot, which may lie under the cross of a reading left out
_WHOLE_WIDTH = 1.8  # width of the whole test's panel over that of a phase's panel


def stacked(names: Sequence[str], tight: bool) -> bool:
    """Return whether the whole test's panel is above those of its phases, not to their left."""
    return tight and WHOLE in names


def lines_of(names: Sequence[str], tight: bool) -> int:
    """Return how many lines of panels a test takes."""
    return 2 if stacked(names, tight) else 1


def leaders(names: Sequence[str], tight: bool) -> range:
    """Return the columns whose panels have the force axis."""
    return range(lines_of(names, tight))


def lay_out_panels(
    figure: Figure, count: int, names: Sequence[str], heights: Sequence[float], *, tight: bool
) -> np.ndarray:
    """Return axes (test, strip, column); a test's strips lie one below the other.

    ``heights`` are those of a test's strips, relative to each other. Panels of a strip share their
    force axis, panels of a column within a test their time axis.
    """
    lines, width = lines_of(names, tight), len(names) - stacked(names, tight)
    wide_first = WHOLE in names and lines == 1
    ratios = [_WHOLE_WIDTH if wide_first and k == 0 else 1.0 for k in range(width)]
    rows = count * lines * len(heights)
    grid = GridSpec(
        rows, width, figure, width_ratios=ratios, height_ratios=[*heights] * (count * lines)
    )
    axes: Any = np.empty((count, len(heights), len(names)), dtype=object)
    for test, strip, column in np.ndindex(axes.shape):
        above = lines == 2 and column > 0
        row = (test * lines + above) * len(heights) + strip
        columns_at = slice(None) if lines == 2 and column == 0 else column - (lines == 2)
        indices = (test, strip, column)
        axes[indices] = _panel(figure, grid, row, columns_at, axes, indices)
        if column not in leaders(names, tight):
            axes[indices].tick_params(labelleft=False)
    return axes


def name_row(row: np.ndarray, text: str, *, tight: bool, **look: Any) -> None:
    """Write a test's name above its first panel, from where it runs over the others.

    In one column a title would widen the first panel: blanks keep the room above all panels, and an
    annotation has the name.
    """
    if not tight:
        row[0].set_title(text, loc="left", **look)
        return
    for axis in row:
        axis.set_title(" ", loc="left")
    position = {"xycoords": "axes fraction", "textcoords": "offset points", "xytext": (0.0, 6.0)}
    written = row[0].annotate(text, (0.0, 1.0), annotation_clip=False, **position, **look)
    written.set_in_layout(False)


def finish_columns(figure: Figure, axes: np.ndarray, names: Sequence[str], left: range) -> None:
    """Name the columns of axes (test, strip, column), and let the panels of a dwell share times.

    left: columns whose force axes are labelled.
    """
    for k, name in enumerate(names):
        axes[0, 0, k].set_title(f"{name}\n", weight="bold")  # the second line is the row's
        if name in DWELLS:
            same_times(axes[:, :, k].ravel())
    figure.align_ylabels(axes[:, :, left].ravel())


def mark_left_out(
    panels: Sequence[Axes], columns: Sequence[str], trial: Trial, parts: Sequence[PhaseSamples]
) -> None:
    """Draw a test's left-out readings over its panels, which share their force axis.

    Readings beyond the axis, such as spikes, are drawn at its edge, so that the axis is kept.
    """
    bad = trial.left_out
    if bad is None:
        return
    rows = np.array([k for k, _ in bad.drawn])
    low, high = panels[0].get_ylim()
    force = np.clip(bad.force[rows], low, high)
    for axis, column in zip(panels, columns, strict=True):
        time = panel_times(column, bad.time[rows], trial.phases, parts)
        shown = np.isfinite(time)
        if not shown.any() or not axis.lines:
            continue
        axis.plot(
            time[shown], force[shown], "x", color=GREY, markersize=_LARGE, markeredgewidth=0.9,
            clip_on=False, label=LABEL, gid=LABEL,
        )  # fmt: skip
    panels[0].set_ylim(low, high)


def _panel(
    figure: Figure,
    grid: GridSpec,
    row: int,
    columns_at: slice | int,
    axes: Any,
    indices: tuple[int, ...],
) -> Axes:
    test, strip, column = indices
    return figure.add_subplot(
        grid[row, columns_at],
        sharey=axes[test, strip, 0] if column else None,
        sharex=axes[test, 0, column] if strip else None,
    )
