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
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.firstlook.looking import ROUNDED
from qlvbayes.motion.firstlook.words import span
from qlvbayes.motion.phases import MOVING, NAMES, Phase
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

_HEIGHTS = (20.0, 14.0, 12.0)  # mm, of force, displacement and residual
_ABOVE, _BELOW, _LEFT, _RIGHT, _APART = 8.0, 9.0, 17.0, 5.0, 2.0  # mm about them
_LABELLED = 10.0  # mm left of a panel, where the lower line of its label is
_MOVED = {  # tints, by whether force is prescribed in all tests, and in any
    (False, False): ("moving in", "moving back"),
    (True, True): ("load rising", "load falling"),
    (False, True): ("moving in, or load rising", "moving back, or load falling"),
}
_HEAD = 12.0  # mm, title and legend of the figure
_MOST = 12  # tests that are drawn
_FEW_PHASES = 6  # up to which each has the same width; more are drawn in linear time
_EARLIEST, _LATEST = 1e-3, 0.1  # of a dwell: from its first reading on, and there at the
# earliest and latest, its time is logarithmic
_BINS, _ALL_BINS = 300, 1200
"""Of a phase, and of a record in linear time: of each the extremes of dense readings are drawn."""
_NAME = 34  # characters of a test's name
_FINER = {"mm": ("µm", 1e3), "um": ("nm", 1e3), "m": ("mm", 1e3), "1": ("10⁻³", 1e3)}
_SMALL = 0.1  # of a unit: below, residuals are in the finer one
_EXACT = 1e-6  # of the stroke: smaller residuals are rounding of the computer's


@dataclass(frozen=True)
class _Axis:
    """Where times of a test stand: each phase as wide as the others, or all in linear time.

    early: of each phase the share from where on the time of a dwell is logarithmic.
    """

    phases: tuple[Phase, ...]
    even: bool
    early: np.ndarray

    @classmethod
    def of(cls, trial: Trial) -> _Axis:
        """For the readings of a test."""
        time, early = trial.test.time, []
        for phase in trial.phases:
            first = min(int(np.searchsorted(time, phase.start, side="right")), time.size - 1)
            share = (float(time[first]) - phase.start) / (phase.stop - phase.start)
            early.append(min(max(share, _EARLIEST), _LATEST))
        return cls(trial.phases, len(trial.phases) <= _FEW_PHASES, np.array(early))

    def __call__(self, time: np.ndarray) -> np.ndarray:
        """Places (n,) of times (n,) in s."""
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
        """Where phases begin, and the last one ends (s)."""
        return [phase.start for phase in self.phases] + [self.phases[-1].stop]

    def times(self) -> np.ndarray:
        """Times (s) close enough for a curve."""
        if not self.even:
            return np.linspace(self.ends[0], self.ends[-1], 4 * _ALL_BINS)
        shares, found = np.linspace(0.0, 1.0, _BINS), []
        for phase, early in zip(self.phases, self.early, strict=True):
            late = early * np.expm1(shares * np.log1p(1.0 / early))
            part = shares if phase.kind in MOVING else late
            found.append(phase.start + (phase.stop - phase.start) * part)
        return np.concatenate(found)


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
    axis = _Axis.of(trial)
    left = test.displacement - path.displacement(test.time)
    unit, factor = _scale(left, units.displacement, _SMALL)
    way_unit, way = _scale(test.displacement, units.displacement, _SMALL**2)
    places = axis(test.time)
    for panel, values in zip(
        panels, (test.force, way * test.displacement, factor * left), strict=True
    ):
        _readings(panel, places, values, axis)
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


def _scale(values: np.ndarray, unit: str, small: float) -> tuple[str, float]:
    """The unit to draw in and its factor: the finer one for small values."""
    if unit in _FINER and np.max(np.abs(values)) < small:
        return _FINER[unit]
    return unit, 1.0


def _readings(panel: Axes, places: np.ndarray, values: np.ndarray, axis: _Axis) -> None:
    """Dots; of a dense record a band from the least to the largest of each of some hundred bins."""
    bins = _BINS * len(axis.phases) if axis.even else _ALL_BINS
    line = "None"
    low, high = float(np.min(values)), float(np.max(values))
    if places.size > 2 * bins:
        first = np.unique(
            np.searchsorted(places, np.linspace(places[0], places[-1], bins + 1)[:-1])
        )
        ends = np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)
        places, values, line = np.repeat(places[first], 2), np.column_stack(ends).ravel(), "-"
    panel.plot(
        places, values, marker=".", linestyle=line, linewidth=0.5, color=BLACK, markersize=1.8,
        markeredgewidth=0.0, gid="readings",
    )  # fmt: skip
    spare = 0.08 * (high - low) or 0.5 * abs(high) or 1.0
    panel.set_ylim(low - spare, high + spare)


def _residual(panel: Axes, step: float, exact: float) -> None:
    """Zero, and the encoder's step to either side; exact: what is nothing but rounding."""
    panel.axhline(0.0, color=colours()[0], linewidth=0.6)
    for side in (-step, step) if step > 0.0 else ():
        panel.axhline(side, color=GREY, linewidth=0.5, linestyle="--", gid="step")
    low, high = panel.get_ylim()
    most = max(-low, high, 1.3 * step, exact)
    panel.set_ylim(-most, most)


def _left_out(panels: Sequence[Axes], trial: Trial, axis: _Axis, way: float) -> None:
    """Grey crosses; those beyond an axis stand at its edge."""
    bad = trial.left_out
    if bad is None:
        return
    places = axis(bad.time)
    for panel, values in ((panels[0], bad.force), (panels[1], way * bad.displacement)):
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
    loaded = {trial.control == "force" for trial in trials}
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
    figure.legend(
        handles, labels, loc="upper left", ncols=4 if figure.get_figwidth() > 110 * MM else 2,
        alignment="left", title=title, title_fontproperties=title_look(), borderaxespad=0.3,
        columnspacing=1.4, handletextpad=0.5, fontsize=6.5,
    )  # fmt: skip
