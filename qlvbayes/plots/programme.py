"""Draw how a pad was pressed: displacement against time of every test."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from qlvbayes.io.wording import pad_title
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import KINDS
from qlvbayes.plots.panels import by_rate, legend_entries, trial_name
from qlvbayes.plots.style import (
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
    tight, trials = narrow(width), sorted(experiment.trials, key=lambda t: by_rate(t.rate))
    scales = ["log", "linear"] if decades(trials) else ["linear"]
    with style():
        columns = 2 if tight else 4
        lines = -(-(len(trials) + len(_SIGNS)) // columns) + 2
        rows = len(scales) if tight else 1
        height = _FRAME + _PANEL * rows + _LINE * lines
        figure = canvas(width, height)
        shape = (len(scales), 1) if tight else (1, len(scales))
        axes = figure.subplots(*shape, sharey=True, squeeze=False).ravel()
        for axis, scale in zip(axes, scales, strict=True):
            for k, trial in enumerate(trials):
                _draw(axis, trial, trial_name(trial, experiment.units, _NAME), k)
            if scale == "log":
                logarithmic(axis, trials)
            axis.set_xlabel("time since the first movement (s)")
        for axis in axes if tight else axes[:1]:
            units = experiment.units
            axis.set_ylabel(displacement_label(units))
        handles, labels = legend_entries(figure)
        order = sorted(range(len(labels)), key=lambda n: labels[n].endswith(" begins"))
        title = f"{pad_title(shortened(experiment.pad))}: displacement programme"
        entry = [handles[n] for n in order], [labels[n] for n in order]
        titled_legend(figure, title, *entry, ncols=columns)
    return list(axes)


def _draw(axis: Axes, trial: Trial, name: str, k: int) -> None:
    palette = colours()
    look: dict[str, Any] = {"color": palette[k % len(palette)], "linestyle": LINES[k % len(LINES)]}
    rows, way = shown_samples(trial), trial.whole.displacement
    time = since_contact(trial, trial.whole.time[rows])
    axis.plot(time, way[rows], gid=trial.name, label=name, **look)
    open_sign: dict[str, Any] = {"markerfacecolor": "white", "markersize": 3.6, "zorder": 3}
    for kind, sign in _SIGNS.items():
        starts = np.array([phase.start for phase in trial.phases if phase.kind == kind])
        if starts.size:
            axis.plot(
                since_contact(trial, starts), trial.trajectory.displacement(starts), sign, gid=kind,
                color=look["color"], markeredgewidth=0.7, label=f"{kind} begins", **open_sign,
            )  # fmt: skip
