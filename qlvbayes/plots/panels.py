"""Draw tests phase by phase: the one panel of force, residual, displacement and first look.

The phases of a test lie side by side, each as wide as the others. Time runs linearly in movements
and logarithmically in rests, so that a ramp of 50 ms can be read beside a hold of 30 s. A test of
more phases than fit is drawn in linear time. Panels are placed in millimetres, which costs less
than a layout engine that draws everything to find out how much room it needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain, rated
from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.phases import MOVING, Phase, phase_name, span
from qlvbayes.plots.style import BLACK, MM, colours, shortened

GREY = "#7f7f7f"
LABEL = "left out"
_TIME = "time since each phase began (s), logarithmic in rests"
_LEAST = 6.0  # mm that a phase needs; of a test with more phases time is linear
_EARLIEST, _LATEST = 1e-3, 0.1  # bounds, as shares of a rest, of its first reading, from which
# on its time is logarithmic
_WAIT = 0.4  # width of a rest before any movement over that of another phase
_DIGIT, _ROOM = 1.35, 1.6  # mm: a digit of a number at an axis, and between two numbers
_DOT = 2.4  # points
_CROSS = 4.5  # points: larger than a dot, which may lie under the cross of a reading left out
_LETTER = 1.3  # mm, a letter of a phase's name


@dataclass(frozen=True, eq=False)
class PhaseTime:
    """Map from the times of a test to positions: its phases side by side, or in linear time.

    ``edges`` are the positions at which phases begin and the last one ends, ``early`` is, for each
    phase, the share of it from which on the time of a rest is logarithmic.
    """

    phases: tuple[Phase, ...]
    side_by_side: bool
    early: np.ndarray
    edges: np.ndarray

    @classmethod
    def of(cls, trial: Trial, wide: float) -> PhaseTime:
        """Return the map for a test that is drawn ``wide`` mm wide."""
        time, phases, early = trial.whole.time, trial.phases, []
        for phase in phases:
            first = min(int(np.searchsorted(time, phase.start, side="right")), time.size - 1)
            share = (float(time[first]) - phase.start) / (phase.stop - phase.start)
            early.append(min(max(share, _EARLIEST), _LATEST))
        waits = len(phases) > 1 and phases[0].kind not in MOVING
        widths = np.array([_WAIT if waits and k == 0 else 1.0 for k in range(len(phases))])
        side_by_side = _LEAST * len(phases) <= wide
        edges = np.concatenate([[0.0], np.cumsum(widths)])
        if not side_by_side:
            edges = np.array([*(phase.start for phase in phases), phases[-1].stop])
        return cls(phases, side_by_side, np.array(early), edges)

    def __call__(self, time: np.ndarray) -> np.ndarray:
        """Return positions (n,) of times (n,) in s."""
        if not self.side_by_side:
            return time
        starts = np.array([phase.start for phase in self.phases])
        own = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, starts.size - 1)
        length = np.array([phase.stop - phase.start for phase in self.phases])[own]
        share = np.clip((time - starts[own]) / length, 0.0, 1.0)
        moving = np.array([phase.kind in MOVING for phase in self.phases])[own]
        early = self.early[own]
        late = np.log1p(share / early) / np.log1p(1.0 / early)
        across = np.where(moving, share, late)
        return np.asarray(self.edges[own] + np.diff(self.edges)[own] * across)

    def times(self, count: int) -> np.ndarray:
        """Return times (s) close enough for a curve, ``count`` a phase."""
        if not self.side_by_side:
            return np.linspace(self.edges[0], self.edges[-1], 16 * count)
        shares, parts = np.linspace(0.0, 1.0, count), []
        for phase, early in zip(self.phases, self.early, strict=True):
            late = early * np.expm1(shares * np.log1p(1.0 / early))
            part = shares if phase.kind in MOVING else late
            parts.append(phase.start + (phase.stop - phase.start) * part)
        return np.concatenate(parts)

    def mark(self, axis: Axes, wide: float, *, last: bool, moved: Sequence[str] = ("", "")) -> None:
        """Draw movements on a tint, and the times of a panel that is ``wide`` mm wide.

        Only the ``last`` of the panels that lie one below the other has numbers. ``moved`` names
        the tints of movements in and back for the legend.
        """
        for k, phase in enumerate(self.phases):
            if phase.kind in MOVING:
                back = phase.kind == "unload"
                look: dict[str, Any] = {"color": colours()[back], "label": moved[back]}
                axis.axvspan(*self.edges[k : k + 2], alpha=0.1, linewidth=0, **look)
            elif k and self.phases[k - 1].kind not in MOVING:
                axis.axvline(self.edges[k], color="0.8", linewidth=0.5)
        axis.set_xlim(self.edges[0], self.edges[-1])
        if not self.side_by_side:
            axis.xaxis.set_major_locator(MaxNLocator(6))
            axis.tick_params(labelbottom=last)
            if last:
                axis.set_xlabel("linear time (s)", loc="right", labelpad=0.5)
            return
        ticks = self._ticks(wide)
        axis.xaxis.set_major_locator(FixedLocator(list(ticks)))
        axis.xaxis.set_minor_locator(NullLocator())
        axis.set_xticks(list(ticks), list(ticks.values()) if last else [""] * len(ticks))

    def _ticks(self, wide: float) -> dict[float, str]:
        """Return numbers by position, as many as fit without touching."""
        mm = wide / float(self.edges[-1] - self.edges[0])
        kept: dict[float, str] = {}
        end = -np.inf
        for k, phase in enumerate(self.phases):
            length, begin = phase.stop - phase.start, float(self.edges[k])
            if phase.kind in MOVING:
                times = [t for t in MaxNLocator(2).tick_values(0.0, length) if 0.0 < t <= length]
            else:
                powers = np.arange(np.floor(np.log10(self.early[k] * length)), 9.0)
                times = [t for t in 10.0**powers if self.early[k] * length <= t <= length]
            for time in times:
                place = float(self(np.array([phase.start + min(time, length * (1 - 1e-9))]))[0])
                text = plain(time)
                half = 0.5 * _DIGIT * len(text) / mm
                if place - half > max(end, begin - half) and place + half < self.edges[-1] + half:
                    kept[place] = text
                    end = place + half + _ROOM / mm
        return kept

    def name_phases(self, axis: Axes, wide: float) -> None:
        """Write the name of each phase and its length over a panel, where there is room."""
        mm = wide / float(self.edges[-1] - self.edges[0])
        for k, phase in enumerate(self.phases if self.side_by_side else ()):
            room = mm * float(self.edges[k + 1] - self.edges[k])
            length = span(phase.stop - phase.start)
            names = (f"{phase_name(phase.kind, phase.control)} {length}", f"{phase.kind}", length)
            text = next((name for name in names if _LETTER * len(name) < room), "")
            axis.annotate(
                text, (0.5 * float(self.edges[k] + self.edges[k + 1]), 1.0),
                xycoords=("data", "axes fraction"), xytext=(0.0, 1.5),
                textcoords="offset points", ha="center", fontsize=6.2, color="#555555",
            )  # fmt: skip


@dataclass(frozen=True, eq=False)
class DrawnModel:
    """Curve that one model makes of the samples (n,) of a test, and how it is drawn."""

    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray
    colour: str
    line: str = "-"
    name: str = "model's posterior mean"
    band: str = "90 % predictive band"


def draw_samples(
    axis: Axes, x: np.ndarray, observed: np.ndarray, models: Sequence[DrawnModel],
    floor: np.ndarray | None = None,
) -> None:  # fmt: skip
    """Draw readings with the models' lines and bands, or with a floor what the models leave.

    ``x`` (n,) is where the readings ``observed`` (n,) stand. With ``floor`` (n,), the half width of
    the grey band, dots are measured minus modelled force in each model's colour.
    """
    if floor is not None:
        look: dict[str, Any] = {"color": "0.88", "label": "90 % of the noise floor"}
        axis.fill_between(x, -floor, floor, linewidth=0, zorder=0, gid="noise", **look)
        axis.axhline(0.0, color="0.4", linewidth=0.4, zorder=0.5)
        for model in models:
            axis.plot(x, observed - model.mean, ".", color=model.colour, markersize=_DOT,
                      markeredgewidth=0, gid="residual")  # fmt: skip
        return
    for model in models:
        draw_band(axis, x, model)
    look = {"color": BLACK, "markersize": _DOT, "markeredgewidth": 0, "label": "measured"}
    axis.plot(x, observed, ".", gid="measured", **look)
    for model in reversed(models):  # dashes over the full line
        look = {"color": model.colour, "linewidth": 0.9, "label": model.name}
        axis.plot(x, model.mean, model.line, gid="mean", **look)


def draw_band(axis: Axes, x: np.ndarray, model: DrawnModel, rows: Any = slice(None)) -> None:
    """Draw the band of a model at some rows of x (n,)."""
    look: dict[str, Any] = {"color": model.colour, "alpha": 0.3, "linewidth": 0}
    low, high = model.low[rows], model.high[rows]
    axis.fill_between(x[rows], low, high, label=model.band, gid="band", **look)


def legend_entries(figure: Figure) -> tuple[list[Any], list[str]]:
    """Return handles and labels of all that a figure shows, each once, for its legend."""
    found: dict[str, Any] = {}
    for axis in figure.axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values()), list(found)


def mark_left_out(axis: Axes, x: np.ndarray, values: np.ndarray) -> None:
    """Draw grey crosses for readings left out; those beyond the axis are at its edge."""
    axis.plot(
        x, np.clip(values, *axis.get_ylim()), "x", color=GREY, markersize=_CROSS,
        markeredgewidth=0.9, clip_on=False, zorder=4, label=LABEL, gid=LABEL,
    )  # fmt: skip


@dataclass(frozen=True)
class Sheet:
    """A figure of blocks of panels that lie one below the other, and the width of a panel (mm)."""

    figure: Figure
    blocks: list[list[Axes]]
    wide: float

    @classmethod
    def of(
        cls, width: float, count: int, heights: Sequence[float], *, head: float,
        columns: int = 1, foot: float = 1.0,
    ) -> Sheet:  # fmt: skip
        """Return ``count`` blocks of panels of these heights; all lengths are in mm.

        ``head`` and ``foot`` are kept free for the title with its legend and for a note.
        """
        left, right, apart, above, below = 16.5, 4.0, 1.6, 8.5, 5.5  # room for names and numbers
        lines, foot = -(-count // columns), foot + 3.0
        block = above + sum(heights) + apart * (len(heights) - 1) + below
        height = head + block * lines + foot
        figure = Figure((width * MM, height * MM))
        wide = width / columns - left - right
        blocks = []
        for k in range(count):
            line, column = divmod(k, columns)
            top, panels = height - head - line * block - above, []
            for high in heights:
                box = (column * width / columns + left, top - high, wide, high)
                shares = np.divide(box, (width, height, width, height))
                panels.append(figure.add_axes(tuple(shares)))
                top -= high + apart
            blocks.append(panels)
        figure.text(0.5, (foot - 2.0) / height, _TIME, ha="center", fontsize="small", gid="time")
        return cls(figure, blocks, wide)

    def label(self, axis: Axes, text: str, **look: Any) -> None:
        """Write what a panel shows at its upright axis, in line with the other panels."""
        axis.set_ylabel(text, **look)
        axis.yaxis.set_label_coords(-10.0 / self.wide, 0.5)


def by_rate(rate: float) -> float:
    """Return the key that sorts tests by loading rate, those without one last."""
    return rate if np.isfinite(rate) else np.inf


def trial_name(trial: Trial, units: UnitSystem, most: int) -> str:
    """Return a test's name, in ``most`` characters at most, with its loading rate if it has one."""
    name = shortened(trial.name, most)
    return f"{name}, {rated(trial.rate, units.speed)}" if np.isfinite(trial.rate) else name


def role_look(role: str) -> tuple[str, str]:
    """Return whether a test was fitted or predicted, and the weight of the letters that say so."""
    return ("fitted", "bold") if role == "fit" else ("predicted", "normal")
