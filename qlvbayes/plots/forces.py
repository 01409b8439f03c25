"""Draw force against time or displacement, measured and by one or two models, and what is left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from scipy.special import ndtri

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.summary.diagnosis import Curve, Diagnosis, curves
from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.units import UnitSystem
from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.phases import MOVING, phase_index
from qlvbayes.plots.naming import heading, model_lines
from qlvbayes.plots.panels import (
    LABEL,
    DrawnModel,
    PhaseTime,
    Sheet,
    by_rate,
    draw_band,
    draw_samples,
    legend_entries,
    mark_left_out,
    role_look,
    trial_name,
)
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    MM,
    PLAIN,
    canvas,
    colours,
    displacement_label,
    force_label,
    narrow,
    style,
    titled_legend,
)

_HEIGHT = 26.0  # mm, a panel of force
_NAME, _NAME_TIGHT = 40, 20  # characters of a test's name


def plot_forces(
    predictions: Sequence[Prediction], units: UnitSystem, *, width: float = DOUBLE
) -> list[Axes]:
    """Draw the measured force of every test against what the posterior predicts.

    There is one panel for each test, slowest first, with its phases side by side. Dots are measured
    samples, the line is the model's posterior mean, and the band holds 90 % of predicted samples:
    it includes the fitted discrepancy, so that it may lie off the line.

    ``predictions`` are those of the tests, ``units`` those of displacement and force, ``width`` is
    in mm; returns the panels.
    """
    tight = narrow(width)
    shown = sorted(predictions, key=lambda one: by_rate(one.trial.rate))
    with style():
        sheet = Sheet.of(width, len(shown), [_HEIGHT], head=10.0 if tight else 5.0)
        for panels, one in zip(sheet.blocks, shown, strict=True):
            time = PhaseTime.of(one.trial, sheet.wide)
            draw_samples(panels[0], time(one.time), one.observed, [model_of(one)])
            finish(sheet, panels, one.trial, time, [force_label(units)])
            name = trial_name(one.trial, units, _NAME_TIGHT if tight else _NAME)
            role, weight = role_look(one.trial.role)
            panels[0].set_title(f"{name}, {role}", loc="left", pad=10.0, weight=weight)
        figure, most = sheet.figure, 2 if tight else 4
        handles = legend_entries(figure)
        figure.legend(*handles, ncols=most, loc="upper center", borderaxespad=0.3, markerscale=2.0)
    return [panels[0] for panels in sheet.blocks]


def model_of(prediction: Prediction) -> DrawnModel:
    """Return a prediction as it is drawn, in the model's colour."""
    return DrawnModel(prediction.mean, prediction.low, prediction.high, colours()[0])


def finish(
    sheet: Sheet, panels: Sequence[Axes], trial: Trial, time: PhaseTime, quantities: Sequence[str]
) -> None:
    """Mark the phases of a test, its readings left out, and what each panel shows."""
    bad = trial.left_out
    if bad is not None:
        rows = bad.drawn
        panels[0].set_ylim(*panels[0].get_ylim())  # a cross at the edge would widen it
        mark_left_out(panels[0], time(bad.time[rows]), bad.force[rows])
    for axis, text in zip(panels, quantities, strict=True):
        axis.set_ylim(*axis.get_ylim())
        axis.yaxis.set_major_locator(MaxNLocator(4 if axis is panels[0] else 3))
        time.mark(axis, sheet.wide, last=axis is panels[-1])
        sheet.label(axis, text)
    time.name_phases(panels[0], sheet.wide)


_HEIGHTS = (22.0, 15.0)  # mm: a panel of force and one of residuals
_HEAD, _HEAD_TIGHT = 13.0, 21.0  # mm: title, of one line or of two, and legend
_LINE = 4.5  # mm: a further line of the title
_NAME_PAIR, _NAME_PAIR_TIGHT = 40, 24  # characters of a test's name
_LABEL, _LABEL_TIGHT = 50, 18  # characters a line, of a model in the legend
_90 = float(ndtri(0.95))  # sds on either side that hold 90 %


def plot_forces_before_after(diagnosis: Diagnosis, *, width: float = DOUBLE) -> list[Axes]:
    """Draw every test's force as measured, by the baseline model and by the last model.

    Lines are the models at their best constants, and bands hold 90 % of readings. The lower panel
    shows measured minus predicted; its grey band holds 90 % of the noise measured without a model.
    Where no effect was added there is one model. ``width`` is in mm; returns the panels, test by
    test.
    """
    units, tight = diagnosis.result.units, narrow(width)
    shown = sorted(curves(diagnosis), key=lambda one: by_rate(one.trial.rate))
    with style():
        more = heading(diagnosis.result, tight=tight).count("\n") - tight
        head = (_HEAD_TIGHT if tight else _HEAD) + _LINE * max(more, 0)
        sheet = Sheet.of(width, len(shown), _HEIGHTS, head=head, foot=7.0 if tight else 4.0)
        quantities = [force_label(units), f"residual\n({units.force})"]
        for panels, one in zip(sheet.blocks, shown, strict=True):
            time = PhaseTime.of(one.trial, sheet.wide)
            for axis, floor in zip(panels, (None, _90 * one.floor), strict=True):
                draw_samples(axis, time(one.time), one.observed, _models(one), floor)
            finish(sheet, panels, one.trial, time, quantities)
            name = trial_name(one.trial, units, _NAME_PAIR_TIGHT if tight else _NAME_PAIR)
            panels[0].set_title(name, loc="left", pad=10.0)
        _legend(sheet.figure, diagnosis.result, len(_models(shown[0])), tight=tight)
    return [axis for panels in sheet.blocks for axis in panels]


