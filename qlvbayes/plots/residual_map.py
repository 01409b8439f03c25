"""Draw where a model fails, tests against phases, also before and after effects are added."""

from __future__ import annotations

from math import floor, log10
from textwrap import fill

from matplotlib.axes import Axes

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.diagnosis.result import DiagnosisResult, Stage
from qlvbayes.fitting.residuals import Cell, CheckResult
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import pad_title
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
from qlvbayes.plots.panels import role_look
from qlvbayes.plots.style import DOUBLE, MIDDLE, narrow, quantity, shortened, style

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
    tight, tests = narrow(width), tests_by_rate(check.cells).values()
    row, frame = (_ROW_TIGHT, _FRAME + _BAR) if tight else (_ROW, _FRAME)
    most, gap = (_NAME_TIGHT, "\n") if tight else (_NAME, ", ")
    roles = [role_look(cell.role) for cell in tests]
    rows = [
        row_label(cell, units, most, role, gap=gap)
        for cell, (role, _) in zip(tests, roles, strict=True)
    ]
    one = ErrorMap(
        pad_title(shortened(check.pad)), check.cells, lambda c: _text(c, check.noise),
        lambda c: c.fails,
    )  # fmt: skip
    with style():
        (axis,), empty = draw_maps(
            [one], check.noise, units, width=width,
            height=frame + row * max(len(tests), LEAST_ROWS), rows=rows, kinds=KINDS,
        )  # fmt: skip
        axis.title.set_fontweight("bold")
        for tick, (_, weight) in zip(axis.get_yticklabels(), roles, strict=True):
            tick.set_fontweight(weight)
        lines = [
            "upper number: RMSE / noise floor",
            f"lower number: {quantity('bias, measured − predicted', units.force)}",
            f"frame and cross: fails,{chr(10) if tight else ' '}error beyond noise, zero and "
            "the spread of the posterior",
        ]
        if any(cell.fails and over_floor(cell, check.noise) < 1.0 for cell in check.cells):
            lines.append(
                "a cell below 1 may fail: the mean of many readings has less noise than one"
            )
        lines += ["hatched: no samples"] if empty else []
        figure_of(axis).supxlabel("\n".join(lines), x=0.01, ha="left")
    return axis


def _text(cell: Cell, noise: float) -> str:
    """Return a cell's error over the noise floor, and below it its bias."""
    digits = max(0, 1 - floor(log10(max(cell.rmse, noise) or 1.0)))
    text = f"{cell.bias:+.{digits}f}" if digits < 6 else f"{cell.bias:+.1e}"
    text = text.replace("-", "+") if float(text) == 0.0 else text
    return f"{short(over_floor(cell, noise))}\n{text.replace('-', chr(0x2212))}"


_PAIR_ROW, _PAIR_FRAME = 8.0, 45.0  # mm: a row of cells and the margins
_PAIR_NAME = 24  # characters of a test's name
_TITLE = 40  # characters a line, of a panel's title
_KEY_WIDE, _KEY_TIGHT = 120, 58  # characters a line, of the key
_KEY = "adequacy p: probability that noise alone would look as systematic"


def plot_residuals_before_after(diagnosis: DiagnosisResult, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the error of each test in each phase, by the baseline model and by the last model.

    Both models are fitted to all tests. Colour and number are the root mean square of measured
    minus fitted force over the noise floor, on one scale for both; which phases fail is said by the
    check of a fit. Where no effect was added there is one panel. ``diagnosis`` is the diagnosis's
    result, ``width`` in mm; returns the maps' axes.
    """
    tight, noise, units = narrow(width), diagnosis.noise, diagnosis.units
    stages = diagnosis.stages[:: max(len(diagnosis.stages) - 1, 1)]
    tests = tests_by_rate(stages[0].cells)
    kinds = [kind for kind in KINDS if any(c.phase == kind for c in stages[0].cells)]
    height = _PAIR_FRAME + _PAIR_ROW * max(len(tests), LEAST_ROWS)
    height += ((height - _PAIR_FRAME / 2) * (len(stages) - 1) + 12.0) * tight
    with style():
        axes, empty = draw_maps(
            [_map(stage, diagnosis) for stage in stages], noise, units, width=width,
            height=height, kinds=kinds,
            rows=[row_label(test, units, _PAIR_NAME) for test in tests.values()],
        )  # fmt: skip
        figure = figure_of(axes)
        figure.suptitle(heading(diagnosis, tight=tight), x=0.01, ha="left")
        first = "number: RMSE of measured − fitted / noise floor" + "; hatched: no samples" * empty
        most = _KEY_TIGHT if tight else _KEY_WIDE
        text = "\n".join(fill(line, most) for line in (first, _KEY))
        figure.supxlabel(text, x=0.01, ha="left")
    return axes


def _map(stage: Stage, diagnosis: DiagnosisResult) -> ErrorMap:
    name = model_name(stage.effects, stage.base.others(diagnosis.stages[0].base))
    return ErrorMap(
        f"{fill(name, _TITLE)}\n{_p_value(stage.p_value)}", stage.cells,
        lambda cell: short(over_floor(cell, diagnosis.noise)),
    )  # fmt: skip


def _p_value(p: float) -> str:
    if p < 1e-4:
        return "adequacy p < 0.0001"
    return f"adequacy p = {p:.2f}" if p >= 0.1 else f"adequacy p = {p:.1g}"
