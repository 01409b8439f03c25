"""How the error falls toward the noise floor as effects are added."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qlvbayes.diagnosis.verdict import Diagnosis, Stage
from qlvbayes.plots.naming import broken, heading
from qlvbayes.plots.style import BLACK, COLOURS, DOUBLE, MM, quantity, style
from qlvbayes.units import UnitSystem

_HEIGHT = 72.0  # mm
_FAR = 6.0  # highest over lowest, from where on the axis is logarithmic
_HALF = 0.32  # of a step: half of its tread


def plot_error_staircase(diagnosis: Diagnosis) -> Figure:
    """Draw the root mean square error of all samples after each step of the search.

    Filled dots and full lines: all tests fitted together; open squares and dashes: each test
    predicted from the others. The horizontal line is the noise measured without a model. Below
    each step stands what it added and what it made useless.
    """
    units = diagnosis.work.experiment.units
    with style():
        figure = Figure((DOUBLE * MM, _HEIGHT * MM), layout="constrained")
        axis = figure.subplots()
        fitted = np.array([stage.rmse for stage in diagnosis.stages])
        heldout = np.array([stage.heldout_rmse for stage in diagnosis.stages])
        _limits(axis, np.concatenate([fitted, heldout, [diagnosis.noise]]))
        _stairs(axis, heldout, COLOURS[1], "--", "s", "each test predicted from the others")
        _stairs(axis, fitted, COLOURS[0], "-", "o", "all tests fitted")
        _numbers(axis, fitted, heldout)
        _floor(axis, diagnosis.noise, units)
        _label(axis, diagnosis, units)
        figure.legend(loc="outside upper right", ncols=2)
    return figure


def _limits(axis: Axes, values: np.ndarray) -> None:
    low, high = values.min(), values.max()
    if low > 0.0 and high > _FAR * low:
        axis.set_yscale("log")
        axis.set_ylim(0.6 * low, 1.7 * high)
    else:
        axis.set_ylim(0.0, 1.25 * high)


def _stairs(
    axis: Axes, values: np.ndarray, colour: str, line: str, marker: str, label: str
) -> None:
    """Treads with a marker each, joined by thin lines."""
    x = np.concatenate([[k - _HALF, k + _HALF] for k in range(values.size)])
    axis.plot(x, np.repeat(values, 2), line, color=colour, linewidth=0.8)
    axis.plot(
        range(values.size),
        values,
        linestyle=line,
        linewidth=0.0,
        marker=marker,
        color=colour,
        markerfacecolor=colour if marker == "o" else "white",
        markersize=4.5,
        label=label,
    )


def _numbers(axis: Axes, fitted: np.ndarray, heldout: np.ndarray) -> None:
    """The larger value above its marker, the smaller below."""
    for k, (own, other) in enumerate(zip(fitted, heldout, strict=True)):
        for value, colour, up in (
            (own, COLOURS[0], own > other),
            (other, COLOURS[1], own <= other),
        ):
            axis.annotate(
                f"{value:.3g}",
                (k, value),
                xytext=(0, 5 if up else -5),
                textcoords="offset points",
                ha="center",
                va="bottom" if up else "top",
                color=colour,
            )


def _floor(axis: Axes, noise: float, units: UnitSystem) -> None:
    axis.axhline(noise, color=BLACK, linewidth=0.8, linestyle=":", zorder=1)
    axis.annotate(
        f"noise floor\n{noise:.3g} {units.force}",
        (1.0, noise),
        xycoords=axis.get_yaxis_transform(),
        xytext=(3, 0),
        textcoords="offset points",
        va="center",
    )


def _label(axis: Axes, diagnosis: Diagnosis, units: UnitSystem) -> None:
    stages = diagnosis.stages
    changes = ["plain model", *(_change(*pair) for pair in pairwise(stages))]
    axis.set_xticks(range(len(stages)), changes)
    axis.set_xlim(-0.6, len(stages) - 0.4)
    axis.tick_params(axis="x", length=0)
    axis.set_ylabel(quantity("RMSE, measured − predicted", units.force))
    axis.figure.suptitle(heading(diagnosis), x=0.01, ha="left", weight="bold", fontsize=8.5)


def _change(before: Stage, after: Stage) -> str:
    """'+ friction', and '− viscous_drag' where that became useless."""
    added = [name for name in after.effects if name not in before.effects]
    dropped = [name for name in before.effects if name not in after.effects]
    lines = [f"+ {broken(name)}" for name in added] + [f"− {broken(name)}" for name in dropped]
    return "\n".join(lines)
