"""Draw force against time, measured and by two models, with the models' residuals."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from scipy.special import ndtri

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.summary.curves import Curve, ForceBand, curves
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.io.units import UnitSystem
from qlvbayes.plots.naming import heading, model_lines
from qlvbayes.plots.panels import (
    LABEL,
    finish_columns,
    lay_out_panels,
    leaders,
    lines_of,
    mark_left_out,
    name_row,
)
from qlvbayes.plots.phases import (
    WHOLE,
    PanelSamples,
    PhaseSamples,
    by_rate,
    columns,
    divide,
    finish_time,
    number_repeats,
    panel_samples,
    trial_name,
)
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    MM,
    canvas,
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

    There is one row for each test, slowest first, and one column for each kind of phase, dwells in
    logarithmic time. Lines are the models at their best constants, and bands hold 90 % of readings.
    The lower strip shows measured minus predicted; its grey band holds 90 % of the noise measured
    without a model. Where phases of a kind repeat, a first panel shows the whole test, and the
    repeats lie over each other. Grey crosses are readings that were left out. Where no effect was
    added there is one model.

    Parameters
    ----------
    diagnosis
        The diagnosis.
    width
        Width of the figure (mm).

    Returns
    -------
    list of Axes
        The panels, row by row.
    """
    shown = sorted(curves(diagnosis), key=lambda curve: by_rate(curve.trial.rate))
    units, tight = diagnosis.result.units, narrow(width)
    with style():
        parts = [divide(curve.time, curve.trial.phases) for curve in shown]
        names = columns(parts)
        figure, axes = _panels(len(shown), names, width)
        left = leaders(names, tight)
        for pair, curve, stretches in zip(axes, shown, parts, strict=True):
            for upper, lower, name in zip(*pair, names, strict=True):
                _draw(upper, lower, name, curve, stretches, tight=tight)
            mark_left_out(pair[0], names, curve.trial, stretches)
            _label_row(pair, curve, units, left, tight=tight)
        _finish(figure, axes, names, left)
        _legend(figure, axes, diagnosis.result, tight=tight)
    return list(axes.flat)


def _panels(count: int, names: Sequence[str], width: float) -> tuple[Figure, np.ndarray]:
    """Return axes (test, force or strip, column), strips below their forces."""
    tight = narrow(width)
    row, frame = (tight * extra for extra in _SECOND_LINES)
    height = _FRAME + frame + (_ROW + row) * lines_of(names, tight) * count
    layout = ConstrainedLayoutEngine(h_pad=_GAP * MM, hspace=0.0)
    figure = canvas(width, height, layout=layout)
    return figure, lay_out_panels(figure, count, names, [1.5, 1.0], tight=tight)


def _draw(
    upper: Axes,
    lower: Axes,
    name: str,
    curve: Curve,
    stretches: Sequence[PhaseSamples],
    *,
    tight: bool,
) -> None:
    shown = panel_samples(name, curve.time, stretches)
    for placed in shown:
        _force(upper, placed, curve)
        _strip(lower, placed, curve)
    if name != WHOLE and len(shown) > 1:
        number_repeats(upper, shown, curve.final.mean, fontsize=7.0)
    for axis in (upper, lower):
        finish_time(axis, name, stretches, tight=tight)
    upper.set_xlabel("")
    upper.tick_params(labelbottom=False)


def _models(curve: Curve) -> list[tuple[ForceBand, str, str]]:
    """Return each model with its colour and line."""
    palette = colours()
    last = (curve.final, palette[_FINAL], "-")
    return (
        [last]
        if curve.final is curve.baseline
        else [(curve.baseline, palette[_BASELINE], "--"), last]
    )


def _force(axis: Axes, placed: PanelSamples, curve: Curve) -> None:
    rows, time = placed.rows, placed.time
    for band, colour, _ in _models(curve):
        axis.fill_between(
            time, band.low[rows], band.high[rows], color=colour, alpha=0.3, linewidth=0
        )
    axis.plot(time, curve.observed[rows], ".", color=BLACK, markersize=3.0, markeredgewidth=0)
    for band, colour, line in reversed(_models(curve)):  # dashes over the full line
        axis.plot(time, band.mean[rows], line, color=colour, linewidth=0.9)


def _strip(axis: Axes, placed: PanelSamples, curve: Curve) -> None:
    rows, time = placed.rows, placed.time
    half = _90 * curve.floor[rows]
    axis.fill_between(time, -half, half, color="0.9", linewidth=0, zorder=0)
    axis.axhline(0.0, color="0.4", linewidth=0.4, zorder=0.5)
    for band, colour, _ in _models(curve):
        left = (curve.observed - band.mean)[rows]
        axis.plot(time, left, ".", color=colour, markersize=2.2, markeredgewidth=0)


def _label_row(
    pair: np.ndarray, curve: Curve, units: UnitSystem, left: range, *, tight: bool
) -> None:
    """Write test and rate above the row, at the left."""
    name = trial_name(curve.trial, units, _NAME_TIGHT if tight else _NAME)
    name_row(pair[0], name, tight=tight)
    for k in left:
        pair[0, k].set_ylabel(force_label(units))
        pair[1, k].set_ylabel(f"residual\n({units.force})")


def _finish(figure: Figure, axes: np.ndarray, names: Sequence[str], left: range) -> None:
    finish_columns(figure, axes, names, left)
    for upper, lower in axes[:, :, 0]:
        upper.yaxis.set_major_locator(MaxNLocator(4))
        lower.yaxis.set_major_locator(MaxNLocator(3))


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
