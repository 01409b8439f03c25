"""Draw readings before anything is fitted: of a pad's tests, and of machine files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, StrMethodFormatter

from qlvbayes.io.conversion import Conversion
from qlvbayes.io.data import Control
from qlvbayes.io.loading import Loaded
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import pad_title
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.facts import ROUNDED
from qlvbayes.motion.phases import MOVING
from qlvbayes.plots.panels import (
    GREY,
    PhaseTime,
    Sheet,
    by_rate,
    legend_entries,
    mark_left_out,
    trial_name,
)
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    MM,
    canvas,
    colours,
    displacement_label,
    force_label,
    narrow,
    quantity,
    shortened,
    style,
    titled_legend,
)

_HEIGHTS = (20.0, 14.0, 12.0)  # mm: panels of force, displacement and residual
_MOVED = {  # tints, by whether force is prescribed in all tests, and in any
    (False, False): ("moving in", "moving back"),
    (True, True): ("load rising", "load falling"),
    (False, True): ("moving in, or load rising", "moving back, or load falling"),
}
_HEAD = 12.0  # mm: title and legend of the figure
_MOST = 12  # tests that are drawn
_BINS, _ALL_BINS = 300, 1200
"""Bins of a phase, and of a record in linear time: of dense readings the extremes are drawn."""
_NAME = 34  # characters of a test's name
_FINER = {"mm": ("µm", 1e3), "um": ("nm", 1e3), "m": ("mm", 1e3), "1": ("10⁻³", 1e3)}
_SMALL = 0.1  # in the unit: smaller residuals are drawn in the finer one
_EXACT = 1e-6  # share of the stroke: smaller residuals are rounding errors


def plot_look(experiment: Experiment, *, width: float = DOUBLE) -> list[Axes]:
    """Draw the readings of each test of a pad, before anything is fitted to the force.

    The panels of each test, slowest first, are the readings of force; those of displacement with
    the motion that is taken from them; and readings less motion. Of dense records the extremes are
    drawn, so that no single reading is lost; of more than twelve tests, those with most to see.
    ``experiment`` is the pad's, ``width`` in mm; returns three panels for each test.
    """
    trials = _chosen(experiment)
    columns = 1 if narrow(width) or len(trials) == 1 else 2
    with style():
        sheet = Sheet.of(width, len(trials), _HEIGHTS, head=_HEAD, columns=columns)
        for panels, trial in zip(sheet.blocks, trials, strict=True):
            _draw(sheet, panels, trial, experiment.units)
        _head(sheet.figure, experiment, trials)
    return [panel for panels in sheet.blocks for panel in panels]


def _chosen(experiment: Experiment) -> list[Trial]:
    """Return all tests, or those with bad readings or a motion that departs; slowest first."""
    doubtful = sorted(
        experiment.trials, key=lambda t: (t.trajectory.departure is None) + (t.left_out is None)
    )
    return sorted(doubtful[:_MOST], key=lambda trial: by_rate(trial.rate))


def _draw(sheet: Sheet, panels: Sequence[Axes], trial: Trial, units: UnitSystem) -> None:
    test, path, time = trial.whole, trial.trajectory, PhaseTime.of(trial, sheet.wide)
    force = np.full(test.time.size, np.nan)  # where it is left out
    force[np.searchsorted(test.time, trial.test.time)] = trial.test.force
    left = test.displacement - path.displacement(test.time)
    unit, factor = _scale(left, units.displacement, _SMALL)
    way_unit, way = _scale(test.displacement, units.displacement, _SMALL**2)
    positions = time(test.time)
    bins = _BINS * len(trial.phases) if time.side_by_side else _ALL_BINS
    for panel, values in zip(panels, (force, way * test.displacement, factor * left), strict=True):
        _readings(panel, positions, values, bins)
    times = time.times(_BINS)
    panels[1].plot(
        time(times),
        way * path.displacement(times),
        color=colours()[0],
        gid="motion",
        label="motion taken from them",
    )
    shows = np.max(np.abs(left)) > ROUNDED * path.resolution
    exact = _EXACT * factor * float(np.ptp(test.displacement))
    _residual(panels[2], path.resolution * factor if shows else 0.0, exact)
    _left_out(panels, trial, time, way)
    _ring(panels[2], trial, time, factor)
    for panel, name, of in (
        (panels[0], units.force_name, units.force),
        (panels[1], units.displacement_name, way_unit),
        (panels[2], "residual", unit),
    ):
        time.mark(panel, sheet.wide, last=panel is panels[-1], moved=_moved(trial))
        sheet.label(panel, quantity(name, of).replace(" (", "\n("), fontsize=6.2)
        panel.yaxis.set_major_locator(MaxNLocator(3 if panel is panels[0] else 2))
    time.name_phases(panels[0], sheet.wide)
    panels[0].set_title(_title(trial, units), loc="left", pad=9.0)


def _moved(trial: Trial) -> tuple[str, str]:
    """Return the names of the tints, by whether force is prescribed while the test moves."""
    loaded = {p.control == Control.FORCE for p in trial.phases if p.kind in MOVING} or {False}
    return _MOVED[min(loaded), max(loaded)]


def _title(trial: Trial, units: UnitSystem) -> str:
    name = trial_name(trial, units, _NAME)
    return f"{name}, {units.force_name} prescribed" if trial.control == Control.FORCE else name


def _scale(values: np.ndarray, unit: str, small: float) -> tuple[str, float]:
    """Return the unit to draw in and its factor: the finer unit for small values."""
    if unit in _FINER and np.max(np.abs(values)) < small:
        return _FINER[unit]
    return unit, 1.0


def _readings(panel: Axes, positions: np.ndarray, values: np.ndarray, bins: int) -> None:
    """Draw dots, or for a dense record a band between the extremes of some hundred bins."""
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
        markeredgewidth=0.0, gid="readings", label="readings",
    )  # fmt: skip
    spare = 0.08 * (high - low) or 0.5 * abs(high) or 1.0
    panel.set_ylim(low - spare, high + spare)


def _residual(panel: Axes, step: float, exact: float) -> None:
    """Draw zero, and the encoder's step on either side; ``exact`` is mere rounding error."""
    panel.axhline(0.0, color=colours()[0], linewidth=0.6)
    for side in (-step, step) if step > 0.0 else ():
        panel.axhline(
            side, color=GREY, linewidth=0.5, linestyle="--", gid="step", label="step of the encoder"
        )
    low, high = panel.get_ylim()
    most = max(-low, high, 1.3 * step, exact)
    panel.set_ylim(-most, most)
    panel.yaxis.set_major_formatter(StrMethodFormatter("{x:.3g}"))  # no power of ten apart


