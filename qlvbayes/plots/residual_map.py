"""Draw where a model fails: tests against phases, in units of the noise floor."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qlvbayes.fitting.residuals import Cell, CheckResult
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import decimals_of
from qlvbayes.motion.phases import KINDS
from qlvbayes.plots.cellmap import (
    LEAST_ROWS,
    draw_cells,
    draw_colours,
    label_squares,
    over_floor,
    row_label,
    short,
    tests_by_rate,
    worst_of,
)
from qlvbayes.plots.phases import role_look
from qlvbayes.plots.style import MIDDLE, canvas, narrow, quantity, shortened, style

_ROW, _FRAME = 9.0, 28.0  # mm: a row of cells and the margins
_ROW_TIGHT, _BAR = 10.5, 10.0  # mm, in one column: three lines of a row's label, the colour bar
_NAME, _NAME_TIGHT = 28, 14  # characters of a test's name


def plot_residual_map(check: CheckResult, units: UnitSystem, *, width: float = MIDDLE) -> Axes:
    """Draw the error of the prediction of each test in each phase.

    A cell's colour and upper number are the root mean square of measured minus predicted over the
    noise floor, the lower number is the mean. Cells with structure beyond noise have a thick frame
    and a cross. ``check`` is a check's result, ``units`` those of displacement and force, ``width``
    is in mm; returns the map's axes.
    """
    tight = narrow(width)
    with style():
        tests = tests_by_rate(check.cells)
        row, frame = (_ROW_TIGHT, _FRAME + _BAR) if tight else (_ROW, _FRAME)
        height = frame + row * max(len(tests), LEAST_ROWS)
        figure = canvas(width, height)
        axis = figure.subplots()
        worst = worst_of(over_floor(cell.rmse, check.noise) for cell in check.cells)
        empty = draw_cells(
            axis, check.cells, check.noise, worst, list(tests), KINDS,
            text=lambda cell: _text(cell, check.noise), fails=lambda cell: cell.fails,
        )  # fmt: skip
        _label(axis, check, tests, units, tight=tight)
        _key(figure, units, empty=empty, tight=tight)
        draw_colours(figure, axis, worst, check.noise, units, below=tight)
    return axis


def _text(cell: Cell, noise: float) -> str:
    """Return a cell's error over the noise floor, and below it its bias."""
    ratio = over_floor(cell.rmse, noise)
    return f"{short(ratio)}\n{_signed(cell.bias, max(cell.rmse, noise))}"


def _signed(bias: float, error: float) -> str:
    """Return a bias to a tenth of the error that it is part of."""
    digits = decimals_of(error)
    text = f"{bias:+.{digits}f}" if digits < 6 else f"{bias:+.1e}"
    text = text.replace("-", "+") if float(text) == 0.0 else text
    return text.replace("-", "\N{MINUS SIGN}")


def _label(
    axis: Axes, check: CheckResult, tests: dict[str, Cell], units: UnitSystem, *, tight: bool
) -> None:
    axis.set_title(f"pad {shortened(check.pad)}", loc="left", weight="bold")
    most, gap = (_NAME_TIGHT, "\n") if tight else (_NAME, ", ")
    roles = [role_look(cell.role) for cell in tests.values()]
    cells = zip(tests.values(), roles, strict=True)
    rows = [row_label(cell, units, most, role, gap=gap) for cell, (role, _) in cells]
    label_squares(axis, rows, list(KINDS))
    for tick, (_, weight) in zip(axis.get_yticklabels(), roles, strict=True):
        tick.set_fontweight(weight)


def _key(figure: Figure, units: UnitSystem, *, empty: bool, tight: bool) -> None:
    gap = "\n" if tight else " "
    lines = [
        "upper number: RMSE / noise floor",
        f"lower number: {quantity('bias, measured − predicted', units.force)}",
        f"frame and cross: fails,{gap}error beyond noise and the spread of the posterior",
    ]
    lines += ["hatched: no samples"] if empty else []
    figure.supxlabel("\n".join(lines), x=0.01, ha="left")
