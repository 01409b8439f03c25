"""Draw three shares that sum to 1 in a triangle, and enlarge the part that the draws fill."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

from qlvbayes.plots.density import draw_regions
from qlvbayes.plots.style import BLACK

_HEIGHT = 3.0**0.5 / 2.0
_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, _HEIGHT]])  # where share 0, 1, 2 is all
_MARGIN = 0.12  # share of the enlarged triangle that is left around the draws
_WHOLE = 0.24  # size of the small copy of the whole triangle over the enlarged one
_WHOLE_AT = (1.11, _HEIGHT - 0.18)
_TICKS = 3  # most steps between the numbers along a side
_DIGIT = 4.5  # points, width of a digit
_AROUND = ((-0.36, 1.36), (-0.27, 0.93))


@dataclass(frozen=True)
class _Window:
    """Triangle c_i >= low_i; ``size`` is its side, 1 for the whole simplex."""

    low: np.ndarray
    size: float

    def points(self, shares: np.ndarray) -> np.ndarray:
        """Return points (n, 2) of shares (n, 3)."""
        return (shares - self.low) / self.size @ _CORNERS


def draw_ternary(axis: Axes, shares: np.ndarray, colour: str) -> None:
    """Draw the regions that hold 50 and 90 % of the draws (n, 3), each row of sum 1."""
    window = _window(shares)
    axis.set_aspect("equal")
    axis.axis("off")
    axis.set(xlim=_AROUND[0], ylim=_AROUND[1])
    x, y = window.points(shares).T
    draw_regions(axis, x, y, ((0.0, 1.0), (0.0, _HEIGHT)), colour)
    axis.plot(*window.points(np.median(shares, axis=0)[None]).T, "+", color=BLACK, markersize=5.0,
              gid="median")  # fmt: skip
    axis.add_patch(Polygon(_CORNERS, fill=False, linewidth=0.6, gid="enlarged"))
    for k in range(3):
        _grid(axis, window, k)
    _whole(axis, window)


def _window(shares: np.ndarray) -> _Window:
    low = np.quantile(shares, 0.002, axis=0)
    margin = _MARGIN * (1.0 - low.sum())
    return _Window(low - margin, float(1.0 - low.sum() + 3.0 * margin))


def _grid(axis: Axes, window: _Window, k: int) -> None:
    """Draw lines of equal share k, with numbers where they begin and a name next to these."""
    begin, end = {0: (2, 1), 1: (0, 2), 2: (1, 0)}[
        k
    ]  # corners without k, the numbered side's first
    first = float(window.low[k])
    values = MaxNLocator(_TICKS, prune="both").tick_values(first, first + window.size)
    turn = {0: (-4.0, 2.0, "right", "bottom"), 1: (-2.0, -3.0, "center", "top"),
            2: (3.0, 0.0, "left", "center")}[k]  # fmt: skip
    for value in values:
        share = (value - first) / window.size
        if not 0.02 < share < 0.98:
            continue
        one = share * _CORNERS[k] + (1.0 - share) * _CORNERS[begin]
        other = share * _CORNERS[k] + (1.0 - share) * _CORNERS[end]
        axis.plot(*np.transpose([one, other]), color="0.8", linewidth=0.4, zorder=0.5)
        axis.annotate(
            f"{value:.6g}", one, xytext=turn[:2], textcoords="offset points",
            ha=turn[2], va=turn[3], gid=f"c[{k}]",
        )  # fmt: skip
    middle = 0.5 * (_CORNERS[k] + _CORNERS[begin])
    distance = _DIGIT * max(len(f"{value:.6g}") for value in values) + 14.0
    away = {0: (-distance, 4.0), 1: (0.0, -17.0), 2: (distance, 4.0)}[k]
    axis.annotate(
        rf"$\mathit{{c}}_{{{k}}}$", middle, xytext=away, textcoords="offset points",
        ha="center", va="center",
    )  # fmt: skip


def _whole(axis: Axes, window: _Window) -> None:
    corner = np.array(_WHOLE_AT)
    axis.add_patch(Polygon(corner + _WHOLE * _CORNERS, fill=False, linewidth=0.5, gid="whole"))
    middle = corner[0] + 0.5 * _WHOLE
    axis.text(middle, corner[1] - 0.03, "whole", ha="center", va="top", fontsize="small")
    corners = window.low + window.size * np.eye(3)
    axis.add_patch(
        Polygon(corner + _WHOLE * (corners @ _CORNERS), facecolor=BLACK, linewidth=0.8,
                edgecolor=BLACK, gid="where")
    )  # fmt: skip
