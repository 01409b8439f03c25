"""Force against time, test by test and phase by phase: measured and predicted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from qlvbayes.kinematics.phases import KINDS, Phase
from qlvbayes.plots.style import BLACK, COLOURS, DOUBLE, MM, quantity, rated, shortened, style
from qlvbayes.predict import Prediction
from qlvbayes.units import UnitSystem

_WHOLE = "whole test"
_RESTS = ("hold", "recovery")
_ROW, _FRAME = 33.0, 14.0  # mm, a row of panels and the legend
_EARLY = 0.1  # of a ramp: so much of the rest before it is shown with it
_FEW_DECADES = 50.0  # of a time axis, as a ratio: below, 2 and 5 have ticks too
_FIRST_FEW = 10  # samples, whose interval is taken
_AT_ONCE = 0.1  # of a sampling interval: a sample so early in a rest ends the movement


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Samples of a phase, the ``number``-th of its kind; ``elapsed`` (s) since it began."""

    kind: str
    number: int
    rows: np.ndarray
    elapsed: np.ndarray

    @property
    def colour(self) -> str:
        return COLOURS[self.number % len(COLOURS)]


def plot_forces(predictions: Sequence[Prediction], units: UnitSystem) -> Figure:
    """Draw what was measured in every test against what the posterior predicts.

    One row a test, slowest first, named with its loading rate and whether it was fitted or
    predicted; one column a kind of phase. Ramps and unloads run in linear time since they began,
    holds and recoveries in logarithmic time, so that milliseconds and half a minute are both seen.
    Dots are measured samples, the line is the posterior mean, the band holds 90 % of predicted
    samples. The panels of a row share their force axis.

    Where phases of a kind repeat, as in a staircase, a first wide panel shows the whole test, and
    the repeats lie over each other, numbered, in the colour that they have in the whole test. A
    rest before the first ramp is shown with that ramp, up to a tenth of its length.
    """
    with style():
        shown = sorted(predictions, key=_by_rate)
        parts = [_stretches(prediction) for prediction in shown]
        columns = _columns(parts)
        figure, axes = _panels(len(shown), columns)
        for row, prediction, stretches in zip(axes, shown, parts, strict=True):
            for axis, column in zip(row, columns, strict=True):
                _draw(axis, column, prediction, stretches)
            _label_row(row, prediction, units)
        _finish(figure, axes, columns)
        _legend(figure, axes)
    return figure


def _by_rate(prediction: Prediction) -> float:
    rate = prediction.trial.rate
    return rate if np.isfinite(rate) else np.inf


def _stretches(prediction: Prediction) -> list[_Stretch]:
    """Divide the samples among the phases; a rest before any movement goes with the first ramp."""
    time, seen = prediction.time, Counter[str]()
    phases = _joined(prediction.trial.phases)
    starts = [0, *(_first_row(time, phase) for phase in phases[1:]), time.size]
    stretches = []
    for phase, (first, stop) in zip(phases, pairwise(starts), strict=True):
        if stop > first:
            elapsed = time[first:stop] - phase.start
            rows = np.arange(first, stop)
            stretches.append(_Stretch(phase.kind, seen[phase.kind], rows, elapsed))
            seen[phase.kind] += 1
    return stretches


def _joined(phases: Sequence[Phase]) -> Sequence[Phase]:
    waits = len(phases) > 1 and phases[0].kind in _RESTS
    return phases[1:] if waits else phases


def _first_row(time: np.ndarray, phase: Phase) -> int:
    """Index of a phase's first sample: in a rest not one taken as the motion stopped."""
    first = int(np.searchsorted(time, phase.start))
    if phase.kind not in _RESTS:
        return first
    elapsed = time[first : int(np.searchsorted(time, phase.stop))][:_FIRST_FEW] - phase.start
    interval = float(np.median(np.diff(elapsed))) if elapsed.size > 1 else 0.0
    return first + int(np.sum(elapsed <= _AT_ONCE * interval))


def _columns(parts: Sequence[Sequence[_Stretch]]) -> list[str]:
    counts = [Counter(stretch.kind for stretch in stretches) for stretches in parts]
    kinds = [kind for kind in KINDS if any(kind in count for count in counts)]
    repeats = any(max(count.values()) > 1 for count in counts)
    return [_WHOLE, *kinds] if repeats else list(kinds)


def _panels(count: int, columns: Sequence[str]) -> tuple[Figure, np.ndarray]:
    figure = Figure((DOUBLE * MM, (_FRAME + _ROW * count) * MM), layout="constrained")
    widths = [1.8 if column == _WHOLE else 1.0 for column in columns]
    axes = figure.subplots(count, len(columns), sharey="row", squeeze=False, width_ratios=widths)
    return figure, axes


