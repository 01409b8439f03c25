"""Draw how the error falls toward the noise floor as effects are added."""

from __future__ import annotations

from itertools import pairwise
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from qlvbayes.diagnosis.result import DiagnosisResult, Stage
from qlvbayes.io.units import UnitSystem
from qlvbayes.plots.naming import broken, heading, three
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    canvas,
    colours,
    narrow,
    quantity,
    style,
    titled_legend,
    write_right,
)

_HEIGHT, _HEIGHT_TIGHT, _UPRIGHT = 76.0, 92.0, 28.0  # mm; the last is added for upright names
_NAME, _NAME_TIGHT = 18, 10  # characters a line, of an effect's name
_LEVEL = 3  # most steps in one column whose names are written horizontally
_UNBROKEN = 100  # characters a line, more than any name has
_NOTE, _NOTE_TIGHT = 140, 60  # characters a line
_FAR = 6.0  # ratio of highest to lowest beyond which the axis is logarithmic
_DECADES = 50.0  # ratio of highest to lowest below which 2 and 5 have ticks too
_RISE = (
    "An effect is added where the evidence rises, which weights readings by all their noise; RMSE "
    "weights them by stated sds alone."
)


def plot_error_staircase(diagnosis: DiagnosisResult, *, width: float = DOUBLE) -> Axes:
    """Draw the root mean square error of all samples after each step of the search.

    ``diagnosis`` is the diagnosis's result, ``width`` in mm; returns the axes. Full lines are all
    tests fitted together, dashes each test predicted from the others.
    """
    units, tight = diagnosis.units, narrow(width)
    with style():
        upright = tight and len(diagnosis.stages) > _LEVEL
        height = (_HEIGHT_TIGHT if tight else _HEIGHT) + upright * _UPRIGHT
        figure = canvas(width, height)
        axis = figure.subplots()
        fitted = np.array([stage.rmse for stage in diagnosis.stages])
        heldout = np.array([stage.heldout_rmse for stage in diagnosis.stages], float)
        _limits(axis, np.concatenate([fitted, heldout[np.isfinite(heldout)], [diagnosis.noise]]))
        inks = colours()
        _stairs(axis, fitted, inks[0], "-", "o", "all tests fitted")
        if np.isfinite(heldout).all():  # a single test cannot be predicted from others
            _stairs(axis, heldout, inks[1], "--", "s", "each test predicted from the others")
        _write_values(axis, fitted, heldout)
        _floor(axis, diagnosis.noise, units, tight=tight)
        _label(axis, diagnosis, units, tight=tight, upright=upright)
        title, entries = heading(diagnosis, tight=tight), axis.get_legend_handles_labels()
        titled_legend(figure, title, *entries, ncols=1 if tight else 2)
        if np.any(np.diff(fitted) > 0.0) or np.any(np.diff(heldout) > 0.0):
            note = fill(_RISE, _NOTE_TIGHT if tight else _NOTE)
            figure.supxlabel(note, x=0.01, ha="left")
    return axis


def _limits(axis: Axes, values: np.ndarray) -> None:
    low, high = values.min(), values.max()
    if low > 0.0 and high > _FAR * low:
        axis.set_yscale("log")
        axis.set_ylim(0.6 * low, 1.7 * high)
        steps = (1.0, 2.0, 5.0) if high < _DECADES * low else (1.0,)
        axis.yaxis.set_major_locator(LogLocator(subs=steps))
        axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.yaxis.set_minor_formatter(NullFormatter())
    else:
        axis.set_ylim(0.0, 1.25 * high)


def _stairs(
    axis: Axes, values: np.ndarray, colour: str, line: str, marker: str, label: str
) -> None:
    """Draw treads with a marker each, joined by risers."""
    edges = np.arange(values.size + 1) - 0.5
    axis.stairs(values, edges, baseline=None, color=colour, linestyle=line, linewidth=0.9)
    axis.plot(
        range(values.size),
        values,
        linestyle="None",
        marker=marker,
        color=colour,
        markerfacecolor=colour if marker == "o" else "none",
        markersize=4.0 if marker == "o" else 7.0,
        label=label,
    )


def _write_values(axis: Axes, fitted: np.ndarray, heldout: np.ndarray) -> None:
    """Write the larger value above its marker, the smaller below."""
    inks = colours()
    for k, (own, other) in enumerate(zip(fitted, heldout, strict=True)):
        for value, colour, up in (
            (own, inks[0], not own <= other),
            (other, inks[1], own <= other),
        ):
            if not np.isfinite(value):
                continue
            axis.annotate(
                three(value),
                (k, value),
                xytext=(0, 6 if up else -6),
                textcoords="offset points",
                ha="center",
                va="bottom" if up else "top",
                color=colour,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
            )


def _floor(axis: Axes, noise: float, units: UnitSystem, *, tight: bool) -> None:
    """Draw the noise floor as a line, named at its end, in one column in the legend."""
    line = axis.axhline(noise, color=BLACK, linewidth=0.8, linestyle=":", zorder=1)
    if tight:
        line.set_label(f"noise floor, {three(noise)} {units.force}")
        return
    write_right(axis, f"noise floor\n{three(noise)} {units.force}", noise, 3.0)


def _label(
    axis: Axes, diagnosis: DiagnosisResult, units: UnitSystem, *, tight: bool, upright: bool
) -> None:
    stages = diagnosis.stages
    most = _UNBROKEN if upright else _NAME_TIGHT if tight else _NAME
    first = "plain\nmodel" if tight and not upright else "plain model"
    changes = [first, *(_change(*pair, most) for pair in pairwise(stages))]
    axis.set_xticks(range(len(stages)), changes, rotation=90.0 if upright else 0.0)
    axis.set_xlim(-0.6, len(stages) - 0.4)
    axis.tick_params(axis="x", length=0)
    gap = "\n" if tight else " "
    axis.set_ylabel(quantity(f"RMSE,{gap}measured − predicted", units.force))


def _change(before: Stage, after: Stage, most: int) -> str:
    """Return what a step changed: '+ friction', '− viscous_drag', or the name of another law."""
    added = [name for name in after.effects if name not in before.effects]
    dropped = [name for name in before.effects if name not in after.effects]
    lines = [f"+ {broken(name, most)}" for name in added]
    lines += [f"− {broken(name, most)}" for name in dropped]
    lines += [broken(law, most) for law in after.base.others(before.base)]
    return "\n".join(lines)