def _left_out(panels: Sequence[Axes], trial: Trial, time: PhaseTime, way: float) -> None:
    bad = trial.left_out
    if bad is None:
        return
    force = bad.drawn
    displacement = force[~bad.excluded[force]]  # of the others it counts
    channels = ((bad.force, force), (way * bad.displacement, displacement))
    for panel, (values, rows) in zip(panels, channels, strict=False):
        if rows.size:
            mark_left_out(panel, time(bad.time[rows]), values[rows])


def _ring(panel: Axes, trial: Trial, time: PhaseTime, factor: float) -> None:
    """Draw a ring where the motion departs from the readings."""
    off = trial.trajectory.departure
    if off is None:
        return
    test = trial.whole
    row = int(np.argmin(np.abs(test.time - off.time)))
    left = test.displacement[row] - trial.trajectory.displacement(test.time[row])
    panel.plot(
        time(np.array([off.time])), [factor * float(left)], "o", markerfacecolor="none",
        color=colours()[1], markersize=6.0, markeredgewidth=0.9, clip_on=False, gid="departure",
        label="motion departs",
    )  # fmt: skip


def _head(figure: Figure, experiment: Experiment, trials: Sequence[Trial]) -> None:
    pad, count = shortened(experiment.pad), len(experiment.trials)
    title = f"{pad_title(pad)}: first look"
    if len(trials) < count:
        title += f" at {len(trials)} of {count} tests"
    look: dict[str, Any] = {"columnspacing": 1.4, "handletextpad": 0.5, "fontsize": 6.5}
    titled_legend(
        figure, title, *legend_entries(figure), loc="upper left", markerscale=1.5,
        ncols=4 if figure.get_figwidth() > 110 * MM else 2, borderaxespad=0.3, **look,
    )  # fmt: skip


_PANEL = 36.0  # mm, height of a row of panels
_FRAME = 10.0  # mm, above the panels
_MOST_CONVERTED = 8  # tests that are drawn; the others are counted in the title
_SHOWN = 3000  # samples of a curve; more are not visible
_NEAR = 0.3  # share of the peak force up to which the rise at contact is shown
_WIDE = 1.645  # standard errors on either side that hold 90 %


def plot_conversion(conversion: Conversion, *, width: float = DOUBLE) -> list[Axes]:
    """Draw displacement and force against time, and the force's rise at contact, test by test.

    ``conversion`` is that of machine files, ``width`` in mm; returns three panels for each test. A
    band shows first contact with its 90 % interval, where there is an approach.
    """
    tests = conversion.tests[:_MOST_CONVERTED]
    tight = narrow(width)
    rows, columns = (3 * len(tests), 1) if tight else (len(tests), 3)
    with style():
        height = _FRAME + _PANEL * rows
        figure = canvas(width, height)
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for k, test in enumerate(tests):
            _draw_converted(list(axes[3 * k : 3 * k + 3]), test)
        left = len(conversion.tests) - len(tests)
        more = f"; {left} more tests are not drawn" if left else ""
        figure.suptitle(f"read from machine files{more}", x=0.01, ha="left")
    return list(axes)


def _draw_converted(axes: Sequence[Axes], test: Loaded) -> None:
    over_time, force_over_time, rise = axes
    shown = slice(None, None, -(-len(test.time) // _SHOWN))
    first, second = colours()[:2]
    way = displacement_label(test.units)
    load = force_label(test.units)
    over_time.plot(test.time[shown], test.displacement[shown], color=first, gid="displacement")
    force_over_time.plot(test.time[shown], test.force[shown], color=second, gid="force")
    over_time.set_title(f"{shortened(test.pad, 20)}, {shortened(test.test)}", loc="left")
    for axis, label in ((over_time, way), (force_over_time, load)):
        axis.set(xlabel="time (s)", ylabel=label)
    peak = int(np.argmax(test.force >= _NEAR * test.force.max()))
    near = slice(0, max(peak + 1, 2))
    rise.plot(
        test.displacement[near], test.force[near], ".", markersize=2, color=second, gid="rise"
    )
    rise.axvline(0.0, color=BLACK, linewidth=0.5, gid="zero")
    rise.set(xlabel=way, ylabel=load)
    if test.contact is not None:
        contact = test.contact.position - test.zero
        half = _WIDE * test.contact.sd
        rise.axvspan(
            contact - half, contact + half, color=first, alpha=0.25, linewidth=0, gid="contact"
        )
        rise.set_title("first contact, with its 90 % interval", loc="left")
