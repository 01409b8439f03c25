"""Draw force against displacement: the loops of every test, measured and predicted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.units import UnitSystem
from qlvbayes.motion.phases import MOVING, phase_index
from qlvbayes.plots.forces import model_of
from qlvbayes.plots.panels import (
    by_rate,
    draw_band,
    draw_samples,
    legend_entries,
    role_look,
    trial_name,
)
from qlvbayes.plots.style import DOUBLE, canvas, displacement_label, force_label, narrow, style

_PANEL, _FRAME = 48.0, 16.0  # mm: a row of panels, and the margins
_ACROSS, _ACROSS_TIGHT = 3, 2  # panels
_NAME, _NAME_TIGHT = 22, 14  # characters of a test's name
_BACK = ("unload", "recovery")  # phases that are drawn dashed


def plot_hysteresis(
    predictions: Sequence[Prediction], units: UnitSystem, *, width: float = DOUBLE
) -> list[Axes]:
    """Draw the measured and the predicted force of every test against displacement.

    Dots are measured samples. The line is the posterior mean, dashed in unloading; bands hold 90 %
    of predicted samples while the platen moves, with the fitted discrepancy.

    ``predictions`` are those of the tests, ``units`` those of displacement and force, ``width`` is
    in mm; returns a panel for each test, slowest first.
    """
    tight = narrow(width)
    shown = sorted(predictions, key=lambda p: by_rate(p.trial.rate))
    across = min(_ACROSS_TIGHT if tight else _ACROSS, max(len(shown), 1))
    rows = math.ceil(len(shown) / across)
    with style():
        figure = canvas(width, _PANEL * rows + _FRAME * (1.6 if tight else 1.0))
        axes = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
        for axis, prediction in zip(axes.flat, shown, strict=False):
            _draw(axis, prediction)
            name = trial_name(prediction.trial, units, _NAME_TIGHT if tight else _NAME)
            (role, weight), gap = role_look(prediction.trial.role), "\n" if tight else " "
            axis.set_title(f"{name},{gap}{role}", loc="left", weight=weight)
        for axis in axes.flat[len(shown) :]:
            axis.set_axis_off()
        for k, axis in enumerate(axes.flat[: len(shown)]):
            axis.locator_params(nbins=5)
            if k % across == 0:
                axis.set_ylabel(force_label(units))
            if k + across >= len(shown):
                axis.set_xlabel(displacement_label(units))
                axis.tick_params(labelbottom=True)
        look: dict[str, Any] = {"ncols": 2 if tight else 4, "markerscale": 2.0}
        figure.legend(*legend_entries(figure), loc="outside upper center", **look)
    return list(axes.flat[: len(shown)])


def _draw(axis: Axes, prediction: Prediction) -> None:
    """Draw a test phase by phase, each with the sample before it, so that curves have no gap."""
    trial, model = prediction.trial, model_of(prediction)
    way = np.interp(prediction.time, trial.test.time, trial.test.displacement)
    phase = phase_index(trial.phases, prediction.time)
    draw_samples(axis, way, prediction.observed, [])
    for k, one in enumerate(trial.phases):
        rows = np.flatnonzero(phase == k)
        if not rows.size:
            continue
        if one.kind in MOVING:
            draw_band(axis, way, model, rows[np.argsort(way[rows], kind="stable")])
        rows = np.concatenate([rows[:1] - 1, rows]) if rows[0] else rows
        line, name = ("--", "model, unloading") if one.kind in _BACK else ("-", "model, loading")
        axis.plot(way[rows], model.mean[rows], line, color=model.colour, label=name, gid="mean")
