"""Where a model fails, at a glance: tests against phases, in units of the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, inf, isfinite, log, log10
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from qlvbayes.kinematics.phases import KINDS
from qlvbayes.plots.style import BLACK, MIDDLE, MM, quantity, rated, shortened, style
from qlvbayes.residuals import Cell, Check
from qlvbayes.units import UnitSystem

_ROW, _FRAME = 9.0, 28.0  # mm, a row of cells and what is around them
_LEAST_ROWS = 3  # that the colour bar's label fits
_WIDE = 50.0  # a worst ratio: from there on the colour bar shows powers of ten only
_COLOURS = "Blues"  # darker is worse, in grey too
_DARK = 0.55  # of the colour scale: from there on white type


def plot_residual_map(check: Check, units: UnitSystem) -> Figure:
    """Draw how far each test is missed in each phase.

    One row a test, slowest first, fitted ones bold; one column a kind of phase. A cell's colour and
    upper number give the root mean square of measured minus predicted, over the noise floor: 1
    (lightest) is as good as noise allows. The lower number is the mean of measured minus predicted.
    Cells with structure beyond noise have a thick black frame and a cross. Hatched cells have no
    samples.
    """
    with style():
        tests = _tests(check.cells)
        height = _FRAME + _ROW * max(len(tests), _LEAST_ROWS)
        figure = Figure((MIDDLE * MM, height * MM), layout="constrained")
        axis = figure.subplots()
        worst = _worst(check)
        for cell in check.cells:
            _draw_cell(axis, cell, check, worst, list(tests).index(cell.test))
        _label(axis, check, tests, units)
        _key(figure, units, empty=_hatch_empty(axis, check.cells, list(tests)))
        _colour_bar(figure, axis, worst, check.noise, units)
    return figure


def _tests(cells: Sequence[Cell]) -> dict[str, Cell]:
    """One cell of each test, by the test's rate."""
    ordered = sorted(cells, key=lambda cell: inf if cell.rate is None else cell.rate)
    return {cell.test: cell for cell in ordered}


def _ratio(cell: Cell, noise: float) -> float:
    return cell.rmse / noise if noise > 0.0 else inf


def _worst(check: Check) -> float:
    """Upper end of the colour scale, 10 at least."""
    ratios = [_ratio(cell, check.noise) for cell in check.cells]
    return max([10.0, *(ratio for ratio in ratios if isfinite(ratio))])


def _shade(ratio: float, worst: float) -> float:
    """Place on the colour scale, 0 to 1, even in the logarithm."""
    return min(log(max(ratio, 1.0)) / log(worst), 1.0)


def _hatch_empty(axis: Axes, cells: Sequence[Cell], tests: Sequence[str]) -> int:
    """Hatch the cells without samples; return how many there are."""
    present = {(cell.test, cell.phase) for cell in cells}
    empty = [
        (row, column)
        for row, test in enumerate(tests)
        for column, kind in enumerate(KINDS)
        if (test, kind) not in present
    ]
    for row, column in empty:
        axis.add_patch(_square(row, column, facecolor="white", edgecolor="0.8", hatch="////"))
    return len(empty)


def _square(row: int, column: int, **look: Any) -> Rectangle:
    return Rectangle((column + 0.02, row + 0.04), 0.96, 0.92, **look)


def _draw_cell(axis: Axes, cell: Cell, check: Check, worst: float, row: int) -> None:
    ratio, column = _ratio(cell, check.noise), KINDS.index(cell.phase)
    fails = check.fails(cell)
    shade = _shade(ratio, worst)
    colour, ink = colormaps[_COLOURS](shade), "white" if shade > _DARK else BLACK
    axis.add_patch(
        _square(
            row,
            column,
            facecolor=colour,
            edgecolor=BLACK,
            linewidth=1.6 if fails else 0.0,
            gid="fails" if fails else None,
        )
    )
    text = f"{_short(ratio)}\n{_signed(cell.bias, max(cell.rmse, check.noise))}"
    axis.text(column + 0.5, row + 0.5, text, color=ink, ha="center", va="center", linespacing=1.15)
    if fails:
        corner = (column + 0.98, row + 0.04)
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


def _short(ratio: float) -> str:
    digits = 2 if ratio < 9.995 else 1 if ratio < 99.95 else 0
    return f"{ratio:.{digits}f}"


def _signed(bias: float, error: float) -> str:
    """To a tenth of the error that it is part of."""
    digits = max(1 - floor(log10(error)), 0) if error > 0.0 else 0
    text = f"{bias:+.{digits}f}" if digits < 6 else f"{bias:+.1e}"
    return text.replace("-", "\N{MINUS SIGN}")


def _label(axis: Axes, check: Check, tests: dict[str, Cell], units: UnitSystem) -> None:
    axis.set_title(f"pad {check.pad}", loc="left", weight="bold")
    axis.set(xlim=(0, len(KINDS)), ylim=(len(tests), 0))
    axis.set_xticks(np.arange(len(KINDS)) + 0.5, KINDS)
    axis.set_yticks(np.arange(len(tests)) + 0.5, [_row_label(c, units) for c in tests.values()])
    for tick, cell in zip(axis.get_yticklabels(), tests.values(), strict=True):
        tick.set_fontweight("bold" if cell.role == "fit" else "normal")
    axis.tick_params(length=0, labeltop=True, labelbottom=False)
    axis.spines[:].set_visible(False)


def _row_label(cell: Cell, units: UnitSystem) -> str:
    rate = [] if cell.rate is None else [rated(cell.rate, units.speed)]
    role = "fitted" if cell.role == "fit" else "predicted"
    return f"{shortened(cell.test, 28)}\n{', '.join([*rate, role])}"


def _key(figure: Figure, units: UnitSystem, *, empty: int) -> None:
    lines = [
        "upper number: RMSE / noise floor",
        f"lower number: {quantity('bias, measured − predicted', units.force)}",
        "frame and cross: fails, error beyond noise and posterior spread",
    ]
    lines += ["hatched: no samples"] if empty else []
    figure.supxlabel("\n".join(lines), x=0.01, ha="left", fontsize=7.0)


def _colour_bar(figure: Figure, axis: Axes, worst: float, noise: float, units: UnitSystem) -> None:
    colours = ScalarMappable(LogNorm(1.0, worst), colormaps[_COLOURS])
    bar = figure.colorbar(colours, ax=axis, fraction=0.05, pad=0.03)
    steps = (1, 2, 5) if worst < _WIDE else (1,)
    ticks = [step * 10**k for k in range(int(log10(worst)) + 1) for step in steps]
    bar.set_ticks([tick for tick in ticks if tick <= worst])
    bar.ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
    bar.outline.set_visible(False)
    bar.set_label(f"RMSE / noise floor\n(1 = {noise:.3g} {units.force})")
