"""Draw where the baseline model fails, and what is left once effects are added."""

from __future__ import annotations

from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.diagnosis.result import DiagnosisResult, Stage, StructuredPhase
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
from qlvbayes.plots.naming import heading
from qlvbayes.plots.style import DOUBLE, canvas, narrow, style

_ROW, _FRAME = 8.0, 41.0  # mm: a row of cells and the margins
_NAME = 24  # characters of a test's name
_TITLE = 40  # characters a line, of a panel's title
_KEY_TIGHT = 58  # characters a line, of the key in one column


def plot_residuals_before_after(diagnosis: DiagnosisResult, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the error of each test in each phase, by the baseline model and by the last model.

    Colour and number are the root mean square of measured minus predicted over the noise floor, on
    one scale for both models. Where no effect was added there is one panel. ``diagnosis`` is the
    diagnosis's result, ``width`` in mm; returns the maps' axes.
    """
    tight = narrow(width)
    stages = diagnosis.stages[:: max(len(diagnosis.stages) - 1, 1)]
    units, noise, empty = diagnosis.units, diagnosis.noise, False
    with style():
        tests = tests_by_rate(stages[0].cells)
        kinds: list[str] = [kind for kind in KINDS if any(c.phase == kind for c in stages[0].cells)]
        height = _FRAME + _ROW * max(len(tests), LEAST_ROWS)
        height += (height - _FRAME / 2) * (len(stages) - 1) * tight + 8.0 * tight
        figure = canvas(width, height)
        shape = (len(stages), 1) if tight else (1, len(stages))
        axes = figure.subplots(*shape, sharey=True, squeeze=False).ravel()
        worst = worst_of(over_floor(c.rmse, noise) for s in stages for c in s.cells)
        rows = [row_label(test, units, _NAME) for test in tests.values()]
        for axis, stage in zip(axes, stages, strict=True):
            label_squares(axis, rows, kinds)
            empty |= _draw(axis, stage, noise, worst, list(tests), kinds)
            name = fill(model_name(stage.effects, stage.base.others(stages[0].base)), _TITLE)
            axis.set_title(f"{name}\n{_p_value(stage.p_value)}", loc="left")
        draw_colours(figure, list(axes), worst, noise, units, below=tight)
        figure.suptitle(heading(diagnosis, tight=tight), x=0.01, ha="left")
        _key(figure, empty=empty, tight=tight)
    return list(axes)


def _draw(
    axis: Axes, stage: Stage, noise: float, worst: float, tests: list[str], kinds: list[str]
) -> bool:
    """Draw the errors of a model; return whether there are cells without samples."""
    return draw_cells(
        axis, stage.cells, noise, worst, tests, kinds,
        text=lambda cell: short(over_floor(cell.rmse, noise)),
        fails=lambda cell: StructuredPhase(cell.test, cell.phase) in stage.failing,
    )  # fmt: skip


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
