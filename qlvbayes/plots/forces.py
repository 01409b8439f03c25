"""Draw force against time, test by test and phase by phase: measured and predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.units import UnitSystem
from qlvbayes.plots.panels import (
    LABEL,
    finish_columns,
    lay_out_panels,
    leaders,
    lines_of,
    mark_left_out,
    name_row,
)
from qlvbayes.plots.phases import (
    WHOLE,
    PhaseSamples,
    by_rate,
    columns,
    divide,
    finish_time,
    number_repeats,
    panel_samples,
    role_look,
    trial_name,
)
from qlvbayes.plots.style import BLACK, DOUBLE, canvas, colours, force_label, narrow, style

_ROW, _FRAME = 33.0, 14.0  # mm, a row of panels and the legend
_NAME, _NAME_TIGHT = 40, 20  # characters of a test's name
_SECOND_LINE = 3.5  # mm, second line of labels and of the legend in one column


def plot_forces(
    predictions: Sequence[Prediction], units: UnitSystem, *, width: float = DOUBLE
) -> list[Axes]:
    """Draw the measured force of every test against what the posterior predicts.

    There is one row for each test, slowest first, named with its loading rate and whether it was
    fitted or predicted, and one column for each kind of phase. Ramps and unloads are in linear time
    since they began, holds and recoveries in logarithmic time, so that milliseconds and half a
    minute are both visible. Dots are measured samples, the line is the model's posterior mean, and
    the band holds 90 % of predicted samples. The band includes the fitted discrepancy, so that it
    may lie off the line. Grey crosses are readings that were left out. The panels of a row share
    their force axis.

    Where phases of a kind repeat, as in a staircase, a first wide panel shows the whole test. The
    repeats lie over each other, numbered, in the colour that they have in the whole test. A dwell
    before the first ramp is shown with that ramp, up to a tenth of its length.

    Parameters
    ----------
    predictions
        The predictions of the tests.
    units
        The units of displacement and force.
    width
        Width of the figure (mm).

    Returns
    -------
    list of Axes
        The panels, row by row.
    """
    tight = narrow(width)
    with style():
        shown = sorted(predictions, key=lambda p: by_rate(p.trial.rate))
        parts = [divide(p.time, p.trial.phases) for p in shown]
        names = columns(parts)
        row = (_ROW + tight * _SECOND_LINE) * lines_of(names, tight)
        height = _FRAME + tight * _SECOND_LINE + row * len(shown)
        figure = canvas(width, height)
        axes = lay_out_panels(figure, len(shown), names, [1.0], tight=tight)
        for panels, prediction, stretches in zip(axes[:, 0], shown, parts, strict=True):
            for axis, column in zip(panels, names, strict=True):
                _draw(axis, column, prediction, stretches, tight=tight)
            mark_left_out(panels, names, prediction.trial, stretches)
            for k in leaders(names, tight):
                panels[k].set_ylabel(force_label(units))
            _label_row(panels, prediction, units, tight=tight)
        finish_columns(figure, axes, names, leaders(names, tight))
        for axis in axes[:, 0, leaders(names, tight)].flat:
            axis.yaxis.set_major_locator(MaxNLocator(4))
        _legend(figure, axes, tight=tight)
    return list(axes.flat)


def _draw(
    axis: Axes,
    column: str,
    prediction: Prediction,
    stretches: Sequence[PhaseSamples],
    *,
    tight: bool,
) -> None:
    shown, palette = panel_samples(column, prediction.time, stretches), colours()
    for placed in shown:
        colour = palette[placed.part.number % len(palette)]
        _lines(axis, placed.time, prediction, placed.rows, colour)
    if column != WHOLE and len(shown) > 1:
        number_repeats(axis, shown, prediction.mean, palette, fontsize=6.0)
    finish_time(axis, column, stretches, tight=tight)


def _lines(
    axis: Axes, time: np.ndarray, prediction: Prediction, rows: np.ndarray, colour: str
) -> None:
    low, high = prediction.low[rows], prediction.high[rows]
    dots = BLACK if colour == colours()[0] else colour
    axis.fill_between(
        time, low, high, color=colour, alpha=0.3, linewidth=0, label="90 % predictive band"
    )
    axis.plot(
        time,
        prediction.observed[rows],
        ".",
        color=dots,
        markersize=2.6,
        markeredgewidth=0,
        label="measured",
    )
    axis.plot(time, prediction.mean[rows], color=colour, label="model's posterior mean")


def _label_row(row: np.ndarray, prediction: Prediction, units: UnitSystem, *, tight: bool) -> None:
    """Write test, rate, and fitted (bold) or predicted above the row, at the left."""
    name = trial_name(prediction.trial, units, _NAME_TIGHT if tight else _NAME)
    role, weight = role_look(prediction.trial.role)
    name_row(row, f"{name}, {role}", tight=tight, weight=weight)


def _legend(figure: Figure, axes: np.ndarray, *, tight: bool) -> None:
    used = next(axis for axis in axes.flat if axis.lines)
    entries = list(zip(*used.get_legend_handles_labels(), strict=True))[:3]
    crosses = (line for axis in axes.flat for line in axis.lines if line.get_label() == LABEL)
    entries += [(line, LABEL) for line in list(crosses)[:1]]
    handles, labels = zip(*entries, strict=True)
    columns = 2 if tight else len(entries)
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, markerscale=2.0)
