"""Draw a benchmark: confusion matrix, reliability, errors on left-out tests."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from qlvbayes.evaluation.population import kin
from qlvbayes.evaluation.report import SEVERAL, WITH_LISTED, Confusion, Report, heldout_ratios
from qlvbayes.plots.cellmap import draw_shaded, label_squares, square
from qlvbayes.plots.style import BLACK, DOUBLE, canvas, colours, narrow, style
from qlvbayes.simulate import FOREIGN, FORMS, FURTHER, OUTSIDE

_ROW = 4.2  # mm
_LEAST_ROWS = 6  # rows for which the columns' labels fit
_TITLES, _LOWER = 34.0, 62.0  # mm, height of the columns' labels and of the lower panels
_SMALL, _TINY = 6.0, 5.0  # points: the numbers; in one column the labels too
_MIDDLE = 0.54  # share of a row above the middle of a number, which has no descenders
_LEGEND = {"none": "nothing", "single": "one effect", "double": "two effects"}
_LEGEND |= {"form": "other form", "outside": "outside the list"}
_LEGEND |= {"outside_beside": "outside, with a listed one"}
_MARKS = dict(zip(_LEGEND, "os^Dv<", strict=True))
_FORMS, _UNLISTED = {**FORMS, **FOREIGN}, {**OUTSIDE, **FURTHER}


def plot_benchmark(report: Report, *, width: float = DOUBLE) -> list[Axes]:
    """Draw how often each hidden effect was named, and how far probabilities can be trusted.

    The upper panel has one row for each hidden effect and one column for each verdict. Numbers are
    studies, the shade is their share of the row, and framed cells are the right verdicts. The lower
    left panel shows the share of the listed effects that are hidden against their stated
    probability, with 95 % bounds; on the line, probabilities are calibrated. The lower right panel
    shows the error on left-out tests over the noise floor, before and after; 1 is as good as noise
    allows. In one column the lower panels are one below the other.

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
        confusion = Confusion.from_cases(report.cases)
        upper = _TITLES + _ROW * max(len(confusion.rows), _LEAST_ROWS)
        lower = _LOWER * (1 + tight)
        figure = canvas(width, upper + lower)
        grid = figure.add_gridspec(2, 1, height_ratios=(upper, lower))
        above, below = (figure.add_subfigure(grid[k, 0]) for k in range(2))
        matrix = above.subplots()
        _draw_confusion(matrix, confusion, tight=tight)
        left, right = below.subplots(*((2, 1) if tight else (1, 2)))
        _draw_reliability(left, report.reliability())
        _draw_heldout(right, report)
    return [matrix, left, right]


def _draw_confusion(axis: Axes, confusion: Confusion, *, tight: bool) -> None:
    size = _TINY if tight else _SMALL
    for row, counts in enumerate(confusion.counts):
        for column, count in enumerate(counts):
            if count:
                shade = count / sum(counts)
                position = (row, column)
                draw_shaded(axis, position, shade, str(count), middle=_MIDDLE, fontsize=size)
        for right in _right_columns(confusion.rows[row]):
            frame = square((row, confusion.columns.index(right)), fill=False, edgecolor=BLACK)
            axis.add_patch(frame)
    rows = [_row_label(name, tight=tight) for name in confusion.rows]
    label_squares(axis, rows, [_spaced(name) for name in confusion.columns], rotation=90.0)
    if tight:
        axis.tick_params(labelsize=_TINY)
    axis.set_ylabel("hidden")
    gap = "\n" if tight else " "
    axis.set_xlabel(f"verdict (number of studies;{gap}shade: share of the row; frame: right)")
    _rule(axis, confusion)


def _rule(axis: Axes, confusion: Confusion) -> None:
    """Draw thin lines, along which a cell is followed to its labels."""
    axis.hlines(range(len(confusion.rows) + 1), 0, len(confusion.columns), color="0.9", zorder=0)
    axis.vlines(range(len(confusion.columns) + 1), 0, len(confusion.rows), color="0.9", zorder=0)


def _right_columns(row: str) -> tuple[str, ...]:
    """Return the right verdicts; of another form, every effect that it may be called by."""
    if row in _UNLISTED:
        return ("unexplained", "partly_explained")
    if row in _FORMS:
        return tuple(sorted(kin(row)))
    return () if row == WITH_LISTED else (row,)


def _row_label(row: str, *, tight: bool) -> str:
    if row in _FORMS and tight:
        return f"{_spaced(row)} (form)"
    if row in _FORMS:
        first, *others = _FORMS[row].family.split("/")
        return f"{_spaced(row)} (form of {_spaced(first)}{', …' if others else ''})"
    if row == SEVERAL:
        return "two effects"
    return f"{_spaced(row)} (outside)" if row in _UNLISTED else _spaced(row)


def _spaced(name: str) -> str:
    return name.replace("_", " ")


def _draw_reliability(axis: Axes, reliability: list[dict]) -> None:
    axis.plot([0, 1], [0, 1], color="0.7", linestyle="--")
    rows = [row["all"] for row in reliability]
    if rows:
        mean, share = ([row[key] for row in rows] for key in ("mean", "share"))
        bounds = np.transpose([row["bounds95"] for row in rows])
        axis.errorbar(
            mean, share, np.abs(bounds - share), fmt="o", color=colours()[0], markersize=4,
            capsize=2, clip_on=False,
        )  # fmt: skip
    for row in rows:
        point = (row["mean"], row["share"])
        offset = (5, -9) if row["share"] > 0.1 else (5, 3)
        axis.annotate(str(row["n"]), point, offset, textcoords="offset points", fontsize=_SMALL)
    axis.set(xlim=(0, 1), ylim=(0, 1.05), aspect="equal")
    axis.set_xlabel("stated probability of an effect")
    axis.set_ylabel("share in which it is hidden")
    axis.set_title("listed effects (number; 95 % bounds)", loc="left")


def _draw_heldout(axis: Axes, report: Report) -> None:
    for (kind, label), colour in zip(_LEGEND.items(), colours(), strict=False):
        pairs = heldout_ratios([case for case in report.seen if case["kind"] == kind])
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
    axis.set_xlabel("first model")
    axis.set_ylabel("last model")
    axis.set_title("error on left-out tests / noise floor", loc="left")
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="best", handletextpad=0.2)
