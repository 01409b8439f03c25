"""Draw where the baseline model fails, and what is left once effects are added."""

from __future__ import annotations

from math import inf
from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.diagnosis.result import CellError, DiagnosisResult, Stage, StructuredPhase
from qlvbayes.io.units import UnitSystem
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
from qlvbayes.plots.naming import heading
from qlvbayes.plots.style import DOUBLE, canvas, narrow, rated, shortened, style

_ROW, _FRAME = 8.0, 41.0  # mm: a row of cells and the margins
_LEAST_ROWS = 3  # rows for which the colour bar's label fits
_TITLE = 40  # characters a line, of a panel's title
_KEY_TIGHT = 58  # characters a line, of the key in one column


def plot_residuals_before_after(diagnosis: DiagnosisResult, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the error of each test in each phase, by the baseline model and by the last model.

    There is one row for each test, slowest first, and one column for each kind of phase. Colour and
    number are the root mean square of measured minus predicted over the noise floor, on one scale
    for both models: 1 is as good as noise allows. Cells with structure beyond noise have a thick
    black frame and a cross; under each title is the p-value of the test of all cells. Hatched cells
    have no samples. Where no effect was added there is one panel. In one column the panels are one
    below the other.

    Parameters
    ----------
    diagnosis
        The result of the diagnosis.
    width
        Width of the figure (mm).

    Returns
    -------
    list of Axes
        The maps' axes.
    """
    tight = narrow(width)
    stages = diagnosis.stages[:: max(len(diagnosis.stages) - 1, 1)]
    units = diagnosis.units
    with style():
        tests = _tests(stages[0])
        kinds: list[str] = [kind for kind in KINDS if any(c.phase == kind for c in stages[0].cells)]
        height = _FRAME + _ROW * max(len(tests), _LEAST_ROWS)
        height += (height - _FRAME / 2) * (len(stages) - 1) * tight + 8.0 * tight
        figure = canvas(width, height)
        shape = (len(stages), 1) if tight else (1, len(stages))
        axes = figure.subplots(*shape, sharey=True, squeeze=False).ravel()
        worst = worst_of(over_floor(c.rmse, diagnosis.noise) for s in stages for c in s.cells)
        rows = [_row_label(test, units) for test in tests.values()]
        for axis, stage in zip(axes, stages, strict=True):
            label_squares(axis, rows, kinds)
            _draw(axis, stage, diagnosis.noise, worst, list(tests), kinds)
            name = fill(model_name(stage.effects, stage.base.others(stages[0].base)), _TITLE)
            axis.set_title(f"{name}\n{_p_value(stage.p_value)}", loc="left")
        draw_colours(figure, list(axes), worst, diagnosis.noise, units, below=tight)
        figure.suptitle(heading(diagnosis, tight=tight), x=0.01, ha="left")
        _key(figure, empty=len(tests) * len(kinds) > len(stages[0].cells), tight=tight)
    return list(axes)


def _tests(stage: Stage) -> dict[str, CellError]:
    """Return one cell of each test, ordered by the test's rate."""
    return {cell.test: cell for cell in sorted(stage.cells, key=_by_rate)}


def _by_rate(cell: CellError) -> float:
    """Return the key that sorts cells by rate, tests without a rate last."""
    return inf if cell.rate is None else cell.rate


def _row_label(cell: CellError, units: UnitSystem) -> str:
    name = shortened(cell.test, 24)
    return name if cell.rate is None else f"{name}\n{rated(cell.rate, units.speed)}"


def _draw(
    axis: Axes, stage: Stage, noise: float, worst: float, tests: list[str], kinds: list[str]
) -> None:
    by_position = {(cell.test, cell.phase): cell for cell in stage.cells}
    for row, test in enumerate(tests):
        for column, kind in enumerate(kinds):
            cell = by_position.get((test, kind))
            if cell is None:
                draw_empty(axis, (row, column))
                continue
            ratio = over_floor(cell.rmse, noise)
            fails = StructuredPhase(test, kind) in stage.failing
            draw_square(axis, (row, column), ratio, worst, short(ratio), fails=fails)


def _p_value(p: float) -> str:
    if p < 1e-4:
        return "adequacy p < 0.0001"
    return f"adequacy p = {p:.2f}" if p >= 0.1 else f"adequacy p = {p:.1g}"


def _key(figure: Figure, *, empty: bool, tight: bool) -> None:
    first = ["number: RMSE of measured − predicted / noise floor"]
    first += ["hatched: no samples"] if empty else []
    second = "frame and cross: systematic error beyond noise, which a small RMSE may hide"
    third = "adequacy p: probability that noise alone would look as systematic"
    lines = ["; ".join(first), second, third]
    text = "\n".join(fill(line, _KEY_TIGHT) for line in lines) if tight else "\n".join(lines)
    figure.supxlabel(text, x=0.01, ha="left")
