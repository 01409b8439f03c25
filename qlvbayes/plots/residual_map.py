"""Draw where a model fails: tests against phases, in units of the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qlvbayes.fitting.residuals import Cell, CheckResult
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import decimals_of
from qlvbayes.motion.phases import KINDS
from qlvbayes.plots.cellmap import (
    draw_colours,
    draw_empty,
    draw_square,
    label_squares,
    over_floor,
    short,
    worst_of,
)
from qlvbayes.plots.style import MIDDLE, canvas, narrow, quantity, rated, shortened, style

_ROW, _FRAME = 9.0, 28.0  # mm: a row of cells and the margins
_LEAST_ROWS = 3  # rows for which the colour bar's label fits
_ROW_TIGHT, _BAR = 10.5, 10.0  # mm, in one column: three lines of a row's label, the colour bar
_NAME, _NAME_TIGHT = 28, 14  # characters of a test's name


def plot_residual_map(check: CheckResult, units: UnitSystem, *, width: float = MIDDLE) -> Axes:
    """Draw the error of the prediction of each test in each phase.

    There is one row for each test, slowest first, fitted ones bold, and one column for each kind of
    phase. A cell's colour and upper number are the root mean square of measured minus predicted,
    over the noise floor: 1 (lightest) is as good as noise allows. The lower number is the mean of
    measured minus predicted. Cells with structure beyond noise have a thick black frame and a
    cross. Hatched cells have no samples.

    Parameters
    ----------
    check
        The result of a check.
    units
        The units of displacement and force.
    width
        Width of the figure (mm).

    Returns
    -------
    Axes
        The map's axes.
    """
    tight = narrow(width)
    with style():
        tests = _tests(check.cells)
        row, frame = (_ROW_TIGHT, _FRAME + _BAR) if tight else (_ROW, _FRAME)
        height = frame + row * max(len(tests), _LEAST_ROWS)
        figure = canvas(width, height)
        axis = figure.subplots()
        worst = worst_of(over_floor(cell.rmse, check.noise) for cell in check.cells)
        for cell in check.cells:
            _draw_cell(axis, cell, check, worst, list(tests).index(cell.test))
        _label(axis, check, tests, units, tight=tight)
        _key(figure, units, empty=_hatch_empty(axis, check.cells, list(tests)), tight=tight)
        draw_colours(figure, axis, worst, check.noise, units, below=tight)
    return axis


def _tests(cells: Sequence[Cell]) -> dict[str, Cell]:
    """Return one cell of each test, ordered by the test's rate."""
    ordered = sorted(cells, key=lambda cell: inf if cell.rate is None else cell.rate)
    return {cell.test: cell for cell in ordered}


def _hatch_empty(axis: Axes, cells: Sequence[Cell], tests: Sequence[str]) -> int:
    """Hatch the cells without samples; return how many there are."""
    present = {(cell.test, cell.phase) for cell in cells}
    empty = [
        (row, column)
        for row, test in enumerate(tests)
        for column, kind in enumerate(KINDS)
        if (test, kind) not in present
    ]
    for position in empty:
        draw_empty(axis, position)
    return len(empty)


def _draw_cell(axis: Axes, cell: Cell, check: CheckResult, worst: float, row: int) -> None:
    ratio = over_floor(cell.rmse, check.noise)
    text = f"{short(ratio)}\n{_signed(cell.bias, max(cell.rmse, check.noise))}"
    position = (row, KINDS.index(cell.phase))
    draw_square(axis, position, ratio, worst, text, fails=cell.fails)


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
    rows = [_row_label(cell, units, tight=tight) for cell in tests.values()]
    label_squares(axis, rows, list(KINDS))
    for tick, cell in zip(axis.get_yticklabels(), tests.values(), strict=True):
        tick.set_fontweight("bold" if cell.role == "fit" else "normal")


def _row_label(cell: Cell, units: UnitSystem, *, tight: bool) -> str:
    rate = [] if cell.rate is None else [rated(cell.rate, units.speed)]
    role = "fitted" if cell.role == "fit" else "predicted"
    name = shortened(cell.test, _NAME_TIGHT if tight else _NAME)
    return f"{name}\n" + ("\n" if tight else ", ").join([*rate, role])


def _key(figure: Figure, units: UnitSystem, *, empty: int, tight: bool) -> None:
    gap = "\n" if tight else " "
    lines = [
        "upper number: RMSE / noise floor",
        f"lower number: {quantity('bias, measured − predicted', units.force)}",
        f"frame and cross: fails,{gap}error beyond noise and the spread of the posterior",
    ]
    lines += ["hatched: no samples"] if empty else []
    figure.supxlabel("\n".join(lines), x=0.01, ha="left")
