"""Draw where the baseline model fails, and what is left once effects are added."""

from __future__ import annotations

from textwrap import fill

from matplotlib.axes import Axes

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.diagnosis.result import DiagnosisResult, Stage, StructuredPhase
from qlvbayes.motion.phases import KINDS
from qlvbayes.plots.cellmap import (
    LEAST_ROWS,
    ErrorMap,
    draw_maps,
    over_floor,
    row_label,
    short,
    tests_by_rate,
)
from qlvbayes.plots.files import figure_of
from qlvbayes.plots.naming import heading
from qlvbayes.plots.style import DOUBLE, narrow, style

_ROW, _FRAME = 8.0, 45.0  # mm: a row of cells and the margins
_NAME = 24  # characters of a test's name
_TITLE = 40  # characters a line, of a panel's title
_KEY_WIDE, _KEY_TIGHT = 120, 58  # characters a line, of the key
_KEY = (
    "frame and cross: systematic error beyond noise, which a small RMSE may hide; a ramp shorter "
    "than the noise stays correlated may reach 2 or 3 by noise alone, and has no frame then",
    "adequacy p: probability that noise alone would look as systematic",
)


def plot_residuals_before_after(diagnosis: DiagnosisResult, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the error of each test in each phase, by the baseline model and by the last model.

    Both models are fitted to all tests. Colour and number are the root mean square of measured
    minus fitted force over the noise floor, on one scale for both. Where no effect was added there
    is one panel. ``diagnosis`` is the diagnosis's result, ``width`` in mm; returns the maps' axes.
    """
    tight, noise, units = narrow(width), diagnosis.noise, diagnosis.units
    stages = diagnosis.stages[:: max(len(diagnosis.stages) - 1, 1)]
    tests = tests_by_rate(stages[0].cells)
    kinds = [kind for kind in KINDS if any(c.phase == kind for c in stages[0].cells)]
    height = _FRAME + _ROW * max(len(tests), LEAST_ROWS)
    height += ((height - _FRAME / 2) * (len(stages) - 1) + 12.0) * tight
    with style():
        axes, empty = draw_maps(
            [_map(stage, diagnosis) for stage in stages], noise, units, width=width,
            height=height, kinds=kinds,
            rows=[row_label(test, units, _NAME) for test in tests.values()],
        )  # fmt: skip
        figure = figure_of(axes)
        figure.suptitle(heading(diagnosis, tight=tight), x=0.01, ha="left")
        first = "number: RMSE of measured − fitted / noise floor" + "; hatched: no samples" * empty
        most = _KEY_TIGHT if tight else _KEY_WIDE
        text = "\n".join(fill(line, most) for line in (first, *_KEY))
        figure.supxlabel(text, x=0.01, ha="left")
    return axes


def _map(stage: Stage, diagnosis: DiagnosisResult) -> ErrorMap:
    name = model_name(stage.effects, stage.base.others(diagnosis.stages[0].base))
    return ErrorMap(
        f"{fill(name, _TITLE)}\n{_p_value(stage.p_value)}", stage.cells,
        lambda cell: short(over_floor(cell.rmse, diagnosis.noise)),
        lambda cell: StructuredPhase(cell.test, cell.phase) in stage.failing,
    )  # fmt: skip


def _p_value(p: float) -> str:
    if p < 1e-4:
        return "adequacy p < 0.0001"
    return f"adequacy p = {p:.2f}" if p >= 0.1 else f"adequacy p = {p:.1g}"
