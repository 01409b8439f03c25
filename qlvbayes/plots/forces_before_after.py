"""Draw force against time, measured and by two models, with the models' residuals."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.special import ndtri

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.summary.curves import Curve, curves
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.plots.forces import finish
from qlvbayes.plots.naming import heading, model_lines
from qlvbayes.plots.panels import LABEL, Model, PhaseTime, Sheet, by_rate, draw_samples, trial_name
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    MM,
    PLAIN,
    colours,
    force_label,
    narrow,
    style,
    titled_legend,
)

_HEIGHTS = (22.0, 15.0)  # mm: a panel of force and one of residuals
_HEAD, _HEAD_TIGHT = 13.0, 21.0  # mm: title, of one line or of two, and legend
_LINE = 4.5  # mm: a further line of the title
_NAME, _NAME_TIGHT = 40, 24  # characters of a test's name
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
            name = trial_name(one.trial, units, _NAME_TIGHT if tight else _NAME)
            panels[0].set_title(name, loc="left", pad=10.0)
        _legend(sheet.figure, diagnosis.result, len(_models(shown[0])), tight=tight)
    return [axis for panels in sheet.blocks for axis in panels]


def _models(curve: Curve) -> list[Model]:
    """Return the baseline model where effects were added, and the last model."""
    final, plain = curve.final, curve.baseline
    last = Model(final.mean, final.low, final.high, colours()[0])
    first = Model(plain.mean, plain.low, plain.high, PLAIN, "--")
    return [last] if final is plain else [first, last]


def _legend(figure: Figure, diagnosis: DiagnosisResult, count: int, *, tight: bool) -> None:
    handles: list[Any] = [
        Line2D([], [], color=BLACK, marker=".", linestyle="None", markeredgewidth=0, markersize=5),
        Patch(color="0.88", linewidth=0),
    ]
    labels = ["measured", "90 % of the noise floor"]
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
