"""A first look at a pad's tests: readings, motion, and what the motion leaves of the readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.plots.leftout import GREY, LABEL
from qlvbayes.plots.stretches import by_rate
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    MM,
    colours,
    narrow,
    quantity,
    rated,
    shortened,
    style,
    title_look,
)
from qlvbayes.preprocess.experiment import Experiment, Trial
from qlvbayes.preprocess.firstlook.looking import ROUNDED
from qlvbayes.preprocess.firstlook.words import span
from qlvbayes.preprocess.phases import MOVING, NAMES, Phase

_HEIGHTS = (20.0, 14.0, 12.0)  # mm, of force, displacement and residual
_ABOVE, _BELOW, _LEFT, _RIGHT, _APART = 8.0, 9.0, 17.0, 5.0, 2.0  # mm about them
_LABELLED = 10.0  # mm left of a panel, where the lower line of its label is
_HEAD = 13.0  # mm, title and legend of the figure
_MOST = 12  # tests that are drawn
_FEW_PHASES = 6  # up to which each has the same width; more are drawn in linear time
_DECADES = 1e-3  # of a dwell: from there on its time is logarithmic
_BINS = 300  # of a phase, or 1200 of a record in linear time, of each of which the extremes are
_ALL_BINS = 1200  # drawn
_NAME = 34  # characters of a test's name
_FINER = {"mm": ("µm", 1e3), "um": ("nm", 1e3), "m": ("mm", 1e3), "1": ("10⁻³", 1e3)}
_SMALL = 0.1  # of a unit: below, residuals are in the finer one


@dataclass(frozen=True)
class _Axis:
    """Where times of a test stand: each phase as wide as the others, or all in linear time."""

    phases: tuple[Phase, ...]
    even: bool

    def __call__(self, time: np.ndarray) -> np.ndarray:
        """Places (n,) of times (n,) in s."""
        if not self.even:
            return time
        starts = np.array([phase.start for phase in self.phases])
        own = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, starts.size - 1)
        length = np.array([phase.stop - phase.start for phase in self.phases])[own]
        share = np.clip((time - starts[own]) / length, 0.0, 1.0)
        moving = np.array([phase.kind in MOVING for phase in self.phases])[own]
        late = np.log1p(share / _DECADES) / np.log1p(1.0 / _DECADES)
        return np.asarray(own + np.where(moving, share, late))

    @property
    def ends(self) -> list[float]:
        """Where phases begin, and the last one ends (s)."""
        return [phase.start for phase in self.phases] + [self.phases[-1].stop]

    def times(self) -> np.ndarray:
        """Times (s) close enough for a curve."""
        if not self.even:
            return np.linspace(self.ends[0], self.ends[-1], 4 * _ALL_BINS)
        shares = np.linspace(0.0, 1.0, _BINS)
        late = _DECADES * np.expm1(shares * np.log1p(1.0 / _DECADES))
        return np.concatenate(
            [
                phase.start
                + (phase.stop - phase.start) * (shares if phase.kind in MOVING else late)
                for phase in self.phases
            ]
        )


def plot_look(experiment: Experiment, *, width: float = DOUBLE) -> list[Axes]:
    """Draw what was read in each test of a pad, before anything is fitted to the force.

    Of each test, slowest first: the readings of force; those of displacement with the motion that
    is taken from them; and readings less motion, with the encoder's step. Phases are marked; each
    has the same width, holds in logarithmic time, where there are six or fewer: else time is
    linear. Of dense records the extremes are drawn, so that no lone reading is lost. Grey crosses
    are readings that were left out; a ring is where the motion is farther from readings than their
    errors explain. Of more than twelve tests those with most to see are drawn. width: of the
    figure (mm). Returns the panels, three a test.
    """
    trials = _chosen(experiment)
    columns = 1 if narrow(width) or len(trials) == 1 else 2
    lines = -(-len(trials) // columns)
    block = _ABOVE + sum(_HEIGHTS) + _APART * (len(_HEIGHTS) - 1) + _BELOW
    height = _HEAD + block * lines
    with style():
        figure = Figure((width * MM, height * MM))
        found: list[Axes] = []
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
            found += panels
        _head(figure, experiment, trials, height)
    return found


def _chosen(experiment: Experiment) -> list[Trial]:
    """All, or those with bad readings or a motion that departs, and others; slowest first."""
    doubtful = sorted(
        experiment.trials,
        key=lambda t: (t.trajectory.departure is None) + (t.left_out is None),
    )
    return sorted(doubtful[:_MOST], key=lambda t: by_rate(t.rate))


def _draw(panels: Sequence[Axes], trial: Trial, units: UnitSystem) -> None:
    test, path = trial.test, trial.trajectory
    axis = _Axis(trial.phases, len(trial.phases) <= _FEW_PHASES)
    left = test.displacement - path.displacement(test.time)
    unit, factor = units.displacement, 1.0
    if unit in _FINER and np.max(np.abs(left)) < _SMALL:
        unit, factor = _FINER[unit]
    elif units.dimensionless:
        unit = ""
    dots: dict[str, Any] = {"color": BLACK, "markersize": 1.8, "markeredgewidth": 0.0}
    places = axis(test.time)
    for panel, values in zip(panels, (test.force, test.displacement, factor * left), strict=True):
        panel.plot(*_thinned(places, values, axis), ".", **dots, gid="readings")
        _margins(panel, values)
    times = axis.times()
    panels[1].plot(axis(times), path.displacement(times), color=colours()[0], gid="motion")
    shows = np.max(np.abs(left)) > ROUNDED * path.resolution
    _residual(panels[2], path.resolution * factor if shows else 0.0)
    _left_out(panels, trial, axis)
    _ring(panels[2], trial, axis, factor)
    for panel in panels:
        _mark(panel, axis, last=panel is panels[-1])
    _name_phases(panels[0], axis)
    for panel, name, of in (
        (panels[0], units.force_name, units.force),
        (panels[1], units.displacement_name, units.displacement),
        (panels[2], "residual", unit or "1"),
    ):
        panel.set_ylabel(quantity(name, of).replace(" (", "\n("), fontsize=6.2)
        panel.yaxis.set_major_locator(MaxNLocator(3 if panel is panels[0] else 2))
        panel.yaxis.set_label_coords(-_LABELLED / _wide(panel), 0.5)
    dwells = axis.even and any(phase.kind not in MOVING for phase in trial.phases)
    label = "time (s), logarithmic in holds" if dwells else "time (s)"
    panels[2].set_xlabel(label, labelpad=1.0)
    panels[0].set_title(_title(trial, units), loc="left", pad=9.0)


def _wide(panel: Axes) -> float:
    """Its width (mm)."""
    figure = panel.get_figure(root=True)
    assert isinstance(figure, Figure)
    return float(panel.get_position().width * figure.get_figwidth() / MM)


def _title(trial: Trial, units: UnitSystem) -> str:
    words = [shortened(trial.name, _NAME)]
    if np.isfinite(trial.rate):
        words.append(rated(trial.rate, units.speed))
    if trial.control == "force":
        words.append(f"{units.force_name} prescribed")
    return ", ".join(words)


def _thinned(places: np.ndarray, values: np.ndarray, axis: _Axis) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest of each of some hundred bins; all where there are no more."""
    bins = _BINS * len(axis.phases) if axis.even else _ALL_BINS
    if places.size <= 2 * bins:
        return places, values
    edges = np.linspace(places[0], places[-1], bins + 1)[:-1]
    first = np.unique(np.searchsorted(places, edges))
    low, high = np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)
    at = places[first]
    return np.concatenate([at, at]), np.concatenate([low, high])


