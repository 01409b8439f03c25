"""Draw where a model fails, tests against phases, also before and after effects are added."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, log, log10
from textwrap import fill
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.diagnosis.result import CellError, DiagnosisResult, Stage
from qlvbayes.fitting.residuals import Cell, CheckResult, over_floor
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import pad_title, plain, rated
from qlvbayes.motion.phases import KINDS
from qlvbayes.plots.files import figure_of
from qlvbayes.plots.naming import heading
from qlvbayes.plots.panels import role_look
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    MIDDLE,
    canvas,
    narrow,
    quantity,
    shortened,
    style,
)

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
    tight, tests = narrow(width), _tests_by_rate(check.cells).values()
    row, frame = (_ROW_TIGHT, _FRAME + _BAR) if tight else (_ROW, _FRAME)
    most, gap = (_NAME_TIGHT, "\n") if tight else (_NAME, ", ")
    roles = [role_look(cell.role) for cell in tests]
    rows = [
        _row_label(cell, units, most, role, gap=gap)
        for cell, (role, _) in zip(tests, roles, strict=True)
    ]
    one = _ErrorMap(
        pad_title(shortened(check.pad)), check.cells, lambda c: _cell_text(c, check.noise),
        lambda c: c.fails,
    )  # fmt: skip
    with style():
        (axis,), empty = _draw_maps(
            [one], check.noise, units, width=width,
            height=frame + row * max(len(tests), _LEAST_ROWS), rows=rows, kinds=KINDS,
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


def _cell_text(cell: Cell, noise: float) -> str:
    """Return a cell's error over the noise floor, and below it its bias."""
    digits = max(0, 1 - floor(log10(max(cell.rmse, noise) or 1.0)))
    text = f"{cell.bias:+.{digits}f}" if digits < 6 else f"{cell.bias:+.1e}"
    text = text.replace("-", "+") if float(text) == 0.0 else text
    return f"{_short(over_floor(cell, noise))}\n{text.replace('-', chr(0x2212))}"


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
    tests = _tests_by_rate(stages[0].cells)
    kinds = [kind for kind in KINDS if any(c.phase == kind for c in stages[0].cells)]
    height = _PAIR_FRAME + _PAIR_ROW * max(len(tests), _LEAST_ROWS)
    height += ((height - _PAIR_FRAME / 2) * (len(stages) - 1) + 12.0) * tight
    with style():
        axes, empty = _draw_maps(
            [_map(stage, diagnosis) for stage in stages], noise, units, width=width,
            height=height, kinds=kinds,
            rows=[_row_label(test, units, _PAIR_NAME) for test in tests.values()],
        )  # fmt: skip
        figure = figure_of(axes)
        figure.suptitle(heading(diagnosis, tight=tight), x=0.01, ha="left")
        first = "number: RMSE of measured − fitted / noise floor" + "; hatched: no samples" * empty
        most = _KEY_TIGHT if tight else _KEY_WIDE
        text = "\n".join(fill(line, most) for line in (first, _KEY))
        figure.supxlabel(text, x=0.01, ha="left")
    return axes


def _map(stage: Stage, diagnosis: DiagnosisResult) -> _ErrorMap:
    name = model_name(stage.effects, stage.base.others(diagnosis.stages[0].base))
    return _ErrorMap(
        f"{fill(name, _TITLE)}\n{_p_value(stage.p_value)}", stage.cells,
        lambda cell: _short(over_floor(cell, diagnosis.noise)),
    )  # fmt: skip


def _p_value(p: float) -> str:
    if p < 1e-4:
        return "adequacy p < 0.0001"
    return f"adequacy p = {p:.2f}" if p >= 0.1 else f"adequacy p = {p:.1g}"


_LEAST_ROWS = 3  # rows for which the colour bar's label fits
_WIDE = 50.0  # worst ratio beyond which the colour bar shows powers of ten only
# darker is worse, in grey too; the report's page has the same colours
_COLOURS = LinearSegmentedColormap.from_list("error", ["#f1f4f7", "#f3c46a", "#d98200", "#7a3d00"])
_DARK = 0.72  # share of the colour scale beyond which text is white

_Cell = TypeVar("_Cell", Cell, CellError)


def _tests_by_rate(cells: Iterable[_Cell]) -> dict[str, _Cell]:
    """Return one cell of each test, slowest first, tests without a rate last."""
    ordered = sorted(cells, key=lambda cell: inf if cell.rate is None else cell.rate)
    return {cell.test: cell for cell in ordered}


def _row_label(
    cell: Cell | CellError, units: UnitSystem, most: int, *more: str, gap: str = ", "
) -> str:
    """Return a test's name, in ``most`` characters at most, and below it its rate and ``more``."""
    below = [*([] if cell.rate is None else [rated(cell.rate, units.speed)]), *more]
    name = shortened(cell.test, most)
    return f"{name}\n{gap.join(below)}" if below else name


def _short(ratio: float) -> str:
    """Return a ratio in three digits, or with all digits before the point."""
    digits = 2 if ratio < 9.995 else 1 if ratio < 99.95 else 0
    return f"{ratio:.{digits}f}"


@dataclass(frozen=True)
class _ErrorMap:
    """The errors of one model, what stands in each cell, and which cells fail."""

    title: str
    cells: Sequence[Any]  # each a `Cell` or a `CellError`
    text: Callable[[Any], str]
    fails: Callable[[Any], bool] = lambda cell: False


def _draw_maps(
    maps: Sequence[_ErrorMap], noise: float, units: UnitSystem, *, width: float, height: float,
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
    tests = list(_tests_by_rate(maps[0].cells))
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
    axis: Axes, one: _ErrorMap, noise: float, worst: float, tests: list[str], kinds: Sequence[str]
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
