"""Draw tests that were not made: a user's programme, and proposed ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import Readings
from qlvbayes.diagnosis.nexttest.planning import NextTests, Proposed
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    LINES,
    canvas,
    colours,
    displacement_label,
    force_label,
    narrow,
    shortened,
    style,
)
from qlvbayes.use.prescribed.forecast import Forecast

_PANEL, _FRAME = 42.0, 16.0  # mm: a row of panels, and the margins
_BANDS = ((0.9, 0.25), (0.5, 0.5))  # share of the draws, opacity
_DECADES = 30.0  # ratio of whole to first stretch beyond which time is logarithmic too
_TITLE, _TITLE_TIGHT = 110, 48  # characters of a programme


def plot_prediction(forecast: Forecast, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the prescribed quantity above, and below it the response: median, 50 and 90 % band.

    Where a programme's first stretch is a thirtieth of it or less, a second column in logarithmic
    time shows it. ``forecast`` is that of ``predict_program``, ``width`` in mm; returns the panels.
    """
    tight = narrow(width)
    with style():
        quick = _DECADES * _first(forecast) <= forecast.time[-1] - forecast.time[0]
        scales = ["linear", "log"] if quick and not tight else ["linear"]
        figure = canvas(width, 2.0 * _PANEL + _FRAME)
        axes = figure.subplots(2, len(scales), sharex="col", sharey="row", squeeze=False)
        for column, scale in zip(axes.T, scales, strict=True):
            _draw(column, forecast, scale)
        units, moved = forecast.units, forecast.program.quantity == "displacement"
        labels = [displacement_label(units), force_label(units)]
        for axis, label in zip(axes[:, 0], labels if moved else labels[::-1], strict=True):
            axis.set_ylabel(label)
            axis.yaxis.set_major_locator(MaxNLocator(4))
        figure.align_ylabels(axes[:, 0])
        most = _TITLE_TIGHT if tight else _TITLE
        figure.suptitle(shortened(f"{forecast.pad}: {forecast.program.title}", most))
        handles, names = axes[1, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=3)
    return list(axes.flat)


def _draw(column: np.ndarray, forecast: Forecast, scale: str) -> None:
    above, below = column
    colour, time = colours()[0], forecast.time - forecast.time[0]
    above.plot(time, forecast.given, color=BLACK)
    for share, opacity in _BANDS:
        low, high = forecast.band(share)
        below.fill_between(
            time,
            low,
            high,
            color=colour,
            alpha=opacity,
            linewidth=0,
            label=f"{100 * share:.0f} % band",
        )
    below.plot(time, forecast.median, color=colour, label="posterior median")
    below.set_xlabel("time (s)")
    if scale == "log":
        below.set_xscale("log")
        below.set_xlim(left=0.1 * _first(forecast))
        below.xaxis.set_major_locator(LogLocator(numticks=6))
        below.xaxis.set_minor_formatter(NullFormatter())


def _first(forecast: Forecast) -> float:
    """Return the time (s) until the slope of the prescribed quantity first changes."""
    slopes = np.diff(forecast.given) / np.maximum(np.diff(forecast.time), 1e-300)
    change = np.abs(np.diff(slopes)) > 1e-3 * np.max(np.abs(slopes))
    ends = np.flatnonzero(change)
    last = int(ends[0]) + 1 if ends.size else forecast.time.size - 1
    return float(forecast.time[last] - forecast.time[0])


_TEST_PANEL, _TEST_FRAME = 34.0, 22.0  # mm: a row of panels, and the margins
_DRAWS = 60  # draws of the constants from which a band is taken
_BAND = 0.9  # share of the draws within it
_NAME = 60  # characters of an explanation


def plot_next_tests(
    design_result: NextTests,
    belief: Belief,
    readings: Readings,
    *,
    width: float = DOUBLE,
) -> list[Axes]:
    """Draw a column for each test: displacement, force, and force less the best explanation's.

    Bands hold 90 % of the forces that the constants allow; the grey band is one sd of the noise.

    Parameters
    ----------
    design_result, belief, readings
        The proposed tests, the explanations with their probabilities, and how a test is read.
    width
        Width of the figure (mm); in one column of a journal only the first test is drawn.

    Returns
    -------
    list of Axes
        The panels, row by row.
    """
    shown = design_result.tests[:1] if narrow(width) else design_result.tests
    with style():
        figure = canvas(width, 3.0 * _TEST_PANEL + _TEST_FRAME)
        axes = figure.subplots(3, len(shown), sharex="col", sharey="row", squeeze=False)
        for column, test in zip(axes.T, shown, strict=True):
            _draw_test(column, test, belief, readings)
            column[0].set_title(shortened(test.name))
            readings = replace(readings, clock=readings.clock + test.wait + test.duration)
        units = design_result.units
        force = force_label(units)
        labels = [displacement_label(units), force, f"less the likeliest\n{force}"]
        for axis, label in zip(axes[:, 0], labels, strict=True):
            axis.set_ylabel(label)
            axis.yaxis.set_major_locator(MaxNLocator(4))
        figure.align_ylabels(axes[:, 0])
        figure.suptitle(f"{shortened(design_result.pad)}: the next tests")
        handles, names = axes[2, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=1 if narrow(width) else 2)
    return list(axes.flat)


def _draw_test(column: np.ndarray, test: Proposed, belief: Belief, readings: Readings) -> None:
    above, force, less = column
    record = readings.record([test])
    blocks = record.blocks
    real = np.asarray(blocks.real)[0]
    time = (0.5 * (np.asarray(blocks.first) + np.asarray(blocks.last)))[0, real]
    path = test.trajectory
    fine = np.union1d(np.linspace(0.0, test.duration, 400), path.knots)
    above.plot(fine, path.displacement(fine), color=BLACK)
    rng, baseline = np.random.default_rng(0), None
    for k, explanation in enumerate(belief.explanations):
        colour, line = colours()[k % len(colours())], LINES[k % len(LINES)]
        z = np.concatenate(
            [np.zeros((1, explanation.size)), rng.standard_normal((_DRAWS, explanation.size))]
        )
        forces = explanation.forces(z, record)[:, 0, real]
        baseline = forces[0] if baseline is None else baseline
        low, high = np.quantile(forces[1:], [0.5 - 0.5 * _BAND, 0.5 + 0.5 * _BAND], axis=0)
        label = f"{shortened(explanation.words, _NAME)} ({explanation.probability:.0%})"
        for axis, zero in ((force, 0.0), (less, baseline)):
            axis.fill_between(time, low - zero, high - zero, color=colour, alpha=0.25, linewidth=0)
            axis.plot(time, forces[0] - zero, color=colour, linestyle=line, label=label)
    noise, label = readings.floor.total, "one sd of a reading's noise"
    less.axhspan(-noise, noise, color=BLACK, alpha=0.1, linewidth=0, label=label)
    less.set_xlabel("time (s)")
