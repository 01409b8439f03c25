"""Divide a test's samples into phases, and into the columns of panels that show them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import rated
from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.phases import KINDS, Phase, phase_index
from qlvbayes.plots.style import BLACK, shortened

WHOLE = "whole test"
DWELLS = ("hold", "recovery")
_EARLY = 0.1  # length of the rest that is shown before a ramp, over the ramp's
_FEW_DECADES = 50.0  # ratio of a time axis's ends below which 2 and 5 have ticks too
_FIRST_FEW = 10  # samples from which the sampling interval is taken
_ROOM = 0.12  # height of a number over that of its panel
_AT_ONCE = 0.1  # share of a sampling interval: a sample so early in a dwell ends the movement


@dataclass(frozen=True, eq=False)
class PhaseSamples:
    """Samples of a phase, the ``number``-th of its kind.

    ``elapsed`` is the time (s) since the phase began.
    """

    kind: str
    number: int
    rows: np.ndarray
    elapsed: np.ndarray


@dataclass(frozen=True, eq=False)
class PanelSamples:
    """Samples in a panel: their phase, their rows in the test and their times."""

    part: PhaseSamples
    rows: np.ndarray
    time: np.ndarray


def trial_name(trial: Trial, units: UnitSystem, most: int) -> str:
    """Return a test's name, in ``most`` characters at most, with its loading rate if it has one."""
    name = shortened(trial.name, most)
    return f"{name}, {rated(trial.rate, units.speed)}" if np.isfinite(trial.rate) else name


def role_look(role: str) -> tuple[str, str]:
    """Return whether a test was fitted or predicted, and the weight of the letters that say so."""
    return ("fitted", "bold") if role == "fit" else ("predicted", "normal")


def divide(time: np.ndarray, phases: Sequence[Phase]) -> list[PhaseSamples]:
    """Divide the samples among the phases; a dwell before any movement goes with the first ramp."""
    seen = Counter[str]()
    phases = _joined(phases)
    starts = [0, *(_first_row(time, phase) for phase in phases[1:]), time.size]
    parts = []
    for phase, (first, stop) in zip(phases, pairwise(starts), strict=True):
        if stop > first:
            elapsed = time[first:stop] - phase.start
            rows = np.arange(first, stop)
            parts.append(PhaseSamples(phase.kind, seen[phase.kind], rows, elapsed))
        seen[phase.kind] += 1
    return parts


def _joined(phases: Sequence[Phase]) -> Sequence[Phase]:
    waits = len(phases) > 1 and phases[0].kind in DWELLS
    return phases[1:] if waits else phases


def _first_row(time: np.ndarray, phase: Phase) -> int:
    """Return the index of a phase's first sample."""
    first = int(np.searchsorted(time, phase.start))
    if phase.kind not in DWELLS:
        return first
    elapsed = time[first : int(np.searchsorted(time, phase.stop))][:_FIRST_FEW] - phase.start
    interval = float(np.median(np.diff(elapsed))) if elapsed.size > 1 else 0.0
    return first + int(np.sum(elapsed <= _AT_ONCE * interval))


def columns(tests: Iterable[Sequence[PhaseSamples]]) -> list[str]:
    """Return the kinds of phase that occur; the whole test precedes them where a kind repeats."""
    counts = [Counter(part.kind for part in parts) for parts in tests]
    kinds = [kind for kind in KINDS if any(kind in count for count in counts)]
    repeats = any(max(count.values()) > 1 for count in counts)
    return [WHOLE, *kinds] if repeats else list(kinds)


def panel_samples(
    column: str, time: np.ndarray, parts: Sequence[PhaseSamples]
) -> list[PanelSamples]:
    """Return the samples that a column shows: the whole test, or a kind of phase since it began."""
    if column == WHOLE:
        return [_continued(time, part) for part in parts]
    same = [part for part in parts if part.kind == column]
    scale, _ = _scale(column, same)
    return [PanelSamples(part, part.rows, scale * part.elapsed) for part in same]


def panel_times(
    column: str, times: np.ndarray, phases: Sequence[Phase], parts: Sequence[PhaseSamples]
) -> np.ndarray:
    """Return where a column shows other times (k,) of a test (s), NaN where it does not."""
    if column == WHOLE:
        return times
    scale, _ = _scale(column, [part for part in parts if part.kind == column])
    joined = _joined(phases)
    own = phase_index(joined, times)
    elapsed = times - np.array([phase.start for phase in joined])[own]
    kinds = np.array([phase.kind for phase in joined])[own]
    there = (kinds == column) & ((elapsed > 0.0) | (column not in DWELLS))
    return np.where(there, scale * elapsed, np.nan)


def _continued(time: np.ndarray, part: PhaseSamples) -> PanelSamples:
    """Return the samples with the one before, so that the curve has no gap."""
    first = part.rows[0]
    rows = np.concatenate([np.arange(max(first - 1, 0), first), part.rows])
    return PanelSamples(part, rows, time[rows])


def _scale(column: str, same: Sequence[PhaseSamples]) -> tuple[float, str]:
    """Return factor and unit of a time axis: milliseconds for a movement of less than a second."""
    quick = column not in DWELLS and bool(same) and _length(same) < 1.0
    return (1e3, "ms") if quick else (1.0, "s")


def _length(same: Sequence[PhaseSamples]) -> float:
    return float(max(part.elapsed[-1] for part in same))


def number_repeats(
    axis: Axes,
    shown: Sequence[PanelSamples],
    force: np.ndarray,
    palette: Sequence[str] = (BLACK,),
    *,
    fontsize: float,
) -> None:
    """Number the repeats where each ends in a test's force (n,), as far as there is room."""
    low, high = axis.get_ylim()
    taken: list[float] = []
    for samples in shown:
        end, number = float(force[samples.rows[-1]]), samples.part.number
        if any(abs(end - other) < _ROOM * (high - low) for other in taken):
            continue
        taken.append(end)
        axis.annotate(
            f"{number + 1}",
            (samples.time[-1], end),
            xytext=(2, 0),
            textcoords="offset points",
            va="center",
            fontsize=fontsize,
            color=palette[number % len(palette)],
            annotation_clip=False,
        )


def finish_time(
    axis: Axes, column: str, parts: Sequence[PhaseSamples], *, tight: bool = False
) -> None:
    """Scale and label the time axis of a panel that has been drawn; blank it if nothing was."""
    if column == WHOLE:
        axis.set_xlabel("time (s)")
        return
    same = [part for part in parts if part.kind == column]
    if not same:
        _blank(axis)
        return
    scale, unit = _scale(column, same)
    if column in DWELLS:
        axis.set_xscale("log")
    else:
        first, length = min(part.elapsed[0] for part in same), _length(same)
        axis.set_xlim(left=scale * (max(first, -_EARLY * length) - 0.04 * length))
    gap = "\n" if tight else " "
    axis.set_xlabel(f"time in{gap}{column} ({unit})")


def _blank(axis: Axes) -> None:
    axis.set_xticks([])
    axis.tick_params(left=False)
    axis.spines[:].set_visible(False)


def same_times(axes: np.ndarray) -> None:
    """Give all tests' dwells one time axis, for comparison down the column."""
    used = [axis for axis in axes if axis.lines]
    limits = np.array([axis.get_xlim() for axis in used])
    first, last = limits[:, 0].min(), limits[:, 1].max()
    for axis in used:
        axis.set_xlim(first, last)
        if last < _FEW_DECADES * first:
            axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_formatter(NullFormatter())


def by_rate(rate: float) -> float:
    """Return the key that sorts tests by loading rate, those without one last."""
    return rate if np.isfinite(rate) else np.inf