def _margins(panel: Axes, values: np.ndarray) -> None:
    low, high = float(np.min(values)), float(np.max(values))
    spare = 0.08 * (high - low) or 0.5 * abs(high) or 1.0
    panel.set_ylim(low - spare, high + spare)


def _residual(panel: Axes, step: float) -> None:
    """Zero, and the encoder's step to either side."""
    panel.axhline(0.0, color=colours()[0], linewidth=0.6)
    for side in (-step, step) if step > 0.0 else ():
        panel.axhline(side, color=GREY, linewidth=0.5, linestyle="--", gid="step")
    low, high = panel.get_ylim()
    most = max(-low, high, 1.3 * step)
    panel.set_ylim(-most, most)


def _left_out(panels: Sequence[Axes], trial: Trial, axis: _Axis) -> None:
    """Grey crosses; those beyond an axis stand at its edge."""
    bad = trial.left_out
    if bad is None:
        return
    places = axis(bad.time)
    for panel, values in ((panels[0], bad.force), (panels[1], bad.displacement)):
        panel.plot(
            places, np.clip(values, *panel.get_ylim()), "x", color=GREY, markersize=4.5,
            markeredgewidth=0.9, clip_on=False, zorder=4, gid=LABEL,
        )  # fmt: skip


def _ring(panel: Axes, trial: Trial, axis: _Axis, factor: float) -> None:
    """Where the motion departs from the readings."""
    off = trial.trajectory.departure
    if off is None:
        return
    row = int(np.argmin(np.abs(trial.test.time - off.time)))
    left = trial.test.displacement[row] - trial.trajectory.displacement(trial.test.time[row])
    panel.plot(
        axis(np.array([off.time])), [factor * float(left)], "o", markerfacecolor="none",
        color=colours()[1], markersize=6.0, markeredgewidth=0.9, clip_on=False, gid="departure",
    )  # fmt: skip


def _mark(panel: Axes, axis: _Axis, *, last: bool) -> None:
    """Movements on a tint, and times where phases begin."""
    ends = np.array(axis.ends)
    places = np.arange(ends.size, dtype=float) if axis.even else ends
    for k, phase in enumerate(axis.phases):
        if phase.kind in MOVING:
            colour = colours()[0] if phase.kind == "ramp" else colours()[1]
            panel.axvspan(places[k], places[k + 1], color=colour, alpha=0.1, linewidth=0)
    panel.set_xlim(places[0], places[-1])
    if axis.even:
        panel.xaxis.set_major_locator(FixedLocator(list(places)))
        panel.xaxis.set_minor_locator(NullLocator())
        panel.set_xticks(places, [_clock(time) for time in ends] if last else [""] * ends.size)
    else:
        panel.xaxis.set_major_locator(MaxNLocator(6))
        panel.tick_params(labelbottom=last)


def _clock(time: float) -> str:
    return plain(time, 3 if abs(time) < 1.0 else 4) if abs(time) >= 1e-9 else "0"


def _name_phases(panel: Axes, axis: _Axis) -> None:
    if not axis.even:
        return
    for k, phase in enumerate(axis.phases):
        text = f"{NAMES[phase.kind]} {span(phase.stop - phase.start)}"
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
    labels = ["readings", "motion taken from them", "moving in"]
    if any(phase.kind == "unload" for trial in trials for phase in trial.phases):
        handles.append(Patch(color=colours()[1], alpha=0.2, linewidth=0))
        labels.append("moving back")
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
    figure.legend(
        handles, labels, loc="upper left", ncols=4 if figure.get_figwidth() > 110 * MM else 2,
        alignment="left", title=title, title_fontproperties=title_look(), borderaxespad=0.3,
        columnspacing=1.4, handletextpad=0.5, fontsize=6.5,
    )  # fmt: skip
