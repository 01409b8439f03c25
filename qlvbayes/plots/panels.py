"""Lay out a figure whose rows are tests and whose columns are phases."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.ticker import MaxNLocator

from qlvbayes.motion.experiment import Trial
from qlvbayes.plots.phases import (
    DWELLS,
    WHOLE,
    PanelSamples,
    PhaseSamples,
    by_rate,
    columns,
    divide,
    finish_time,
    number_repeats,
    panel_samples,
    panel_times,
    same_times,
)
from qlvbayes.plots.style import BLACK, canvas, narrow

GREY = "#7f7f7f"
LABEL = "left out"
_LARGE = 4.5  # points: larger than a dot, which may lie under the cross of a reading left out
_WHOLE_WIDTH = 1.8  # width of the whole test's panel over that of a phase's panel


class _Timed(Protocol):
    """Anything that is known of a test's samples: a prediction, or the curves of models."""

    @property
    def trial(self) -> Trial: ...
    @property
    def time(self) -> np.ndarray: ...


_Test = TypeVar("_Test", bound=_Timed)


@dataclass(frozen=True, eq=False)
class PanelRow(Generic[_Test]):
    """A test with its samples by phase, and its axes (strip, column) with the columns' names."""

    test: _Test
    parts: Sequence[PhaseSamples]
    axes: np.ndarray
    names: Sequence[str]
    tight: bool

    def paint(
        self,
        draw: Callable[[np.ndarray, PanelSamples, _Test], None],
        force: np.ndarray,
        palette: Sequence[str] = (BLACK,),
        *,
        fontsize: float,
    ) -> None:
        """Paint every column: ``draw`` draws a test's samples into the column's axes (strip,)."""
        for panels, column in zip(self.axes.T, self.names, strict=True):
            shown = panel_samples(column, self.test.time, self.parts)
            for samples in shown:
                draw(panels, samples, self.test)
            if column != WHOLE and len(shown) > 1:
                number_repeats(panels[0], shown, force, palette, fontsize=fontsize)
            for axis in panels:
                finish_time(axis, column, self.parts, tight=self.tight)
            for axis in panels[:-1]:  # the lowest strip has the times
                axis.set_xlabel("")
                axis.tick_params(labelbottom=False)
        _mark_left_out(self.axes[0], self.names, self.test.trial, self.parts)

    def label(self, name: str, quantities: Sequence[str], **look: Any) -> None:
        """Write a name above the row, at the left, and what each strip shows at its force axes."""
        _name_row(self.axes[0], name, tight=self.tight, **look)
        for panels, text in zip(self.axes, quantities, strict=True):
            for k in _leaders(self.names, self.tight):
                panels[k].set_ylabel(text)


@dataclass(frozen=True, eq=False)
class PhasePanels(Generic[_Test]):
    """A figure with a row for each test, slowest first, and a column for each kind of phase.

    ``axes`` are those of (test, strip, column), ``names`` those of the columns. ``tight`` figures
    are laid out for one column of a journal.
    """

    figure: Figure
    axes: np.ndarray
    names: list[str]
    tight: bool
    rows: list[PanelRow[_Test]]

    @classmethod
    def for_tests(
        cls,
        tests: Iterable[_Test],
        width: float,
        *,
        frame: float,
        row: float,
        heights: Sequence[float] = (1.0,),
        **layout: Any,
    ) -> PhasePanels[_Test]:
        """Return the figure, with empty panels."""
        ordered = sorted(tests, key=lambda test: by_rate(test.trial.rate))
        parts = [divide(test.time, test.trial.phases) for test in ordered]
        names, tight = columns(parts), narrow(width)
        height = frame + row * _lines_of(names, tight) * len(ordered)
        figure = canvas(width, height, **layout)
        axes = _lay_out(figure, len(ordered), names, heights, tight=tight)
        rows = [
            PanelRow(test, own, panels, names, tight)
            for test, own, panels in zip(ordered, parts, axes, strict=True)
        ]
        return cls(figure, axes, names, tight, rows)

    def finish(self, ticks: Sequence[int]) -> None:
        """Name the columns, and let panels of a dwell share their times, once all are painted."""
        for k, name in enumerate(self.names):
            self.axes[0, 0, k].set_title(f"{name}\n", weight="bold")  # the second line is the row's
            if name in DWELLS:
                same_times(self.axes[:, :, k].ravel())
        left = _leaders(self.names, self.tight)
        self.figure.align_ylabels(self.axes[:, :, left].ravel())
        for strips in self.axes[:, :, 0]:  # with which the other columns share their force axes
            for axis, most in zip(strips, ticks, strict=True):
                axis.yaxis.set_major_locator(MaxNLocator(most))


def _stacked(names: Sequence[str], tight: bool) -> bool:
    """Return whether the whole test's panel is above those of its phases, not to their left."""
    return tight and WHOLE in names


def _lines_of(names: Sequence[str], tight: bool) -> int:
    """Return how many lines of panels a test takes."""
    return 2 if _stacked(names, tight) else 1


def _leaders(names: Sequence[str], tight: bool) -> range:
    """Return the columns whose panels have the force axis."""
    return range(_lines_of(names, tight))


def _lay_out(
    figure: Figure, count: int, names: Sequence[str], heights: Sequence[float], *, tight: bool
) -> np.ndarray:
    """Return axes (test, strip, column); a test's strips lie one below the other."""
    lines, width = _lines_of(names, tight), len(names) - _stacked(names, tight)
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
        if column not in _leaders(names, tight):
            axes[indices].tick_params(labelleft=False)
    return axes


def _name_row(row: np.ndarray, text: str, *, tight: bool, **look: Any) -> None:
    """Write a test's name above its first panel, from where it runs over the others."""
    if not tight:
        row[0].set_title(text, loc="left", **look)
        return
    for axis in row:
        axis.set_title(" ", loc="left")
    position = {"xycoords": "axes fraction", "textcoords": "offset points", "xytext": (0.0, 6.0)}
    written = row[0].annotate(text, (0.0, 1.0), annotation_clip=False, **position, **look)
    written.set_in_layout(False)


def _mark_left_out(
    panels: Sequence[Axes], names: Sequence[str], trial: Trial, parts: Sequence[PhaseSamples]
) -> None:
    """Draw a test's left-out readings over its panels, which share their force axis."""
    bad = trial.left_out
    if bad is None:
        return
    rows = np.array([k for k, _ in bad.drawn])
    low, high = panels[0].get_ylim()
    force = np.clip(bad.force[rows], low, high)
    for axis, column in zip(panels, names, strict=True):
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
