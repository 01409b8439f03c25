"""Draw maps of tests against phases, darker where the error is larger."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import inf, isfinite, log
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from qlvbayes.diagnosis.result import CellError
from qlvbayes.fitting.residuals import Cell
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain, rated
from qlvbayes.plots.style import BLACK, canvas, narrow, shortened

LEAST_ROWS = 3  # rows for which the colour bar's label fits
_WIDE = 50.0  # worst ratio beyond which the colour bar shows powers of ten only
# darker is worse, in grey too; the report's page has the same colours
_COLOURS = LinearSegmentedColormap.from_list("error", ["#f1f4f7", "#f3c46a", "#d98200", "#7a3d00"])
_DARK = 0.72  # share of the colour scale beyond which text is white

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


def over_floor(cell: Cell | CellError, floor: float) -> float:
    """Return an error over the noise of its readings, by default a floor; infinity over none."""
    noise = floor if cell.noise is None else cell.noise
    return cell.rmse / noise if noise > 0.0 else inf


def short(ratio: float) -> str:
    """Return a ratio in three digits, or with all digits before the point."""
    digits = 2 if ratio < 9.995 else 1 if ratio < 99.95 else 0
    return f"{ratio:.{digits}f}"


@dataclass(frozen=True)
class ErrorMap:
    """The errors of one model, what stands in each cell, and which cells fail."""

    title: str
    cells: Sequence[Any]  # each a `Cell` or a `CellError`
    text: Callable[[Any], str]
    fails: Callable[[Any], bool] = lambda cell: False


def draw_maps(
    maps: Sequence[ErrorMap], noise: float, units: UnitSystem, *, width: float, height: float,
    rows: Sequence[str], kinds: Sequence[str],
) -> tuple[list[Axes], bool]:  # fmt: skip
    """Draw maps on one scale of colours; return them, and whether some cell has no samples.

    They lie next to each other, in one column of a journal one below the other, ``width`` and
    ``height`` are in mm; ``rows`` are the labels of the tests, slowest first.
    """
    tight = narrow(width)
    figure = canvas(width, height)
    shape = (len(maps), 1) if tight else (1, len(maps))
    axes = figure.subplots(*shape, sharey=True, squeeze=False).ravel()
    tests = list(tests_by_rate(maps[0].cells))
    ratios = (over_floor(cell, noise) for one in maps for cell in one.cells)
    worst, empty = max([10.0, *(ratio for ratio in ratios if isfinite(ratio))]), False
    for axis, one in zip(axes, maps, strict=True):
        empty |= _draw(axis, one, noise, worst, tests, kinds)
        axis.set(xlim=(0, len(kinds)), ylim=(max(len(rows), 1), 0))
        axis.set_xticks(np.arange(len(kinds)) + 0.5, kinds)
        axis.set_yticks(np.arange(len(rows)) + 0.5, rows)
        axis.tick_params(length=0, labeltop=True, labelbottom=False)
        axis.spines[:].set_visible(False)
        axis.set_title(one.title, loc="left")
    own = any(cell.noise is not None for one in maps for cell in one.cells)
    floor = "noise of the readings" if own else "noise floor"
    gap = " " if tight else "\n"
    label = f"RMSE / {floor}{gap}({'about ' * own}1 = {plain(noise)} {units.force})"
    _colour_bar(figure, list(axes), worst, label, below=tight)
    return list(axes), empty


def _draw(
    axis: Axes, one: ErrorMap, noise: float, worst: float, tests: list[str], kinds: Sequence[str]
) -> bool:
    """Draw a square for each test and kind of phase; one that fails has a frame and a cross."""
    by_position = {(cell.test, cell.phase): cell for cell in one.cells}
    empty = False
    for row, test in enumerate(tests):
        for column, kind in enumerate(kinds):
            cell = by_position.get((test, kind))
            if cell is None:
                empty = True
                _square(axis, row, column, facecolor="white", edgecolor="0.8", hatch="////")
                continue
            shade = min(log(max(over_floor(cell, noise), 1.0)) / log(worst), 1.0)
            failing = {"edgecolor": BLACK, "linewidth": 1.6, "gid": "fails"}
            look: dict[str, Any] = failing if one.fails(cell) else {"linewidth": 0.0}
            _square(axis, row, column, facecolor=_COLOURS(shade), **look)
            ink: dict[str, Any] = {"color": "white" if shade > _DARK else BLACK, "va": "center"}
            middle = (column + 0.5, row + 0.5)
            axis.text(*middle, one.text(cell), ha="center", linespacing=1.15, **ink)
            if one.fails(cell):
                axis.annotate(
                    "×", (column + 0.98, row + 0.04), xytext=(-6, -6), fontsize=10,
                    textcoords="offset points", ha="center", **ink,
                )  # fmt: skip
    return empty


def _colour_bar(figure: Figure, axes: list[Axes], worst: float, label: str, *, below: bool) -> None:
    """Draw the colour bar to the right of the axes, or below them."""
    shades = ScalarMappable(LogNorm(1.0, worst), _COLOURS)
    look: dict[str, Any] = {"fraction": 0.05, "pad": 0.03}
    if below:
        look = {"location": "bottom", "aspect": 30, "pad": 0.02}
    bar = figure.colorbar(shades, ax=axes, **look)
    steps = (1, 2, 5) if worst < _WIDE else (1,)
    ticks = [step * 10**k for k in range(int(np.log10(worst)) + 1) for step in steps]
    bar.set_ticks([tick for tick in ticks if tick <= worst])
    side = bar.ax.xaxis if below else bar.ax.yaxis
    side.set_major_formatter(StrMethodFormatter("{x:g}"))
    side.set_minor_formatter(NullFormatter())
    bar.outline.set_visible(False)
    bar.set_label(label)


def _square(axis: Axes, row: int, column: int, **look: Any) -> None:
    axis.add_patch(Rectangle((column + 0.02, row + 0.04), 0.96, 0.92, **look))
