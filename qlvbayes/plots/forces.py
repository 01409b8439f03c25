"""Draw the force of every test against time, measured and predicted, and what is left."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.units import UnitSystem
from qlvbayes.motion.experiment import Trial
from qlvbayes.plots.panels import (
    Model,
    PhaseTime,
    Sheet,
    by_rate,
    draw_samples,
    legend_entries,
    mark_left_out,
    role_look,
    trial_name,
)
from qlvbayes.plots.style import DOUBLE, colours, force_label, narrow, style

_HEIGHT = 26.0  # mm, a panel of force
_NAME, _NAME_TIGHT = 40, 20  # characters of a test's name


def plot_forces(
    predictions: Sequence[Prediction], units: UnitSystem, *, width: float = DOUBLE
) -> list[Axes]:
    """Draw the measured force of every test against what the posterior predicts.

    There is one panel for each test, slowest first, with its phases side by side. Dots are measured
    samples, the line is the model's posterior mean, and the band holds 90 % of predicted samples:
    it includes the fitted discrepancy, so that it may lie off the line.

    ``predictions`` are those of the tests, ``units`` those of displacement and force, ``width`` is
    in mm; returns the panels.
    """
    tight = narrow(width)
    shown = sorted(predictions, key=lambda one: by_rate(one.trial.rate))
    with style():
        sheet = Sheet.of(width, len(shown), [_HEIGHT], head=10.0 if tight else 5.0)
        for panels, one in zip(sheet.blocks, shown, strict=True):
            time = PhaseTime.of(one.trial, sheet.wide)
            draw_samples(panels[0], time(one.time), one.observed, [model_of(one)])
            finish(sheet, panels, one.trial, time, [force_label(units)])
            name = trial_name(one.trial, units, _NAME_TIGHT if tight else _NAME)
            role, weight = role_look(one.trial.role)
            panels[0].set_title(f"{name}, {role}", loc="left", pad=10.0, weight=weight)
        figure, most = sheet.figure, 2 if tight else 4
        handles = legend_entries(figure)
        figure.legend(*handles, ncols=most, loc="upper center", borderaxespad=0.3, markerscale=2.0)
    return [panels[0] for panels in sheet.blocks]


def model_of(prediction: Prediction) -> Model:
    """Return a prediction as it is drawn, in the model's colour."""
    return Model(prediction.mean, prediction.low, prediction.high, colours()[0])


def finish(
    sheet: Sheet, panels: Sequence[Axes], trial: Trial, time: PhaseTime, quantities: Sequence[str]
) -> None:
    """Mark the phases of a test, its readings left out, and what each panel shows."""
    bad = trial.left_out
    if bad is not None:
        rows = bad.drawn
        panels[0].set_ylim(*panels[0].get_ylim())  # a cross at the edge would widen it
        mark_left_out(panels[0], time(bad.time[rows]), bad.force[rows])
    for axis, text in zip(panels, quantities, strict=True):
        axis.set_ylim(*axis.get_ylim())
        axis.yaxis.set_major_locator(MaxNLocator(4 if axis is panels[0] else 3))
        time.mark(axis, sheet.wide, last=axis is panels[-1])
        sheet.label(axis, text)
    time.name_phases(panels[0], sheet.wide)
