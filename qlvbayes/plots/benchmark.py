"""Draw a benchmark: confusion matrix, reliability, errors on left-out tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from qlvbayes.evaluation.plan import family
from qlvbayes.evaluation.rate import Rate
from qlvbayes.evaluation.reliability import Reliability
from qlvbayes.evaluation.report import Confusion, Report
from qlvbayes.evaluation.scores import could_be_seen, heldout_ratios
from qlvbayes.plots.style import BLACK, DOUBLE, MM, colours, narrow, style
from qlvbayes.simulate import FORMS, OUTSIDE

_ROW = 4.2  # mm
_LEAST_ROWS = 6  # rows for which the columns' labels fit
_TITLES, _LOWER = 34.0, 62.0  # mm, height of the columns' labels and of the lower panels
_SMALL, _TINY = 6.0, 5.0  # points: the numbers; in one column the labels too
_DARK = 0.55  # share of the colour scale beyond which text is white
_LEGEND = {"none": "nothing", "single": "one effect", "double": "two effects"}
_LEGEND |= {"form": "other form", "outside": "outside the list"}
_MARKS = dict(zip(_LEGEND, "os^Dv", strict=True))


def plot_benchmark(report: Report, *, width: float = DOUBLE) -> list[Axes]:
    """Draw how often each hidden effect was named, and how far probabilities can be trusted.

    The upper panel has one row for each hidden effect and one column for each verdict. Numbers are
    studies, the shade is their share of the row, and framed cells are the right verdicts. The lower
    left panel shows how often the first-ranked hypothesis is true against its probability, with
    standard errors; on the line, probabilities are calibrated. The lower right panel shows the
    error on left-out tests over the noise floor, before and after; 1 is as good as noise allows. In
    one column the lower panels are one below the other.

    Parameters
    ----------
    report
        The report of the benchmark.
    width
        Width of the figure (mm).

    Returns
    -------
    list of Axes
        The three panels.
    """
    tight = narrow(width)
    with style():
        upper = _TITLES + _ROW * max(len(report.confusion.rows), _LEAST_ROWS)
        lower = _LOWER * (1 + tight)
        figure = Figure((width * MM, (upper + lower) * MM), layout="constrained")
        grid = figure.add_gridspec(2, 1, height_ratios=(upper, lower))
        above, below = (figure.add_subfigure(grid[k, 0]) for k in range(2))
        matrix = above.subplots()
        _draw_confusion(matrix, report.confusion, tight=tight)
        left, right = below.subplots(*((2, 1) if tight else (1, 2)))
        _draw_reliability(left, report.reliability)
        _draw_heldout(right, report)
    return [matrix, left, right]


def _draw_confusion(axis: Axes, confusion: Confusion, *, tight: bool) -> None:
    for row, counts in enumerate(confusion.counts):
        for column, count in enumerate(counts):
            if count:
                size = _TINY if tight else _SMALL
                _draw_cell(axis, row, column, count, sum(counts), size)
        for right in _right_columns(confusion.rows[row]):
            frame = _square(row, confusion.columns.index(right), fill=False, edgecolor=BLACK)
            axis.add_patch(frame)
    axis.set(xlim=(0, len(confusion.columns)), ylim=(max(len(confusion.rows), 1), 0))
    positions = np.arange(len(confusion.columns)) + 0.5
    axis.set_xticks(positions, [_plain(name) for name in confusion.columns], rotation=90)
    labels = [_row_label(name, tight=tight) for name in confusion.rows]
    axis.set_yticks(np.arange(len(labels)) + 0.5, labels)
    axis.tick_params(length=0, labeltop=True, labelbottom=False)
    if tight:
        axis.tick_params(labelsize=_TINY)
    axis.set_ylabel("hidden")
    gap = "\n" if tight else " "
    axis.set_xlabel(f"verdict (number of studies;{gap}shade: share of the row; frame: right)")
    axis.spines[:].set_visible(False)
    _rule(axis, confusion)


def _draw_cell(axis: Axes, row: int, column: int, count: int, total: int, size: float) -> None:
    shade = count / total
    axis.add_patch(_square(row, column, facecolor=colormaps["Blues"](shade), linewidth=0.0))
    ink = "white" if shade > _DARK else BLACK
    axis.text(
        column + 0.5, row + 0.54, str(count), color=ink, ha="center", va="center", fontsize=size
    )


def _square(row: int, column: int, **look: Any) -> Rectangle:
    return Rectangle((column + 0.02, row + 0.04), 0.96, 0.92, **look)


def _rule(axis: Axes, confusion: Confusion) -> None:
    """Draw thin lines, along which a cell is followed to its labels."""
    axis.hlines(range(len(confusion.rows) + 1), 0, len(confusion.columns), color="0.9", zorder=0)
    axis.vlines(range(len(confusion.columns) + 1), 0, len(confusion.rows), color="0.9", zorder=0)


def _right_columns(row: str) -> tuple[str, ...]:
    """Return the right verdicts; for another form, every effect that it may stand for."""
    if row in OUTSIDE:
        return ("unexplained",)
    if row in FORMS:
        return tuple(sorted(family(row)))
    return ("several" if row == "two effects" else row,)


def _row_label(row: str, *, tight: bool) -> str:
    if row in FORMS and tight:
        return f"{_plain(row)} (form)"
    if row in FORMS:
        first, *others = FORMS[row].family.split("/")
        return f"{_plain(row)} (form of {_plain(first)}{', …' if others else ''})"
    return f"{_plain(row)} (outside)" if row in OUTSIDE else _plain(row)


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _draw_reliability(axis: Axes, reliability: Reliability) -> None:
    axis.plot([0, 1], [0, 1], color="0.7", linestyle="--")
    if reliability.bins:
        axis.errorbar(
            [b.probability for b in reliability.bins],
            [b.right.hits / b.right.n for b in reliability.bins],
            np.transpose([_bar(b.right) for b in reliability.bins]),
            fmt="o", color=colours()[0], markersize=4, capsize=2, clip_on=False,
        )  # fmt: skip
        for b in reliability.bins:
            point = (b.probability, b.right.hits / b.right.n)
            offset = (5, -9) if point[1] > 0.1 else (5, 3)
            axis.annotate(
                str(b.right.n), point, offset, textcoords="offset points", fontsize=_SMALL
            )
    axis.set(xlim=(0, 1), ylim=(0, 1.05), aspect="equal")
    axis.set_xlabel("probability of the first-ranked hypothesis")
    axis.set_ylabel("share in which it is true")
    title = "nothing or one effect hidden"
    if reliability.error is not None:
        title += f"\ncalibration error {reliability.error:.3f}"
    axis.set_title(title, loc="left")


def _bar(rate: Rate) -> tuple[float, float]:
    """Return one standard error down and up, within 0 and 1."""
    error = rate.error or 0.0
    return min(error, rate.hits / rate.n), min(error, 1.0 - rate.hits / rate.n)


def _draw_heldout(axis: Axes, report: Report) -> None:
    cases = [case for case in could_be_seen(report.cases) if "stages" in case]
    for (kind, label), colour in zip(_LEGEND.items(), colours(), strict=False):
        pairs = [heldout_ratios(case) for case in cases if case["kind"] == kind]
        if pairs:
            axis.plot(
                *zip(*pairs, strict=True), _MARKS[kind], color=colour, markersize=3, alpha=0.7,
                markeredgewidth=0.0, label=label,
            )  # fmt: skip
    axis.axhline(1.0, color="0.7", linestyle="--", zorder=0)
    axis.set(xscale="log", yscale="log")
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        side.set_major_formatter(StrMethodFormatter("{x:g}"))
        side.set_minor_formatter(NullFormatter())
    axis.set_xlabel("plain model")
    axis.set_ylabel("last model")
    axis.set_title("error on left-out tests / noise floor", loc="left")
    if cases:
        axis.legend(loc="best", handletextpad=0.2)
