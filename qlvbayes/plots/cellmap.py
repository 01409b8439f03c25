"""Draw squares in rows and columns, and maps of tests against phases, darker where worse."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import inf, isfinite, log, log10
from typing import Any, TypeVar

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from qlvbayes.diagnosis.result import CellError
from qlvbayes.fitting.residuals import Cell
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain, rated
from qlvbayes.plots.style import BLACK, shortened

LEAST_ROWS = 3  # rows for which the colour bar's label fits
_WIDE = 50.0  # worst ratio beyond which the colour bar shows powers of ten only
_COLOURS = "Blues"  # darker is worse, in grey too
_DARK = 0.55  # share of the colour scale beyond which text is white

_Cell = TypeVar("_Cell", Cell, CellError)


def tests_by_rate(cells: Iterable[_Cell]) -> dict[str, _Cell]:
    """Return one cell of each test, slowest first, tests without a rate last."""
    ordered = sorted(cells, key=lambda cell: inf if cell.rate is None else cell.rate)
    return {cell.test: cell for cell in ordered}


def row_label(
    cell: Cell | CellError, units: UnitSystem, most: int, *more: str, gap: str = ", "
) -> str:
    """Return a test's name, in ``most`` characters at most, and below it its rate and ``more``."""
    below = [*([] if cell.rate is None else [rated(cell.rate, units.speed)]), *more]
    name = shortened(cell.test, most)
    return f"{name}\n{gap.join(below)}" if below else name


def over_floor(rmse: float, noise: float) -> float:
    """Return an error over the noise floor, or infinity where there is no noise."""
    return rmse / noise if noise > 0.0 else inf


def worst_of(ratios: Iterable[float]) -> float:
    """Return the upper end of the colour scale, 10 at least."""
    return max([10.0, *(ratio for ratio in ratios if isfinite(ratio))])


def short(ratio: float) -> str:
    """Return a ratio in three digits, or with all digits before the point."""
    digits = 2 if ratio < 9.995 else 1 if ratio < 99.95 else 0
    return f"{ratio:.{digits}f}"


def draw_cells(
    axis: Axes,
    cells: Iterable[_Cell],
    noise: float,
    worst: float,
    tests: Sequence[str],
    kinds: Sequence[str],
    *,
    text: Callable[[_Cell], str],
    fails: Callable[[_Cell], bool],
) -> bool:
    """Draw a square for each test and kind of phase; return whether some have no samples."""
    by_position = {(cell.test, cell.phase): cell for cell in cells}
    empty = False
    for row, test in enumerate(tests):
        for column, kind in enumerate(kinds):
            cell = by_position.get((test, kind))
            if cell is None:
                empty = True
                _draw_empty(axis, (row, column))
                continue
            ratio = over_floor(cell.rmse, noise)
            _draw_square(axis, (row, column), ratio, worst, text(cell), fails=fails(cell))
    return empty


def label_squares(
    axis: Axes, rows: list[str], columns: list[str], *, rotation: float = 0.0
) -> None:
    """Name rows and columns, and draw no frame; ``rotation`` turns the columns' names (degrees)."""
    axis.set(xlim=(0, len(columns)), ylim=(max(len(rows), 1), 0))
    axis.set_xticks(np.arange(len(columns)) + 0.5, columns, rotation=rotation)
    axis.set_yticks(np.arange(len(rows)) + 0.5, rows)
    axis.tick_params(length=0, labeltop=True, labelbottom=False)
    axis.spines[:].set_visible(False)


def draw_colours(
    figure: Figure, axes: Any, worst: float, noise: float, units: UnitSystem, *, below: bool
) -> None:
    """Draw the colour bar to the right of the axes, or below them."""
    shades = ScalarMappable(LogNorm(1.0, worst), colormaps[_COLOURS])
    if below:
        bar = figure.colorbar(shades, ax=axes, location="bottom", aspect=30, pad=0.02)
    else:
        bar = figure.colorbar(shades, ax=axes, fraction=0.05, pad=0.03)
    steps = (1, 2, 5) if worst < _WIDE else (1,)
    ticks = [step * 10**k for k in range(int(log10(worst)) + 1) for step in steps]
    bar.set_ticks([tick for tick in ticks if tick <= worst])
    side = bar.ax.xaxis if below else bar.ax.yaxis
    side.set_major_formatter(StrMethodFormatter("{x:g}"))
    side.set_minor_formatter(NullFormatter())
    bar.outline.set_visible(False)
    gap = " " if below else "\n"
    bar.set_label(f"RMSE / noise floor{gap}(1 = {plain(noise)} {units.force})")


def draw_shaded(
    axis: Axes,
    position: tuple[int, int],
    shade: float,
    text: str,
    *,
    middle: float = 0.5,
    **look: Any,
) -> tuple[Rectangle, str]:
    """Draw a square at (row, column) with text in it; return it and the colour of the text."""
    row, column = position
    drawn = square(position, facecolor=colormaps[_COLOURS](shade), linewidth=0.0)
    axis.add_patch(drawn)
    ink = "white" if shade > _DARK else BLACK
    axis.text(column + 0.5, row + middle, text, color=ink, ha="center", va="center", **look)
    return drawn, ink


def square(position: tuple[int, int], **look: Any) -> Rectangle:
    """Return the outline of the square at (row, column)."""
    row, column = position
    return Rectangle((column + 0.02, row + 0.04), 0.96, 0.92, **look)


def _draw_square(
    axis: Axes, position: tuple[int, int], ratio: float, worst: float, text: str, *, fails: bool
) -> None:
    """Draw one cell at (row, column); one that fails has a thick frame and a cross."""
    drawn, ink = draw_shaded(axis, position, _shade(ratio, worst), text, linespacing=1.15)
    if fails:
        drawn.set(edgecolor=BLACK, linewidth=1.6, gid="fails")
        row, column = position
        _cross(axis, (column + 0.98, row + 0.04), ink)


def _draw_empty(axis: Axes, position: tuple[int, int]) -> None:
    """Draw a cell without samples, hatched."""
    axis.add_patch(square(position, facecolor="white", edgecolor="0.8", hatch="////"))


def _shade(ratio: float, worst: float) -> float:
    """Return the position on the colour scale, 0 to 1, even in the logarithm."""
    return min(log(max(ratio, 1.0)) / log(worst), 1.0)


def _cross(axis: Axes, corner: tuple[float, float], ink: str) -> None:
    axis.annotate(
        "×",
        corner,
        xytext=(-6, -6),
        textcoords="offset points",
        color=ink,
        ha="center",
        va="center",
        fontsize=10,
    )
