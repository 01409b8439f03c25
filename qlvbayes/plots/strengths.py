"""Draw the strength of the named effects in each test."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from qlvbayes.diagnosis.result import DiagnosisResult, Strengths
from qlvbayes.plots.style import BLACK, SINGLE, canvas, colours, style

_ROW, _FRAME = 4.6, 16.0  # mm, a test and the margins of a panel


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
        heights = [_ROW * len(one.parts) + _FRAME for one in found.values()]
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
