"""Force against time, test by test and phase by phase: measured and predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from qlvbayes.plots.stretches import (
    RESTS,
    WHOLE,
    Placed,
    Stretch,
    by_rate,
    columns,
    divide,
    finish_time,
    place,
    same_times,
    widths,
)
from qlvbayes.plots.style import BLACK, COLOURS, DOUBLE, MM, quantity, rated, shortened, style
from qlvbayes.predict import Prediction
from qlvbayes.units import UnitSystem

_ROW, _FRAME = 33.0, 14.0  # mm, a row of panels and the legend


def plot_forces(predictions: Sequence[Prediction], units: UnitSystem) -> Figure:
    """Draw what was measured in every test against what the posterior predicts.

    One row a test, slowest first, named with its loading rate and whether it was fitted or
    predicted; one column a kind of phase. Ramps and unloads run in linear time since they began,
    holds and recoveries in logarithmic time, so that milliseconds and half a minute are both seen.
    Dots are measured samples, the line is the posterior mean, the band holds 90 % of predicted
    samples. The panels of a row share their force axis.

    Where phases of a kind repeat, as in a staircase, a first wide panel shows the whole test, and
    the repeats lie over each other, numbered, in the colour that they have in the whole test. A
    rest before the first ramp is shown with that ramp, up to a tenth of its length.
    """
    with style():
        shown = sorted(predictions, key=lambda p: by_rate(p.trial.rate))
        parts = [divide(p.time, p.trial.phases) for p in shown]
        names = columns(parts)
        figure, axes = _panels(len(shown), names)
        for row, prediction, stretches in zip(axes, shown, parts, strict=True):
            for axis, column in zip(row, names, strict=True):
                _draw(axis, column, prediction, stretches)
            _label_row(row, prediction, units)
        _finish(figure, axes, names)
        _legend(figure, axes)
    return figure


def _panels(count: int, names: Sequence[str]) -> tuple[Figure, np.ndarray]:
    figure = Figure((DOUBLE * MM, (_FRAME + _ROW * count) * MM), layout="constrained")
    axes = figure.subplots(
        count, len(names), sharey="row", squeeze=False, width_ratios=widths(names)
    )
    return figure, axes


def _draw(axis: Axes, column: str, prediction: Prediction, stretches: Sequence[Stretch]) -> None:
    shown = place(column, prediction.time, stretches)
    for placed in shown:
        colour = COLOURS[placed.stretch.number % len(COLOURS)]
        _lines(axis, placed.time, prediction, placed.rows, colour)
        if column != WHOLE and len(shown) > 1:
            _number(axis, placed, prediction.mean[placed.rows[-1]], colour)
    finish_time(axis, column, stretches)


def _number(axis: Axes, placed: Placed, force: float, colour: str) -> None:
    axis.annotate(
        f"{placed.stretch.number + 1}",
        (placed.time[-1], force),
        xytext=(2, 0),
        textcoords="offset points",
        va="center",
        fontsize=6,
        color=colour,
        annotation_clip=False,
    )


def _lines(
    axis: Axes, time: np.ndarray, prediction: Prediction, rows: np.ndarray, colour: str
) -> None:
    low, high = prediction.low[rows], prediction.high[rows]
    dots = BLACK if colour == COLOURS[0] else colour
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
    axis.plot(time, prediction.mean[rows], color=colour, label="posterior mean")


def _label_row(row: np.ndarray, prediction: Prediction, units: UnitSystem) -> None:
    """Left above the row: test, rate, and fitted (bold) or predicted."""
    trial = prediction.trial
    fitted = trial.role == "fit"
    speed = [rated(trial.rate, units.speed)] if np.isfinite(trial.rate) else []
    label = ", ".join([shortened(trial.name), *speed, "fitted" if fitted else "predicted"])
    row[0].set_title(label, loc="left", weight="bold" if fitted else "normal")
    row[0].set_ylabel(quantity(units.force_name, units.force))


def _finish(figure: Figure, axes: np.ndarray, names: Sequence[str]) -> None:
    for column, name in zip(axes.T, names, strict=True):
        column[0].set_title(f"{name}\n", weight="bold")  # the second line is the row's
        if name in RESTS:
            same_times(column)
    for axis in axes[:, 0]:
        axis.yaxis.set_major_locator(MaxNLocator(4))
    figure.align_ylabels(axes[:, 0])


def _legend(figure: Figure, axes: np.ndarray) -> None:
    used = next(axis for axis in axes.flat if axis.lines)
    handles, labels = used.get_legend_handles_labels()
    figure.legend(handles[:3], labels[:3], loc="outside upper center", ncols=3, markerscale=2.0)