def _models(curve: Curve) -> list[DrawnModel]:
    """Return the baseline model where effects were added, and the last model."""
    final, plain = curve.final, curve.baseline
    last = DrawnModel(final.mean, final.low, final.high, colours()[0])
    first = DrawnModel(plain.mean, plain.low, plain.high, PLAIN, "--")
    return [last] if final is plain else [first, last]


def _legend(figure: Figure, diagnosis: DiagnosisResult, count: int, *, tight: bool) -> None:
    handles: list[Any] = [
        Line2D([], [], color=BLACK, marker=".", linestyle="None", markeredgewidth=0, markersize=5),
        Patch(color="0.88", linewidth=0),
    ]
    labels = ["measured", "90 % of the noise"]
    models: list[tuple[str, Any, Sequence[str], Sequence[str]]] = [
        (PLAIN, "--", (), ()),
        (colours()[0], "-", diagnosis.tried, diagnosis.changed),
    ]
    for colour, line, effects, laws in models[-count:]:
        name = model_name(effects, laws)
        name = model_lines(effects, laws, _LABEL_TIGHT) if tight else fill(name, _LABEL)
        handles += [Line2D([], [], color=colour, linestyle=line)]
        handles += [Patch(color=colour, alpha=0.3, linewidth=0)]
        labels += [name, "its 90 % band"]
    if tight:  # lines in the first column, bands in the second
        handles, labels = handles[::2] + handles[1::2], labels[::2] + labels[1::2]
    titled_legend(
        figure, heading(diagnosis, tight=tight), handles, labels,
        ncols=2 if tight else len(labels) // 2, loc="upper left", borderaxespad=0.3,
    )  # fmt: skip
    key = "residual: measured − predicted, dots in the model's colour"
    if any(line.get_gid() == LABEL for axis in figure.axes for line in axis.lines):
        key += "\ngrey crosses: left out" if tight else "; grey crosses: readings left out"
    figure.text(0.01, MM / figure.get_figheight(), key, fontsize="small")


_PANEL, _FRAME = 48.0, 16.0  # mm: a row of panels, and the margins
_ACROSS, _ACROSS_TIGHT = 3, 2  # panels
_NAME_LOOP, _NAME_LOOP_TIGHT = 22, 14  # characters of a test's name
_BACK = ("unload", "recovery")  # phases that are drawn dashed


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
        figure = canvas(width, _PANEL * rows + _FRAME * (1.6 if tight else 1.0))
        axes = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
        for axis, prediction in zip(axes.flat, shown, strict=False):
            _draw(axis, prediction)
            name = trial_name(prediction.trial, units, _NAME_LOOP_TIGHT if tight else _NAME_LOOP)
            (role, weight), gap = role_look(prediction.trial.role), "\n" if tight else " "
            axis.set_title(f"{name},{gap}{role}", loc="left", weight=weight)
        for axis in axes.flat[len(shown) :]:
            axis.set_axis_off()
        for k, axis in enumerate(axes.flat[: len(shown)]):
            axis.locator_params(nbins=5)
            if k % across == 0:
                axis.set_ylabel(force_label(units))
            if k + across >= len(shown):
                axis.set_xlabel(displacement_label(units))
                axis.tick_params(labelbottom=True)
        look: dict[str, Any] = {"ncols": 2 if tight else 4, "markerscale": 2.0}
        figure.legend(*legend_entries(figure), loc="outside upper center", **look)
    return list(axes.flat[: len(shown)])


def _draw(axis: Axes, prediction: Prediction) -> None:
    """Draw a test phase by phase, each with the sample before it, so that curves have no gap."""
    trial, model = prediction.trial, model_of(prediction)
    way = np.interp(prediction.time, trial.test.time, trial.test.displacement)
    phase = phase_index(trial.phases, prediction.time)
    draw_samples(axis, way, prediction.observed, [])
    for k, one in enumerate(trial.phases):
        rows = np.flatnonzero(phase == k)
        if not rows.size:
            continue
        if one.kind in MOVING:
            draw_band(axis, way, model, rows[np.argsort(way[rows], kind="stable")])
        rows = np.concatenate([rows[:1] - 1, rows]) if rows[0] else rows
        line, name = ("--", "model, unloading") if one.kind in _BACK else ("-", "model, loading")
        axis.plot(way[rows], model.mean[rows], line, color=model.colour, label=name, gid="mean")
