"""Draw the draws of constants as regions that hold 50 and 90 % of them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from scipy.ndimage import gaussian_filter, gaussian_filter1d

SHARES = (0.9, 0.5)  # shares of the draws in the outer and in the inner region
_SHADES = (0.28, 0.75)  # opacity of the regions
_BINS, _SMOOTH = 36, 1.6  # bins of a histogram, and the width of its blur in bins
_AROUND = 0.15  # share of the range of the draws that is added on either side


def limits(values: np.ndarray) -> tuple[float, float]:
    """Return where an axis that shows these draws begins and ends."""
    low, high = np.quantile(values, [0.002, 0.998])
    margin = _AROUND * (high - low) or 0.5
    return float(low - margin), float(high + margin)


def draw_regions(
    axis: Axes, x: np.ndarray, y: np.ndarray, ranges: tuple[tuple[float, float], ...], colour: str
) -> None:
    """Draw the smallest regions that hold 90 and 50 % of the draws, from a smoothed histogram."""
    counts, x_edges, y_edges = np.histogram2d(x, y, bins=_BINS, range=ranges)
    density = gaussian_filter(counts, _SMOOTH)
    levels = [_level(density, share) for share in SHARES]
    centres = [0.5 * (edges[1:] + edges[:-1]) for edges in (x_edges, y_edges)]
    for level, top, shade in zip(levels, [levels[1], density.max()], _SHADES, strict=True):
        if top > level:
            axis.contourf(*centres, density.T, [level, top], colors=[colour], alpha=shade)


def draw_curve(axis: Axes, values: np.ndarray, span: tuple[float, float], colour: str) -> None:
    """Draw the density of one constant: its 90 % interval shaded, a line at the median."""
    counts, edges = np.histogram(values, bins=2 * _BINS, range=span)
    density = gaussian_filter1d(counts.astype(float), _SMOOTH)
    centres = 0.5 * (edges[1:] + edges[:-1])
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
    inside = (centres >= low) & (centres <= high)
    axis.fill_between(
        centres, density, where=inside.tolist(), color=colour, alpha=_SHADES[0], linewidth=0
    )
    axis.plot(centres, density, color=colour)
    axis.axvline(median, color=colour, linestyle="--", linewidth=0.7, gid="median")
    axis.set_ylim(0.0, 1.15 * float(density.max()))


def _level(density: np.ndarray, share: float) -> float:
    """Return the density above which a share of the whole lies."""
    ordered = np.sort(density.ravel())[::-1]
    held = np.cumsum(ordered)
    return float(ordered[np.searchsorted(held, share * held[-1])])
