"""Draw a comparison of two pads, or two fluids: ratios against what counts as equal."""

from __future__ import annotations

import re
from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator, StrMethodFormatter

from qlvbayes.comparison.contrast import Comparison, Contrast
from qlvbayes.plots.naming import parameter_label
from qlvbayes.plots.style import (
    DOUBLE,
    MARKERS,
    canvas,
    colours,
    name_rows,
    narrow,
    percentage,
    shortened,
    style,
    write_right,
)

_ROW, _ROW_TIGHT, _FRAME = 4.6, 7.2, 34.0  # mm
_TEXT_AT = 4.0, 62.0  # points right of the axes where the answer and the probability begin
_FIRST = 8  # characters of the first pad's name above the answers
_NUMBER = re.compile(r"(\d) ")  # a number before its unit
_HALF_LINE = 0.2  # share of a row: in one column answer and probability are one below the other
_NAME_TIGHT, _TITLE, _TITLE_TIGHT = 20, 100, 46  # characters a line
_NOTE, _NOTE_TIGHT = 138, 60
_FAR = 30.0  # largest ratio either way that is drawn; beyond, an arrow
_LOOKS = {"greater": 1, "less": 1, "equal": 0, "cannot tell": 0}  # index into the palette
_ANSWERS = {True: "they differ", False: "equal for practical purposes", None: "cannot tell"}
_TICKS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0)
_APART = 0.13  # share of the axis between two ticks that are labelled


def plot_contrasts(comparison: Comparison, *, width: float = DOUBLE) -> Axes:
    """Draw the ratio of every quantity, first over second, with its 90 % interval.

    ``comparison`` is that of two pads or fluids, ``width`` in mm; returns the axes. Quantities that
    may be zero or change their sign have no ratio.
    """
    tight = narrow(width)
    with style():
        rows = _rows(comparison)
        height = _FRAME + (_ROW_TIGHT if tight else _ROW) * len(rows)
        figure = canvas(width, height)
        axis = figure.subplots()
        low, high = _limits(comparison)
        edge = 1.0 + comparison.region
        axis.axvspan(1.0 / edge, edge, color="0.88", linewidth=0, zorder=0, gid="equal")
        axis.axvline(1.0, color="0.4", linewidth=0.6, zorder=0.5)
        for position, row in enumerate(rows):
            if isinstance(row, Contrast):
                _draw(axis, position, row, (low, high), tight)
        _scale(axis, low, high, comparison, tight)
        _label(axis, rows, shortened(comparison.names[0], _FIRST), tight)
        _words(figure, comparison, tight)
    return axis


def _rows(comparison: Comparison) -> list[Contrast | str]:
    """Return the contrasts, with the name of each group before it where there are several."""
    groups = list(dict.fromkeys(c.group for c in comparison.contrasts))
    heads = [[group] * (len(groups) > 1) for group in groups]
    pairs = zip(groups, heads, strict=True)
    return [row for group, head in pairs for row in [*head, *comparison.of_group(group)]]


def _limits(comparison: Comparison) -> tuple[float, float]:
    edge = 1.0 + comparison.region
    ratios = [c.ratio for c in comparison.contrasts if c.ratio is not None]
    ends = [c.ratio95 for c in comparison.contrasts if c.ratio95 is not None]
    low = min([1.0 / edge, *(r.low for r in ratios), *(low for low, _ in ends)])
    high = max([edge, *(r.high for r in ratios), *(high for _, high in ends)])
    margin = 0.06 * np.log(min(high, _FAR) / max(low, 1.0 / _FAR))
    return max(low, 1.0 / _FAR) / np.exp(margin), min(high, _FAR) * np.exp(margin)


