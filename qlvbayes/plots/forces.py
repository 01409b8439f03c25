"""Draw force against time, test by test and phase by phase: measured and predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.units import UnitSystem
from qlvbayes.plots.panels import LABEL, PhasePanels
from qlvbayes.plots.phases import PanelSamples, role_look, trial_name
from qlvbayes.plots.style import BLACK, DOUBLE, colours, force_label, narrow, style

_ROW, _FRAME = 33.0, 14.0  # mm, a row of panels and the legend
_NAME, _NAME_TIGHT = 40, 20  # characters of a test's name
_SECOND_LINE = 3.5  # mm, second line of labels and of the legend in one column


def plot_forces(
    predictions: Sequence[Prediction], units: UnitSystem, *, width: float = DOUBLE
) -> list[Axes]:
    """Draw the measured force of every test against what the posterior predicts.

    There is one row for each test, slowest first, and one column for each kind of phase; where
    phases of a kind repeat, a first wide panel shows the whole test. Dots are measured samples, the
    line is the model's posterior mean, and the band holds 90 % of predicted samples: it includes
    the fitted discrepancy, so that it may lie off the line.

    ``predictions`` are those of the tests, ``units`` those of displacement and force, ``width`` is
    in mm; returns the panels, row by row.
    """
    tight = narrow(width)
    with style():
        extra = tight * _SECOND_LINE
        page = PhasePanels.for_tests(predictions, width, frame=_FRAME + extra, row=_ROW + extra)
        for row in page.rows:
            row.paint(_draw, row.test.mean, colours(), fontsize=6.0)
            name = trial_name(row.test.trial, units, _NAME_TIGHT if tight else _NAME)
            role, weight = role_look(row.test.trial.role)
            row.label(f"{name}, {role}", [force_label(units)], weight=weight)
        page.finish([4])
        _legend(page.figure, page.axes, tight=tight)
    return list(page.axes.flat)


def _draw(panels: np.ndarray, samples: PanelSamples, prediction: Prediction) -> None:
    (axis,), time, rows = panels, samples.time, samples.rows
    low, high = prediction.low[rows], prediction.high[rows]
    palette = colours()
    colour = palette[samples.part.number % len(palette)]
    dots = BLACK if colour == palette[0] else colour
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


def _legend(figure: Figure, axes: np.ndarray, *, tight: bool) -> None:
    used = next(axis for axis in axes.flat if axis.lines)
    entries = list(zip(*used.get_legend_handles_labels(), strict=True))[:3]
    crosses = (line for axis in axes.flat for line in axis.lines if line.get_label() == LABEL)
    entries += [(line, LABEL) for line in list(crosses)[:1]]
    handles, labels = zip(*entries, strict=True)
    columns = 2 if tight else len(entries)
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, markerscale=2.0)
