"""Draw a first look at a pad's tests: readings, motion, and the readings less the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator, StrMethodFormatter

from qlvbayes.io.data import Control
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.facts import ROUNDED
from qlvbayes.motion.phases import MOVING, Phase, phase_name, span
from qlvbayes.plots.panels import GREY, LABEL
from qlvbayes.plots.phases import by_rate, trial_name
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    MM,
    colours,
    narrow,
    quantity,
    shortened,
    style,
    titled_legend,
)

_HEIGHTS = (20.0, 14.0, 12.0)  # mm: panels of force, displacement and residual
_ABOVE, _BELOW, _LEFT, _RIGHT, _APART = 8.0, 9.0, 17.0, 5.0, 2.0  # mm around them
_LABELLED = 10.0  # mm left of a panel, position of the lower line of its label
_MOVED = {  # tints, by whether force is prescribed in all tests, and in any
    (False, False): ("moving in", "moving back"),
    (True, True): ("load rising", "load falling"),
    (False, True): ("moving in, or load rising", "moving back, or load falling"),
}
_HEAD = 12.0  # mm: title and legend of the figure
_MOST = 12  # tests that are drawn
_FEW_PHASES = 6  # phases up to which each has the same width; more are drawn in linear time
_EARLIEST, _LATEST = 1e-3, 0.1  # bounds, as shares of a dwell, of its first reading, from which
# on its time is logarithmic
_BINS, _ALL_BINS = 300, 1200
"""Bins of a phase, and of a record in linear time: of dense readings the extremes are drawn."""
_NAME = 34  # characters of a test's name
_FINER = {"mm": ("µm", 1e3), "um": ("nm", 1e3), "m": ("mm", 1e3), "1": ("10⁻³", 1e3)}
_SMALL = 0.1  # in the unit: smaller residuals are drawn in the finer one
_EXACT = 1e-6  # share of the stroke: smaller residuals are rounding errors


@dataclass(frozen=True)
class _Axis:
    """Map from times of a test to positions: all phases equally wide, or all in linear time.

    ``early`` is, for each phase, the share from which on the time of a dwell is logarithmic.
    """

    phases: tuple[Phase, ...]
    even: bool
    early: np.ndarray

    @classmethod
    def from_trial(cls, trial: Trial) -> _Axis:
        """Return the axis for the readings of a test."""
        time, early = trial.whole.time, []
        for phase in trial.phases:
            first = min(int(np.searchsorted(time, phase.start, side="right")), time.size - 1)
            share = (float(time[first]) - phase.start) / (phase.stop - phase.start)
            early.append(min(max(share, _EARLIEST), _LATEST))
        return cls(trial.phases, len(trial.phases) <= _FEW_PHASES, np.array(early))

    def __call__(self, time: np.ndarray) -> np.ndarray:
        """Return positions (n,) of times (n,) in s."""
        if not self.even:
            return time
        starts = np.array([phase.start for phase in self.phases])
        own = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, starts.size - 1)
        length = np.array([phase.stop - phase.start for phase in self.phases])[own]
        share = np.clip((time - starts[own]) / length, 0.0, 1.0)
        moving = np.array([phase.kind in MOVING for phase in self.phases])[own]
        early = self.early[own]
        late = np.log1p(share / early) / np.log1p(1.0 / early)
        return np.asarray(own + np.where(moving, share, late))

    @property
    def ends(self) -> list[float]:
        """Return when phases begin, and when the last one ends (s)."""
        return [phase.start for phase in self.phases] + [self.phases[-1].stop]

    def times(self) -> np.ndarray:
        """Return times (s) close enough for a curve."""
        if not self.even:
            return np.linspace(self.ends[0], self.ends[-1], 4 * _ALL_BINS)
        shares, parts = np.linspace(0.0, 1.0, _BINS), []
        for phase, early in zip(self.phases, self.early, strict=True):
            late = early * np.expm1(shares * np.log1p(1.0 / early))
            part = shares if phase.kind in MOVING else late
            parts.append(phase.start + (phase.stop - phase.start) * part)
        return np.concatenate(parts)


def plot_look(experiment: Experiment, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the readings of each test of a pad, before anything is fitted to the force.

    The panels of each test, slowest first, are the readings of force; those of displacement with
    the motion that is taken from them; and readings less motion. Of dense records the extremes are
    drawn, so that no single reading is lost; of more than twelve tests, those with most to see.
    ``experiment`` is the pad's, ``width`` in mm; returns three panels for each test.
    """
    trials = _chosen(experiment)
    columns = 1 if narrow(width) or len(trials) == 1 else 2
    lines = -(-len(trials) // columns)
    block = _ABOVE + sum(_HEIGHTS) + _APART * (len(_HEIGHTS) - 1) + _BELOW
    height = _HEAD + block * lines
    with style():
        figure = Figure((width * MM, height * MM))
        drawn: list[Axes] = []
        for k, trial in enumerate(trials):
            line, column = divmod(k, columns)
            top = height - _HEAD - line * block - _ABOVE
            left = column * width / columns + _LEFT
            wide = width / columns - _LEFT - _RIGHT
            panels = []
            for high in _HEIGHTS:
                box = (left / width, (top - high) / height, wide / width, high / height)
                panels.append(figure.add_axes(box))
                top -= high + _APART
            _draw(panels, trial, experiment.units)
            drawn += panels
        _head(figure, experiment, trials, height)
    return drawn


def _chosen(experiment: Experiment) -> list[Trial]:
    """Return all tests, or those with bad readings or a motion that departs; slowest first."""
    doubtful = sorted(
        experiment.trials,
        key=lambda t: (t.trajectory.departure is None) + (t.left_out is None),
    )
    return sorted(doubtful[:_MOST], key=lambda t: by_rate(t.rate))


def _draw(panels: Sequence[Axes], trial: Trial, units: UnitSystem) -> None:
    test, path = trial.whole, trial.trajectory
    force = np.full(test.time.size, np.nan)  # where it is left out
    force[np.searchsorted(test.time, trial.test.time)] = trial.test.force
    axis = _Axis.from_trial(trial)
    left = test.displacement - path.displacement(test.time)
    unit, factor = _scale(left, units.displacement, _SMALL)
    way_unit, way = _scale(test.displacement, units.displacement, _SMALL**2)
    positions = axis(test.time)
    for panel, values in zip(panels, (force, way * test.displacement, factor * left), strict=True):
        _readings(panel, positions, values, axis)
    times = axis.times()
    panels[1].plot(axis(times), way * path.displacement(times), color=colours()[0], gid="motion")
    shows = np.max(np.abs(left)) > ROUNDED * path.resolution
    exact = _EXACT * factor * float(np.ptp(test.displacement))
    _residual(panels[2], path.resolution * factor if shows else 0.0, exact)
    _left_out(panels, trial, axis, way)
    _ring(panels[2], trial, axis, factor)
    for panel in panels:
        _mark(panel, axis, last=panel is panels[-1])
    _name_phases(panels[0], axis)
    for panel, name, of in (
        (panels[0], units.force_name, units.force),
        (panels[1], units.displacement_name, way_unit),
        (panels[2], "residual", unit),
    ):
        panel.set_ylabel(quantity(name, of).replace(" (", "\n("), fontsize=6.2)
        panel.yaxis.set_major_locator(MaxNLocator(3 if panel is panels[0] else 2))
        panel.yaxis.set_label_coords(-_LABELLED / _wide(panel), 0.5)
    dwells = axis.even and any(phase.kind not in MOVING for phase in trial.phases)
    label = "time (s), logarithmic in holds" if dwells else "time (s)"
    panels[2].set_xlabel(label, labelpad=1.0)
    panels[0].set_title(_title(trial, units), loc="left", pad=9.0)


def _wide(panel: Axes) -> float:
    """Return the width of a panel (mm)."""
    figure = panel.get_figure(root=True)
    assert isinstance(figure, Figure)
    return float(panel.get_position().width * figure.get_figwidth() / MM)


def _title(trial: Trial, units: UnitSystem) -> str:
    name = trial_name(trial, units, _NAME)
    return f"{name}, {units.force_name} prescribed" if trial.control == Control.FORCE else name


def _scale(values: np.ndarray, unit: str, small: float) -> tuple[str, float]:
    """Return the unit to draw in and its factor: the finer unit for small values."""
    if unit in _FINER and np.max(np.abs(values)) < small:
        return _FINER[unit]
    return unit, 1.0


def _readings(panel: Axes, positions: np.ndarray, values: np.ndarray, axis: _Axis) -> None:
    """Draw dots, or for a dense record a band between the extremes of some hundred bins."""
    bins = _BINS * len(axis.phases) if axis.even else _ALL_BINS
    line = "None"
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if positions.size > 2 * bins:
        first = np.unique(
            np.searchsorted(positions, np.linspace(positions[0], positions[-1], bins + 1)[:-1])
        )
        ends = np.fmin.reduceat(values, first), np.fmax.reduceat(values, first)
        positions, values, line = np.repeat(positions[first], 2), np.column_stack(ends).ravel(), "-"
    panel.plot(
        positions, values, marker=".", linestyle=line, linewidth=0.5, color=BLACK, markersize=1.8,
        markeredgewidth=0.0, gid="readings",
    )  # fmt: skip
    spare = 0.08 * (high - low) or 0.5 * abs(high) or 1.0
    panel.set_ylim(low - spare, high + spare)


def _residual(panel: Axes, step: float, exact: float) -> None:
    """Draw zero, and the encoder's step on either side; ``exact`` is mere rounding error."""
    panel.axhline(0.0, color=colours()[0], linewidth=0.6)
    for side in (-step, step) if step > 0.0 else ():
        panel.axhline(side, color=GREY, linewidth=0.5, linestyle="--", gid="step")
    low, high = panel.get_ylim()
    most = max(-low, high, 1.3 * step, exact)
    panel.set_ylim(-most, most)
    panel.yaxis.set_major_formatter(StrMethodFormatter("{x:.3g}"))  # no power of ten apart


def _left_out(panels: Sequence[Axes], trial: Trial, axis: _Axis, way: float) -> None:
    """Draw grey crosses; those beyond an axis are at its edge."""
    bad = trial.left_out
    if bad is None:
        return
    force = [k for k, _ in bad.drawn]
    displacement = [k for k, run in bad.drawn if run.kind != "excluded"]  # of which it counts
    channels = ((bad.force, force), (way * bad.displacement, displacement))
    for panel, (values, rows) in zip(panels, channels, strict=False):
        if rows:
            panel.plot(
                axis(bad.time[rows]), np.clip(values[rows], *panel.get_ylim()), "x", color=GREY,
                markersize=4.5, markeredgewidth=0.9, clip_on=False, zorder=4, gid=LABEL,
            )  # fmt: skip


def _ring(panel: Axes, trial: Trial, axis: _Axis, factor: float) -> None:
    """Draw a ring where the motion departs from the readings."""
    off = trial.trajectory.departure
    if off is None:
        return
    test = trial.whole
    row = int(np.argmin(np.abs(test.time - off.time)))
    left = test.displacement[row] - trial.trajectory.displacement(test.time[row])
    panel.plot(
        axis(np.array([off.time])), [factor * float(left)], "o", markerfacecolor="none",
        color=colours()[1], markersize=6.0, markeredgewidth=0.9, clip_on=False, gid="departure",
    )  # fmt: skip


def _mark(panel: Axes, axis: _Axis, *, last: bool) -> None:
    """Draw movements on a tint, and times where phases begin."""
    ends = np.array(axis.ends)
    positions = np.arange(ends.size, dtype=float) if axis.even else ends
    for k, phase in enumerate(axis.phases):
        if phase.kind in MOVING:
            colour = colours()[0] if phase.kind == "ramp" else colours()[1]
            panel.axvspan(positions[k], positions[k + 1], color=colour, alpha=0.1, linewidth=0)
    panel.set_xlim(positions[0], positions[-1])
    if axis.even:
        panel.xaxis.set_major_locator(FixedLocator(list(positions)))
        panel.xaxis.set_minor_locator(NullLocator())
        panel.set_xticks(positions, [_clock(time) for time in ends] if last else [""] * ends.size)
    else:
        panel.xaxis.set_major_locator(MaxNLocator(6))
        panel.tick_params(labelbottom=last)


def _clock(time: float) -> str:
    return plain(time, 3 if abs(time) < 1.0 else 4) if abs(time) >= 1e-9 else "0"


def _name_phases(panel: Axes, axis: _Axis) -> None:
    if not axis.even:
        return
    for k, phase in enumerate(axis.phases):
        name = phase_name(phase.kind, phase.control)
        text = f"{name} {span(phase.stop - phase.start)}"
        panel.annotate(
            text, (k + 0.5, 1.0), xycoords=("data", "axes fraction"), xytext=(0.0, 2.0),
            textcoords="offset points", ha="center", fontsize=5.5, color="#555555",
        )  # fmt: skip


def _head(figure: Figure, experiment: Experiment, trials: Sequence[Trial], height: float) -> None:
    pad, count = shortened(experiment.pad), len(experiment.trials)
    title = f"pad {pad}: first look"
    if len(trials) < count:
        title += f" at {len(trials)} of {count} tests"
    handles: list[Any] = [
        Line2D([], [], color=BLACK, marker=".", linestyle="None", markersize=3.5),
        Line2D([], [], color=colours()[0]),
        Patch(color=colours()[0], alpha=0.2, linewidth=0),
    ]
    loaded = {
        phase.control == Control.FORCE
        for trial in trials
        for phase in trial.phases
        if phase.kind in MOVING
    } or {False}
    rising, falling = _MOVED[min(loaded), max(loaded)]
    labels = ["readings", "motion taken from them", rising]
    if any(phase.kind == "unload" for trial in trials for phase in trial.phases):
        handles.append(Patch(color=colours()[1], alpha=0.2, linewidth=0))
        labels.append(falling)
    if any(line.get_gid() == "step" for panel in figure.axes for line in panel.lines):
        handles.append(Line2D([], [], color=GREY, linestyle="--", linewidth=0.6))
        labels.append("step of the encoder")
    if any(trial.left_out is not None for trial in trials):
        handles.append(Line2D([], [], color=GREY, marker="x", linestyle="None", markersize=4.0))
        labels.append(LABEL)
    if any(trial.trajectory.departure is not None for trial in trials):
        handles.append(
            Line2D([], [], color=colours()[1], marker="o", linestyle="None", markerfacecolor="none")
        )
        labels.append("motion departs")
    titled_legend(
        figure, title, handles, labels, loc="upper left",
        ncols=4 if figure.get_figwidth() > 110 * MM else 2, borderaxespad=0.3,
        columnspacing=1.4, handletextpad=0.5, fontsize=6.5,
    )  # fmt: skip