def _draw(
    axis: Axes, position: int, contrast: Contrast, limits: tuple[float, float], tight: bool
) -> None:
    colour = colours()[_LOOKS[contrast.answer]]
    lines = (-_HALF_LINE, _HALF_LINE) if tight else (0.0, 0.0)
    points = (_TEXT_AT[0], _TEXT_AT[0]) if tight else _TEXT_AT
    weight = "normal" if contrast.answer == "cannot tell" else "bold"
    write_right(axis, contrast.answer, position + lines[0], points[0], weight=weight)
    write_right(axis, percentage(contrast.direction), position + lines[1], points[1])
    ratio = contrast.ratio
    if ratio is None:
        transform = axis.get_yaxis_transform()
        axis.text(0.01, position, "no ratio", color="0.4", va="center", transform=transform)
        return
    axis.plot(
        [ratio.low, ratio.high], [position, position], color=colour, linewidth=1.8, gid="interval"
    )
    if contrast.ratio95 is not None:
        axis.plot(contrast.ratio95, [position, position], color=colour, linewidth=0.6, gid="95")
    sign = {"greater": "^", "less": "v"}.get(contrast.answer, MARKERS[0])
    hollow = contrast.answer == "cannot tell"
    middle = float(np.clip(ratio.median, *limits))
    axis.plot(
        middle, position, sign, color=colour, markersize=4.5,
        markerfacecolor="white" if hollow else colour, gid="median",
    )  # fmt: skip


def _scale(axis: Axes, low: float, high: float, comparison: Comparison, tight: bool) -> None:
    axis.set_xscale("log")
    axis.set_xlim(low, high)
    axis.xaxis.set_major_locator(FixedLocator(_ticks(low, high, 2.0 if tight else 1.0)))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    first, second = (shortened(name, 16) for name in comparison.names)
    axis.set_xlabel(f"ratio {first} / {second} (no unit)")


def _ticks(low: float, high: float, spread: float) -> list[float]:
    """Return 1, and further ticks outward that are far enough from the one before."""
    span = np.log(high / low)
    least = spread * _APART * span
    kept = [1.0]
    for side in ([t for t in _TICKS if t > 1.0], [t for t in reversed(_TICKS) if t < 1.0]):
        last = 1.0
        for tick in side:
            if low <= tick <= high and abs(np.log(tick / last)) >= least:
                kept.append(tick)
                last = tick
    if len(kept) == 1:  # all within a few per cent
        kept += [round(x, 3) for x in (low * np.exp(0.1 * span), high / np.exp(0.1 * span))]
    return sorted(kept)


def _label(axis: Axes, rows: Sequence[Contrast | str], first: str, tight: bool) -> None:
    names = [row if isinstance(row, str) else _name(row, tight) for row in rows]
    name_rows(axis, names, [k for k, row in enumerate(rows) if isinstance(row, str)])
    heads = (f"{first} is,\nP(greater)",) if tight else (f"{first} is", "P(greater)")
    look: dict[str, Any] = {"xycoords": "axes fraction", "va": "bottom"}
    for text, points in zip(heads, _TEXT_AT, strict=False):
        write_right(axis, text, 1.0, points, up=2.0, **look)


def _name(contrast: Contrast, tight: bool) -> str:
    name = f"{contrast.quantity} *" if contrast.extrapolated else contrast.quantity
    if contrast.group == "constants":
        return parameter_label(name)
    return fill(_NUMBER.sub("\\1\u00a0", name), _NAME_TIGHT) if tight else name


def _words(figure: Figure, comparison: Comparison, tight: bool) -> None:
    first, second = (shortened(name, 24) for name in comparison.names)
    kind = comparison.between.removesuffix("s")
    title = f"{kind} {first} against {kind} {second}: {_ANSWERS[comparison.differ]}"
    figure.suptitle(fill(title, _TITLE_TIGHT if tight else _TITLE), x=0.01, ha="left")
    lines = [
        f"Bars: 90 %; thin lines: 95 %. Shaded: equal within {100 * comparison.region:g} % "
        f"(ratio {1 / (1 + comparison.region):.3g} to {1 + comparison.region:.3g}). Full dot, "
        "equal: 95 % of the probability is shaded. Triangle, greater or less: otherwise, and the "
        "thin line is clear of 1. Open dot: cannot tell."
    ]
    if any(c.extrapolated for c in comparison.contrasts):
        lines.append("*: beyond what the tests of one of them cover.")
    most = _NOTE_TIGHT if tight else _NOTE
    figure.supxlabel("\n".join(fill(line, most) for line in lines), x=0.01, ha="left")
