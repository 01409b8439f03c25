"""Force against time, measured and by two models, each over what the models leave of it."""

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

from qlvbayes.diagnosis.curves import Band, Curve, curves
from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.plots.naming import heading, model_name
from qlvbayes.plots.stretches import (
    RESTS,
    WHOLE,
    Placed,
    Stretch,
    by_rate,
    columns,
    divide,
    finish_time,
    place,
    same_times,
    widths,
)
from qlvbayes.plots.style import BLACK, COLOURS, DOUBLE, MM, quantity, rated, shortened, style
from qlvbayes.units import UnitSystem

_FRAME = 26.0  # mm, title, legend and key
_ROW = 40.0  # mm, a test
_PLAIN, _FINAL = COLOURS[4], COLOURS[0]  # light and dark, for readers of a grey copy
_GAP = 0.6  # mm, around every panel
_LABEL = 50  # characters a line, of a model in the legend
_90 = float(ndtri(0.95))  # sds, half of the width that holds 90 %


def plot_forces_before_after(diagnosis: Diagnosis, shown: Sequence[Curve] | None = None) -> Figure:
    """Draw every test's force as measured, by the plain and by the last model.

    One row a test, slowest first; one column a kind of phase, rests in logarithmic time. Lines are
    the models at their best constants, bands hold 90 % of readings. The lower strip shows measured
    minus predicted; its grey band holds 90 % of the noise measured without a model. Where phases
    of a kind repeat, a first panel shows the whole test, and the repeats lie over each other.
    Where no effect was added there is one model. ``shown``: curves already computed.
    """
    shown = sorted(shown or curves(diagnosis), key=lambda curve: by_rate(curve.trial.rate))
    units = diagnosis.work.experiment.units
    with style():
        parts = [divide(curve.time, curve.trial.phases) for curve in shown]
        names = columns(parts)
        figure, axes = _panels(len(shown), names)
        for pair, curve, stretches in zip(axes, shown, parts, strict=True):
            for upper, lower, name in zip(*pair, names, strict=True):
                _draw(upper, lower, name, curve, stretches)
            _label_row(pair, curve, units)
        _finish(figure, axes, names)
        _legend(figure, axes, diagnosis)
    return figure


def _panels(count: int, names: Sequence[str]) -> tuple[Figure, np.ndarray]:
    """Axes (test, force or strip, column), strips under their forces."""
    layout = ConstrainedLayoutEngine(h_pad=_GAP * MM, hspace=0.0)
    figure = Figure((DOUBLE * MM, (_FRAME + _ROW * count) * MM), layout=layout)
    axes = figure.subplots(
        2 * count,
        len(names),
        sharey="row",
        squeeze=False,
        width_ratios=widths(names),
        height_ratios=[1.5, 1.0] * count,
    )
    for upper, lower in zip(axes[::2].flat, axes[1::2].flat, strict=True):
        lower.sharex(upper)
    return figure, axes.reshape(count, 2, len(names))


def _draw(upper: Axes, lower: Axes, name: str, curve: Curve, stretches: Sequence[Stretch]) -> None:
    shown = place(name, curve.time, stretches)
    for placed in shown:
        _force(upper, placed, curve)
        _strip(lower, placed, curve)
        if name != WHOLE and len(shown) > 1:
            _number(upper, placed, curve)
    for axis in (upper, lower):
        finish_time(axis, name, stretches)
    upper.set_xlabel("")
    upper.tick_params(labelbottom=False)


def _models(curve: Curve) -> list[tuple[Band, str, str]]:
    """Each model with its colour and line."""
    last = (curve.final, _FINAL, "-")
    return [last] if curve.final is curve.plain else [(curve.plain, _PLAIN, "--"), last]


def _force(axis: Axes, placed: Placed, curve: Curve) -> None:
    rows, time = placed.rows, placed.time
    for band, colour, _ in _models(curve):
        axis.fill_between(
            time, band.low[rows], band.high[rows], color=colour, alpha=0.3, linewidth=0
        )
    axis.plot(time, curve.observed[rows], ".", color=BLACK, markersize=3.0, markeredgewidth=0)
    for band, colour, line in reversed(_models(curve)):  # dashes over the full line
        axis.plot(time, band.mean[rows], line, color=colour, linewidth=0.9)


def _strip(axis: Axes, placed: Placed, curve: Curve) -> None:
    rows, time = placed.rows, placed.time
    half = _90 * curve.floor[rows]
    axis.fill_between(time, -half, half, color="0.9", linewidth=0, zorder=0)
    axis.axhline(0.0, color="0.4", linewidth=0.4, zorder=0.5)
    for band, colour, _ in _models(curve):
        left = (curve.observed - band.mean)[rows]
        axis.plot(time, left, ".", color=colour, markersize=2.2, markeredgewidth=0)


def _number(axis: Axes, placed: Placed, curve: Curve) -> None:
    axis.annotate(
        f"{placed.stretch.number + 1}",
        (placed.time[-1], curve.final.mean[placed.rows[-1]]),
        xytext=(2, 0),
        textcoords="offset points",
        va="center",
        fontsize=7,
        annotation_clip=False,
    )


def _label_row(pair: np.ndarray, curve: Curve, units: UnitSystem) -> None:
    """Left above the row: test and rate."""
    trial = curve.trial
    speed = [rated(trial.rate, units.speed)] if np.isfinite(trial.rate) else []
    pair[0, 0].set_title(", ".join([shortened(trial.name), *speed]), loc="left")
    pair[0, 0].set_ylabel(quantity(units.force_name, units.force))
    pair[1, 0].set_ylabel(f"residual\n({units.force})")


def _finish(figure: Figure, axes: np.ndarray, names: Sequence[str]) -> None:
    for k, name in enumerate(names):
        axes[0, 0, k].set_title(f"{name}\n", weight="bold")  # the second line is the row's
        if name in RESTS:
            same_times(axes[:, :, k].ravel())
    for upper, lower in axes[:, :, 0]:
        upper.yaxis.set_major_locator(MaxNLocator(4))
        lower.yaxis.set_major_locator(MaxNLocator(3))
    figure.align_ylabels(axes[:, :, 0].ravel())


def _legend(figure: Figure, axes: np.ndarray, diagnosis: Diagnosis) -> None:
    upper, lower = next(pair for pair in axes[0].T if pair[0].lines)
    bands = {to_hex(area.get_facecolor()[0]): area for area in upper.collections}
    lines = {line.get_color(): line for line in upper.lines if line.get_linestyle() != "None"}
    handles = [upper.lines[0], lower.collections[0]]
    labels = ["measured", "90 % of the noise floor"]
    models = [(_PLAIN, ())] if _PLAIN in lines else []
    for colour, effects in [*models, (_FINAL, diagnosis.tried)]:
        handles += [lines[colour], bands[colour.lower()]]
        labels += [fill(model_name(effects), _LABEL), "its 90 % band"]
    figure.legend(
        handles,
        labels,
        loc="outside upper left",
        ncols=len(labels) // 2,
        markerscale=2.5,
        alignment="left",
        title=heading(diagnosis),
        title_fontproperties={"weight": "bold", "size": 8.5},
    )
    key = "residual: measured − predicted, dots in the model's colour"
    figure.supxlabel(key, x=0.01, ha="left", fontsize=7.0)
