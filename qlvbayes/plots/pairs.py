"""Draw a pad's joint posterior: pairs of constants, and the shares c in a triangle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator, StrMethodFormatter

from qlvbayes.fitting.fit import Fit
from qlvbayes.fitting.results import Saved
from qlvbayes.model.drawn import described_fields
from qlvbayes.plots.density import draw_curve, draw_regions, limits
from qlvbayes.plots.naming import parameter_label, parameter_lines
from qlvbayes.plots.style import BLACK, DOUBLE, MM, colours, narrow, shortened, style
from qlvbayes.plots.ternary import draw_ternary

_LEFT, _RIGHT, _BOTTOM = 13.0, 3.0, 8.0  # mm around the panels, without the labels' lines
_TOP, _TOP_TIGHT = 12.0, 26.0  # mm
_ROW, _ROW_TIGHT = 19.0, 14.0  # mm
_BARS_LEFT, _BARS_BELOW = 15.0, 5.5  # mm around bars of shares, for the labels of their axes
_GAP = 0.1  # gap between two panels, over a panel's width
_DIGIT, _LINE, _ROOM = 1.3, 2.6, 1.6  # mm: of a number, its height, and between two
_INSIDE = 0.12  # share of an axis at either end that has no numbers
_LABEL = 11.3  # mm, from an upright axis to its label
_TEXT, _LETTER = 3.0, 1.45  # mm: height of a label's line, and width of its letters
_NUMBER = StrMethodFormatter("{x:.6g}")
_MOST = 4000  # draws that are used, evenly out of all


def plot_pairs(fit: Fit | Saved, *, width: float = DOUBLE) -> list[Axes]:
    """Draw every pair of the model's constants that were fitted.

    Below each constant's density are the regions that hold 50 and 90 % of the draws of two. The
    shares c, which sum to 1, are drawn in a triangle, upper right; other numbers of shares than
    three as bars. ``fit`` is a fit or saved results, ``width`` in mm; returns the panels, row by
    row, then that of the shares.
    """
    draws, units = _draws(fit), _units(fit)
    shares = [name for name in draws if name.startswith("c[")]
    others = [name for name in draws if name not in shares]
    with style():
        page = _Page.for_constants(width, others, shares, units)
        figure, grid = page.begin()
        panels = _panels(figure, grid, [*others, *shares], others)
        spans = {name: limits(values) for name, values in draws.items()}
        for (below, along), axis in panels.items():
            _draw(axis, draws, spans, below, along)
        _label(panels, spans, units, page)
        drawn = list(panels.values())
        if shares:
            ternary = len(shares) == 3
            corner = figure.add_axes(page.corner(margin=not ternary))
            _draw_shares(corner, shares, draws)
            drawn.append(corner)
        _legend(figure, fit.pad, columns=1 if narrow(width) else 3)
    return drawn


@dataclass(frozen=True)
class _Page:
    """Sizes in mm: the figure, its margins, rows and columns; and the corner's position.

    The corner takes ``deep`` rows from the top of the page and all columns from ``first`` on.
    """

    width: float
    left: float
    bottom: float
    top: float
    row: float
    rows: int
    columns: int
    first: int
    deep: int

    @classmethod
    def for_constants(
        cls, width: float, others: Sequence[str], shares: Sequence[str], units: dict[str, str]
    ) -> _Page:
        """Return the page for these constants and shares."""
        tight, count = narrow(width), len(others)
        extra = 2 if shares and count < (2 if tight else 4) else 0
        deep = 2 if extra else 1 if tight else count // 2
        top, row = (_TOP_TIGHT, _ROW_TIGHT) if tight else (_TOP, _ROW)
        rows, columns = max(count + len(shares), 2), max(count + extra, 1)
        page = cls(width, _LEFT, _BOTTOM, top, row, rows, columns, count if extra else deep, deep)
        page = replace(
            page, left=_LEFT + _room([page.row_label(n, units) for n in (*others, *shares)])
        )
        return replace(page, bottom=_BOTTOM + _room([page.column_label(n, units) for n in others]))

    def row_label(self, name: str, units: dict[str, str]) -> str:
        """Return the label of a row."""
        return parameter_lines(name, units[name], int(self.row / _LETTER))

    def column_label(self, name: str, units: dict[str, str]) -> str:
        """Return the label of a column; a narrow figure omits the effect, which the rows name."""
        short = name.rpartition(".")[2] if narrow(self.width) else name
        return parameter_lines(short, units[name], int(self.cell / _LETTER))

    @property
    def height(self) -> float:
        return self.top + self.row * self.rows + self.bottom

    @property
    def cell(self) -> float:
        """Return the width of a panel."""
        return (self.width - self.left - _RIGHT) / (self.columns + _GAP * (self.columns - 1))

    def begin(self) -> tuple[Figure, GridSpec]:
        figure = Figure((self.width * MM, self.height * MM))
        grid = GridSpec(
            self.rows, self.columns, figure, left=self.left / self.width,
            right=1.0 - _RIGHT / self.width, bottom=self.bottom / self.height,
            top=1.0 - self.top / self.height, wspace=_GAP, hspace=_GAP,
        )  # fmt: skip
        return figure, grid

    def corner(self, *, margin: bool) -> tuple[float, float, float, float]:
        """Return left, bottom, width and height as shares of the page."""
        left = self.left + self.first * (1.0 + _GAP) * self.cell + margin * _BARS_LEFT
        bottom = self.height - self.top - self.row * self.deep + margin * _BARS_BELOW
        wide, high = self.width - _RIGHT - left, self.height - 2.0 - bottom
        return (
            left / self.width, bottom / self.height, wide / self.width, high / self.height,
        )  # fmt: skip


def _room(labels: Sequence[str]) -> float:
    return _TEXT * max((label.count("\n") + 1 for label in labels), default=1)


def _draws(fit: Fit | Saved) -> dict[str, np.ndarray]:
    """Return draws of each constant that varies, without those of the noise."""
    flat = np.reshape(fit.constants, (-1, len(fit.names)))
    flat = flat[:: max(1, -(-len(flat) // _MOST))]
    return {
        name: values
        for name, values in zip(fit.names, flat.T, strict=True)
        if not name.startswith("noise.") and np.ptp(values) > 0.0
    }


def _units(fit: Fit | Saved) -> dict[str, str]:
    if isinstance(fit, Fit):
        return dict(zip(fit.names, fit.units, strict=True))
    fields = described_fields(fit.choices)
    return {name: fit.units.of(field.unit) for field in fields for name in field.names}


def _panels(
    figure: Figure, grid: GridSpec, rows: Sequence[str], others: Sequence[str]
) -> dict[tuple[str, str], Axes]:
    """Return axes by the constants below the diagonal (upward, along)."""
    panels: dict[tuple[str, str], Axes] = {}
    for r, below in enumerate(rows):
        for c, along in enumerate(others[: r + 1]):
            top = panels.get((along, along))
            first = panels.get((below, others[0])) if c and below != along else None
            axis = figure.add_subplot(grid[r, c], sharex=top, sharey=first)
            panels[below, along] = axis
    return panels


def _draw(
    axis: Axes, draws: dict[str, np.ndarray], spans: dict[str, tuple[float, float]],
    below: str, along: str,
) -> None:  # fmt: skip
    colour = colours()[0]
    if below == along:
        draw_curve(axis, draws[along], spans[along], colour)
        axis.set_yticks([])
        axis.spines["left"].set_visible(False)
    else:
        ranges = (spans[along], spans[below])
        draw_regions(axis, draws[along], draws[below], ranges, colour)
        axis.set_ylim(spans[below])
    axis.set_xlim(spans[along])


def _label(
    panels: dict[tuple[str, str], Axes], spans: dict[str, tuple[float, float]],
    units: dict[str, str], page: _Page,
) -> None:  # fmt: skip
    last, (first, _) = list(panels)[-1][0], next(iter(panels))
    for (below, along), axis in panels.items():
        lowest, leftmost = below == last, along == first and below != along
        axis.tick_params(labelbottom=lowest, labelleft=leftmost)
        axis.xaxis.set_major_formatter(_NUMBER)
        positions = _tick_positions(spans[along], page.cell, across=True)
        axis.xaxis.set_major_locator(FixedLocator(positions))
        if below != along:
            axis.yaxis.set_major_formatter(_NUMBER)
            positions = _tick_positions(spans[below], page.row, across=False)
            axis.yaxis.set_major_locator(FixedLocator(positions))
        if lowest:
            axis.set_xlabel(page.column_label(along, units))
        if leftmost:
            axis.set_ylabel(page.row_label(below, units), va="bottom")
            axis.yaxis.set_label_coords(-_LABEL / page.cell, 0.5)
        elif below == first:
            axis.set_ylabel("density")


def _tick_positions(span: tuple[float, float], length: float, *, across: bool) -> list[float]:
    """Return round numbers away from the ends of an axis of ``length`` mm, as many as fit."""
    margin = _INSIDE * (span[1] - span[0])
    low, high = span[0] + margin, span[1] - margin
    for count in (3, 2, 1):
        values = [x for x in MaxNLocator(count).tick_values(low, high) if low <= x <= high]
        digits = max((len(f"{x:.6g}") for x in values), default=0)
        needed = _ROOM + (_DIGIT * digits if across else _LINE)
        step = length * np.min(np.diff(values), initial=np.inf) / (span[1] - span[0])
        if values and step >= needed:
            return values
    return [float(f"{0.5 * (low + high):.3g}")]


def _draw_shares(axis: Axes, shares: Sequence[str], draws: dict[str, np.ndarray]) -> None:
    colour = colours()[0]
    if len(shares) == 3:
        draw_ternary(axis, np.column_stack([draws[name] for name in shares]), colour)
        return
    low, middle, high = np.quantile([draws[name] for name in shares], [0.05, 0.5, 0.95], axis=1)
    positions = np.arange(len(shares))
    axis.bar(positions, middle, color=colour, alpha=0.45, width=0.6)
    axis.errorbar(
        positions, middle, [middle - low, high - middle], fmt="none", color=BLACK, capsize=3
    )
    axis.set_xticks(positions, [parameter_label(name) for name in shares])
    axis.set_ylabel("share (no unit)")


def _legend(figure: Figure, pad: str, columns: int) -> None:
    colour = colours()[0]
    handles = [
        Patch(facecolor=colour, alpha=0.8, linewidth=0),
        Patch(facecolor=colour, alpha=0.28, linewidth=0),
        Line2D([], [], color=colour, linestyle="--", linewidth=0.7),
    ]
    figure.suptitle(
        f"pad {shortened(pad, 24)}: joint posterior", x=0.01, y=0.995, ha="left", va="top"
    )
    figure.legend(
        handles, ["50 % of the draws", "90 %", "median"], loc="upper left",
        bbox_to_anchor=(0.0, 1.0 - 4.0 * MM / figure.get_figheight()), ncols=columns,
    )  # fmt: skip
