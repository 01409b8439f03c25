"""Draw force against time, measured and by two models, with the models' residuals."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from scipy.special import ndtri

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.summary.curves import Curve, ForceBand, curves
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.plots.naming import heading, model_lines
from qlvbayes.plots.panels import LABEL, PhasePanels
from qlvbayes.plots.phases import PanelSamples, trial_name
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    MM,
    colours,
    force_label,
    narrow,
    style,
    titled_legend,
)

_FRAME = 26.0  # mm: title, legend and key
_ROW = 40.0  # mm, a test
_SECOND_LINES = 4.0, 16.0  # mm, second lines of a row's labels and of the legend in one column
_BASELINE, _FINAL = 4, 0  # indices of a light and a dark colour, which differ in grey too
_NAME, _NAME_TIGHT = 40, 24  # characters of a test's name
_GAP = 0.6  # mm, around every panel
_LABEL, _LABEL_TIGHT = 50, 18  # characters a line, of a model in the legend
_90 = float(ndtri(0.95))  # sds on either side that hold 90 %


def plot_forces_before_after(diagnosis: Diagnosis, *, width: float = DOUBLE) -> list[Axes]:
    """Draw every test's force as measured, by the baseline model and by the last model.

    Lines are the models at their best constants, and bands hold 90 % of readings. The lower strip
    shows measured minus predicted; its grey band holds 90 % of the noise measured without a model.
    Where no effect was added there is one model. ``width`` is in mm; returns the panels, row by
    row.
    """
    units, tight = diagnosis.result.units, narrow(width)
    row_extra, frame_extra = (tight * extra for extra in _SECOND_LINES)
    with style():
        page = PhasePanels.for_tests(
            curves(diagnosis), width, frame=_FRAME + frame_extra, row=_ROW + row_extra,
            heights=[1.5, 1.0], layout=ConstrainedLayoutEngine(h_pad=_GAP * MM, hspace=0.0),
        )  # fmt: skip
        for row in page.rows:
            row.paint(_draw, row.test.final.mean, fontsize=7.0)
            name = trial_name(row.test.trial, units, _NAME_TIGHT if tight else _NAME)
            row.label(name, [force_label(units), f"residual\n({units.force})"])
        page.finish([4, 3])
        _legend(page.figure, page.axes, diagnosis.result, tight=tight)
    return list(page.axes.flat)


def _draw(panels: np.ndarray, samples: PanelSamples, curve: Curve) -> None:
    upper, lower = panels
    _force(upper, samples, curve)
    _strip(lower, samples, curve)


def _models(curve: Curve) -> list[tuple[ForceBand, str, str]]:
    """Return each model with its colour and line."""
    palette = colours()
    last = (curve.final, palette[_FINAL], "-")
    return (
        [last]
        if curve.final is curve.baseline
        else [(curve.baseline, palette[_BASELINE], "--"), last]
    )


def _force(axis: Axes, samples: PanelSamples, curve: Curve) -> None:
    rows, time = samples.rows, samples.time
    for band, colour, _ in _models(curve):
        axis.fill_between(
            time, band.low[rows], band.high[rows], color=colour, alpha=0.3, linewidth=0
        )
    axis.plot(time, curve.observed[rows], ".", color=BLACK, markersize=3.0, markeredgewidth=0)
    for band, colour, line in reversed(_models(curve)):  # dashes over the full line
        axis.plot(time, band.mean[rows], line, color=colour, linewidth=0.9)


def _strip(axis: Axes, samples: PanelSamples, curve: Curve) -> None:
    rows, time = samples.rows, samples.time
    half = _90 * curve.floor[rows]
    axis.fill_between(time, -half, half, color="0.9", linewidth=0, zorder=0)
    axis.axhline(0.0, color="0.4", linewidth=0.4, zorder=0.5)
    for band, colour, _ in _models(curve):
        left = (curve.observed - band.mean)[rows]
        axis.plot(time, left, ".", color=colour, markersize=2.2, markeredgewidth=0)


def _legend(figure: Figure, axes: np.ndarray, diagnosis: DiagnosisResult, *, tight: bool) -> None:
    upper, lower = next(pair for pair in axes[0].T if pair[0].lines)
    bands = {to_hex(area.get_facecolor()[0]): area for area in upper.collections}
    lines = {line.get_color(): line for line in upper.lines if line.get_linestyle() != "None"}
    plain, final = (colours()[k] for k in (_BASELINE, _FINAL))
    handles = [upper.lines[0], lower.collections[0]]
    labels = ["measured", "90 % of the noise floor"]
    models: list[tuple[str, Sequence[str], Sequence[str]]]
    models = [(plain, (), ())] if plain in lines else []
    for colour, effects, laws in [*models, (final, diagnosis.tried, diagnosis.changed)]:
        handles += [lines[colour], bands[to_hex(colour)]]
        labels += [
            model_lines(effects, laws, _LABEL_TIGHT)
            if tight
            else fill(model_name(effects, laws), _LABEL),
            "its 90 % band",
        ]
    if tight:  # lines in the first column, bands in the second
        handles, labels = handles[::2] + handles[1::2], labels[::2] + labels[1::2]
    titled_legend(
        figure,
        heading(diagnosis, tight=tight),
        handles,
        labels,
        ncols=2 if tight else len(labels) // 2,
        handlelength=1.3 if tight else None,
        columnspacing=1.0 if tight else None,
        markerscale=2.5,
    )
    key = "residual: measured − predicted, dots in the model's colour"
    if any(line.get_label() == LABEL for axis in axes.flat for line in axis.lines):
        key += "; grey crosses: readings left out" if not tight else "\ngrey crosses: left out"
    figure.supxlabel(key, x=0.01, ha="left")
