"""Draw force against displacement: the loops of every test, measured and predicted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.units import UnitSystem
from qlvbayes.plots.phases import DWELLS, PhaseSamples, by_rate, divide, role_look, trial_name
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    LINES,
    canvas,
    colours,
    displacement_label,
    force_label,
    narrow,
    style,
)

_PANEL, _FRAME = 48.0, 16.0  # mm: a row of panels, and the margins
_ACROSS, _ACROSS_TIGHT = 3, 2  # panels
_NAME, _NAME_TIGHT = 22, 14  # characters of a test's name
_BACK = ("unload", "recovery")  # phases that are drawn as unloading


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
        frame = _FRAME * (1.6 if tight else 1.0)
        figure = canvas(width, _PANEL * rows + frame)
        axes = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
        for axis, prediction in zip(axes.flat, shown, strict=False):
            _draw(axis, prediction)
            name = trial_name(prediction.trial, units, _NAME_TIGHT if tight else _NAME)
            (role, weight), gap = role_look(prediction.trial.role), "\n" if tight else " "
            axis.set_title(f"{name},{gap}{role}", loc="left", weight=weight)
        for axis in axes.flat[len(shown) :]:
            axis.set_axis_off()
        _label(axes, len(shown), units)
        _legend(figure, columns=2 if tight else 4)
    return list(axes.flat[: len(shown)])


def _draw(axis: Axes, prediction: Prediction) -> None:
    test = prediction.trial.test
    displacement = np.interp(prediction.time, test.time, test.displacement)
    axis.plot(
        displacement, prediction.observed, ".", color=BLACK, markersize=2.2, markeredgewidth=0,
        gid="measured",
    )  # fmt: skip
    last = None
    for part in divide(prediction.time, prediction.trial.phases):
        colour, line = _look(part.kind)
        rows = part.rows if last is None else np.r_[last, part.rows]
        if part.kind not in DWELLS:
            _band(axis, displacement, prediction, part, colour)
        axis.plot(displacement[rows], prediction.mean[rows], line, color=colour, gid="mean")
        last = rows[-1]


def _band(
    axis: Axes, displacement: np.ndarray, prediction: Prediction, part: PhaseSamples, colour: str
) -> None:
    rows = part.rows[np.argsort(displacement[part.rows], kind="stable")]
    axis.fill_between(
        displacement[rows], prediction.low[rows], prediction.high[rows],
        color=colour, alpha=0.3, linewidth=0,
    )  # fmt: skip


def _look(kind: str) -> tuple[str, str]:
    """Return colour and line of a phase, for loading or unloading."""
    back = kind in _BACK
    return colours()[back], LINES[back]


def _label(axes: np.ndarray, count: int, units: UnitSystem) -> None:
    across = axes.shape[1]
    for k, axis in enumerate(axes.flat[:count]):
        axis.xaxis.set_major_locator(MaxNLocator(5))
        axis.yaxis.set_major_locator(MaxNLocator(5))
        if k % across == 0:
            axis.set_ylabel(force_label(units))
        if k + across >= count:
            axis.set_xlabel(displacement_label(units))
            axis.tick_params(labelbottom=True)


def _legend(figure: Figure, columns: int) -> None:
    dot: dict[str, Any] = {"marker": ".", "color": BLACK, "linestyle": "None", "markeredgewidth": 0}
    ways = [Line2D([], [], color=colours()[k], linestyle=LINES[k]) for k in (False, True)]
    figure.legend(
        [Line2D([], [], markersize=5.0, **dot), *ways, Patch(color="0.6", alpha=0.4, linewidth=0)],
        ["measured", "model, loading", "model, unloading", "90 % predictive band"],
        loc="outside upper center", ncols=columns,
    )  # fmt: skip
