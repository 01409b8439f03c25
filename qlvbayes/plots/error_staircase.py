"""Draw how the error falls as effects are added, and the strength of these in each test."""

from __future__ import annotations

from itertools import pairwise
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from qlvbayes.diagnosis.phrases import parts
from qlvbayes.diagnosis.result import DiagnosisResult, Stage, Strengths
from qlvbayes.plots.naming import broken, heading, three
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    SINGLE,
    canvas,
    colours,
    name_rows,
    narrow,
    quantity,
    style,
    titled_legend,
)

_ROW, _FRAME, _TIGHT = 11.0, 30.0, 12.0  # mm: a step, the margins, and more in one column
_NAME, _NAME_TIGHT = 30, 18  # characters a line, of an effect's name
_NOTE, _NOTE_TIGHT = 130, 60  # characters a line
_FAR = 6.0  # ratio of highest to lowest beyond which the axis is logarithmic
_DECADES = 50.0  # ratio of highest to lowest below which 2 and 5 have ticks too
_RISE = (
    "An effect is added where the evidence rises, which weights readings by all their noise; RMSE "
    "weights them by stated sds alone."
)


def plot_error_staircase(diagnosis: DiagnosisResult, *, width: float = DOUBLE) -> Axes:
    """Draw the root mean square error of all samples after each step of the search, row by row.

    ``diagnosis`` is the diagnosis's result, ``width`` in mm; returns the axes. Full lines are all
    tests fitted together, dashes each test predicted from the others.
    """
    units, tight, stages = diagnosis.units, narrow(width), diagnosis.stages
    rows, fitted = np.arange(len(stages)), np.array([stage.rmse for stage in stages])
    heldout = np.array([stage.heldout_rmse for stage in stages], float)
    part = parts(diagnosis).removesuffix("s")
    with style():
        inks = colours()
        series: list[tuple[np.ndarray, str, Any, str, str]] = [
            (fitted, inks[0], "-", "o", f"all {part}s fitted"),
            (heldout, inks[1], "--", "s", f"each {part} predicted from the others"),
        ]
        shown = series if np.isfinite(heldout).all() else series[:1]  # nothing to predict
        figure = canvas(width, _FRAME + _TIGHT * tight + _ROW * len(stages))
        axis = figure.subplots()
        _scale(axis, np.concatenate([*(values for values, *_ in shown), [diagnosis.noise]]))
        for values, ink, line, marker, label in shown:
            edges = np.arange(values.size + 1) - 0.5
            look: dict[str, Any] = {"color": ink, "linestyle": line, "linewidth": 0.9}
            axis.stairs(values, edges, baseline=None, orientation="horizontal", **look)
            face = ink if marker == "o" else "none"
            size = 4.0 if marker == "o" else 7.0
            axis.plot(values, rows, marker, color=ink, mfc=face, markersize=size, label=label)
            for row, value in zip(rows, values, strict=True):
                # the larger of two values to the right of its mark, the smaller to the left
                right = not value < max(other[row] for other, *_ in shown)
                axis.annotate(
                    three(value), (value, row), xytext=(6 if right else -6, 0), color=ink,
                    textcoords="offset points", ha="left" if right else "right", va="center",
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8}, zorder=3,
                )  # fmt: skip
        floor = f"noise floor, {three(diagnosis.noise)} {units.force}"
        axis.axvline(diagnosis.noise, color=BLACK, linestyle=":", zorder=1, label=floor)
        most = _NAME_TIGHT if tight else _NAME
        names = ["plain model", *(_change(*pair, most) for pair in pairwise(stages))]
        name_rows(axis, names)
        axis.set_xlabel(quantity("RMSE, measured − modelled", units.force))
        entries = axis.get_legend_handles_labels()
        titled_legend(figure, heading(diagnosis, tight=tight), *entries, ncols=1 if tight else 3)
        if any(np.any(np.diff(values) > 0.0) for values, *_ in shown):
            note = fill(_RISE, _NOTE_TIGHT if tight else _NOTE)
            figure.supxlabel(note, x=0.01, ha="left")
    return axis


def _scale(axis: Axes, values: np.ndarray) -> None:
    low, high = values.min(), values.max()
    if low > 0.0 and high > _FAR * low:
        axis.set_xscale("log")
        axis.set_xlim(0.5 * low, 2.0 * high)
        steps = (1.0, 2.0, 5.0) if high < _DECADES * low else (1.0,)
        axis.xaxis.set_major_locator(LogLocator(subs=steps))
        axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_formatter(NullFormatter())
    else:
        axis.set_xlim(0.0, 1.35 * high)


def _change(before: Stage, after: Stage, most: int) -> str:
    """Return what a step changed: '+ friction', '− viscous_drag', or the name of another law."""
    added = [name for name in after.effects if name not in before.effects]
    dropped = [name for name in before.effects if name not in after.effects]
    lines = [f"+ {broken(name, most)}" for name in added]
    lines += [f"− {broken(name, most)}" for name in dropped]
    lines += [broken(law, most) for law in after.base.others(before.base)]
    return "\n".join(lines)


_TEST, _MARGINS = 4.6, 16.0  # mm, a test and the margins of a panel


def plot_strengths(diagnosis: DiagnosisResult, *, width: float = SINGLE) -> Axes:
    """Draw the strength of each named effect in each test, over its mean, with one sd.

    The shaded region holds the scatter between tests, one sd either way. ``diagnosis`` is the
    diagnosis's result, ``width`` in mm; returns the axes of the last effect, or raises ValueError
    where no effect is named whose strength differs between tests.
    """
    found = diagnosis.strengths
    if not found:
        raise ValueError("no effect is named whose strength differs between tests")
    with style():
        heights = [_TEST * len(one.parts) + _MARGINS for one in found.values()]
        figure = canvas(width, sum(heights))
        panels = figure.subplots(len(found), squeeze=False, height_ratios=heights)[:, 0]
        for axis, (name, own) in zip(panels, found.items(), strict=True):
            _draw(axis, own)
            axis.set_xlabel(f"strength of {name} over its mean")
    return axis


def _draw(axis: Axes, own: Strengths) -> None:
    rows = np.arange(len(own.parts))[::-1]
    ratios, sds, shares = np.array([(one.ratio, one.sd, one.share) for one in own.parts]).T
    axis.axvspan(1.0 - own.spread, 1.0 + own.spread, color="0.9", linewidth=0.0)
    axis.axvline(1.0, color=BLACK, linewidth=0.6)
    axis.errorbar(ratios, rows, xerr=sds, fmt="none", color=colours()[0], linewidth=0.8)
    axis.scatter(ratios, rows, s=4.0 + 30.0 * shares / shares.max(), color=colours()[0], zorder=3)
    axis.set_yticks(rows, [one.test for one in own.parts])
    axis.set_ylim(-0.7, rows.size - 0.3)
    axis.set_xlim(left=min(0.0, float((ratios - sds).min())))