def _draw(axis: Axes, column: str, prediction: Prediction, stretches: Sequence[_Stretch]) -> None:
    same = [stretch for stretch in stretches if stretch.kind == column]
    if column == _WHOLE:
        _draw_whole(axis, prediction, stretches)
    elif not same:
        _blank(axis)
    elif column in _RESTS:
        _draw_rests(axis, column, prediction, same)
    else:
        _draw_movements(axis, column, prediction, same)


def _blank(axis: Axes) -> None:
    axis.set_xticks([])
    axis.tick_params(left=False)
    axis.spines[:].set_visible(False)


def _draw_whole(axis: Axes, prediction: Prediction, stretches: Sequence[_Stretch]) -> None:
    for stretch in stretches:
        joint = np.arange(max(stretch.rows[0] - 1, 0), stretch.rows[0])  # so that no gap is seen
        rows = np.concatenate([joint, stretch.rows])
        _lines(axis, prediction.time[rows], prediction, rows, stretch.colour)
    axis.set_xlabel("time (s)")


def _draw_rests(
    axis: Axes, column: str, prediction: Prediction, stretches: Sequence[_Stretch]
) -> None:
    axis.set_xscale("log")
    _overlay(axis, 1.0, prediction, stretches)
    axis.set_xlabel(f"time in {column} (s)")


def _draw_movements(
    axis: Axes, column: str, prediction: Prediction, stretches: Sequence[_Stretch]
) -> None:
    length = max(stretch.elapsed[-1] for stretch in stretches)
    scale, unit = (1e3, "ms") if length < 1.0 else (1.0, "s")
    _overlay(axis, scale, prediction, stretches)
    first = min(stretch.elapsed[0] for stretch in stretches)
    axis.set_xlim(left=scale * (max(first, -_EARLY * length) - 0.04 * length))
    axis.set_xlabel(f"time in {column} ({unit})")


def _overlay(
    axis: Axes, scale: float, prediction: Prediction, stretches: Sequence[_Stretch]
) -> None:
    for stretch in stretches:
        time = scale * stretch.elapsed
        _lines(axis, time, prediction, stretch.rows, stretch.colour)
        if len(stretches) > 1:
            _number(axis, stretch, time[-1], prediction.mean[stretch.rows[-1]])


def _number(axis: Axes, stretch: _Stretch, time: float, force: float) -> None:
    axis.annotate(
        f"{stretch.number + 1}",
        (time, force),
        xytext=(2, 0),
        textcoords="offset points",
        va="center",
        fontsize=6,
        color=stretch.colour,
        annotation_clip=False,
    )


def _lines(
    axis: Axes, time: np.ndarray, prediction: Prediction, rows: np.ndarray, colour: str
) -> None:
    low, high = prediction.low[rows], prediction.high[rows]
    dots = BLACK if colour == COLOURS[0] else colour
    axis.fill_between(
        time, low, high, color=colour, alpha=0.3, linewidth=0, label="90 % predictive band"
    )
    axis.plot(
        time,
        prediction.observed[rows],
        ".",
        color=dots,
        markersize=2.6,
        markeredgewidth=0,
        label="measured",
    )
    axis.plot(time, prediction.mean[rows], color=colour, label="posterior mean")


def _label_row(row: np.ndarray, prediction: Prediction, units: UnitSystem) -> None:
    """Left above the row: test, rate, and fitted (bold) or predicted."""
    trial = prediction.trial
    fitted = trial.role == "fit"
    speed = [rated(trial.rate, units.speed)] if np.isfinite(trial.rate) else []
    label = ", ".join([shortened(trial.name), *speed, "fitted" if fitted else "predicted"])
    row[0].set_title(label, loc="left", weight="bold" if fitted else "normal")
    row[0].set_ylabel(quantity(units.force_name, units.force))


def _finish(figure: Figure, axes: np.ndarray, columns: Sequence[str]) -> None:
    for column, name in zip(axes.T, columns, strict=True):
        column[0].set_title(f"{name}\n", weight="bold")  # the second line is the row's
        if name in _RESTS:
            _same_times(column)
    for axis in axes[:, 0]:
        axis.yaxis.set_major_locator(MaxNLocator(4))
    figure.align_ylabels(axes[:, 0])


def _same_times(axes: np.ndarray) -> None:
    """Give all tests' rests one time axis, to be compared down the column."""
    used = [axis for axis in axes if axis.lines]
    limits = np.array([axis.get_xlim() for axis in used])
    first, last = limits[:, 0].min(), limits[:, 1].max()
    for axis in used:
        axis.set_xlim(first, last)
        if last < _FEW_DECADES * first:
            axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_formatter(NullFormatter())


def _legend(figure: Figure, axes: np.ndarray) -> None:
    used = next(axis for axis in axes.flat if axis.lines)
    handles, labels = used.get_legend_handles_labels()
    figure.legend(handles[:3], labels[:3], loc="outside upper center", ncols=3, markerscale=2.0)
