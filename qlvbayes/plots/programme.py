"""Draw how a pad was pressed: displacement against time of every test."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from qlvbayes.diagnosis.phrases import pad_title
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import KINDS
from qlvbayes.plots.panels import slowest_first, trial_name
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    LINES,
    canvas,
    colours,
    displacement_label,
    narrow,
    shortened,
    style,
    titled_legend,
)
from qlvbayes.plots.timeline import decades, logarithmic, shown_samples, since_contact

_PANEL, _FRAME, _LINE = 48.0, 16.0, 3.6  # mm: a panel, the margins, a line of the legend
_SIGNS: dict[str, str] = dict(zip(KINDS, ("^", "s", "v", "o"), strict=True))
_NAME = 16  # characters of a test's name


def plot_programme(experiment: Experiment, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the displacement, as measured, of every test of a pad since its first movement.

    Where the loading rates span a decade there are two panels: logarithmic time, which shows every
    ramp, and linear time. ``experiment`` is the pad's, ``width`` in mm; returns the panels.
    """
    tight, trials = narrow(width), slowest_first(experiment.trials)
    scales = ["log", "linear"] if decades(trials) else ["linear"]
    with style():
        columns = 2 if tight else 4
        lines = -(-len(trials) // columns) + -(-len(_kinds(trials)) // columns) + 1
        rows = len(scales) if tight else 1
        height = _FRAME + _PANEL * rows + _LINE * lines
        figure = canvas(width, height)
        shape = (len(scales), 1) if tight else (1, len(scales))
        axes = figure.subplots(*shape, sharey=True, squeeze=False).ravel()
        for axis, scale in zip(axes, scales, strict=True):
            for k, trial in enumerate(trials):
                _draw(axis, trial, k)
            if scale == "log":
                logarithmic(axis, trials)
            axis.set_xlabel("time since the first movement (s)")
        for axis in axes if tight else axes[:1]:
            units = experiment.units
            axis.set_ylabel(displacement_label(units))
        _legend(figure, experiment, trials, columns)
    return list(axes)


def _draw(axis: Axes, trial: Trial, k: int) -> None:
    palette = colours()
    look: dict[str, Any] = {"color": palette[k % len(palette)], "linestyle": LINES[k % len(LINES)]}
    rows = shown_samples(trial)
    axis.plot(
        since_contact(trial, trial.whole.time[rows]), trial.whole.displacement[rows],
        gid=trial.name, **look,
    )  # fmt: skip
    for kind, sign in _SIGNS.items():
        starts = np.array([phase.start for phase in trial.phases if phase.kind == kind])
        axis.plot(
            since_contact(trial, starts), trial.trajectory.displacement(starts), sign,
            color=look["color"], markerfacecolor="white", markersize=3.6, markeredgewidth=0.7,
            gid=kind, zorder=3,
        )  # fmt: skip


def _kinds(trials: Sequence[Trial]) -> list[str]:
    present = {phase.kind for trial in trials for phase in trial.phases}
    return [kind for kind in KINDS if kind in present]


def _legend(figure: Figure, experiment: Experiment, trials: Sequence[Trial], columns: int) -> None:
    palette = colours()
    handles = [
        Line2D([], [], color=palette[k % len(palette)], linestyle=LINES[k % len(LINES)])
        for k in range(len(trials))
    ]
    labels = [trial_name(trial, experiment.units, _NAME) for trial in trials]
    for kind in _kinds(trials):
        handles.append(
            Line2D([], [], color=BLACK, marker=_SIGNS[kind], linestyle="None", markersize=3.6,
                   markerfacecolor="white", markeredgewidth=0.7)
        )  # fmt: skip
        labels.append(f"{kind} begins")
    title = f"{pad_title(shortened(experiment.pad))}: displacement programme"
    titled_legend(figure, title, handles, labels, ncols=columns)
