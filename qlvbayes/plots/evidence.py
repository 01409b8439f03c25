"""Draw what a diagnosis found: the evidence, the error as effects are added, their strengths."""

from __future__ import annotations

from itertools import pairwise
from math import exp
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import (
    FixedLocator,
    LogLocator,
    NullFormatter,
    NullLocator,
    StrMethodFormatter,
)

from qlvbayes.diagnosis.phrases import parts
from qlvbayes.diagnosis.result import DiagnosisResult, Ranked, Stage, Strengths
from qlvbayes.plots.naming import broken, heading, three
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    SINGLE,
    canvas,
    colours,
    name_rows,
    narrow,
    percentage,
    quantity,
    shortened,
    style,
    titled_legend,
    write_right,
)

_ROW, _FRAME = 4.8, 40.0  # mm, a bar and the margins
_LINEAR = 10.0  # the axis is linear up to here and logarithmic beyond
_MUCH = 30.0  # largest value that is drawn on a linear axis
_ODDS = 3.0  # log Bayes factor, "strong" in Kass & Raftery 1995, doi:10.1080/01621459.1995.10476572
_TEXT_END = (36.0, 82.0)  # points right of the axes where the two columns of text end
_NOTE, _NOTE_TIGHT = 125, 56  # characters a line
_TIGHT_FRAME = 24.0  # mm, of labels and legend in one column
_LOOKS: dict[str, dict[str, Any]] = {  # colours by their index in the palette, greys by value
    "named in the verdict": {"facecolor": 0, "edgecolor": 0},
    "explains these tests as well": {"facecolor": 5, "edgecolor": BLACK, "linewidth": 1.2},
    "added, but structure is left": {"facecolor": "0.35", "edgecolor": "0.35"},
    "not named": {"facecolor": "0.72", "edgecolor": "0.72"},
    "these tests cannot show it": {"facecolor": "white", "edgecolor": "0.72", "linewidth": 0.6},
}
_NONE = "none of them"
_NAMED, _GROUP, _TRIED, _OTHER, _UNSEEN = _LOOKS


def plot_evidence(diagnosis: DiagnosisResult, *, width: float = DOUBLE) -> Axes:
    """Draw each effect's log Bayes factor for being in the model, the most probable on top.

    ``diagnosis`` is the diagnosis's result, ``width`` in mm; returns the axes. The factor is taken
    over all base laws and all other effects; a cross marks an effect that a check refused.
    """
    tight = narrow(width)
    with style():
        ranking = diagnosis.ranking
        height = _FRAME + tight * _TIGHT_FRAME + _ROW * len(ranking)
        figure = canvas(width, height)
        axis = figure.subplots()
        for row, ranked in enumerate(ranking):
            value, look = ranked.log_bayes_factor, _look(diagnosis, ranked)
            axis.barh(row, value or 0.0, height=0.7, gid=look, **_look_of(look))
            number = "–" if value is None else f"{value:z.1f}".replace("-", "−")
            number = "measured" if ranked.effect in _measured(diagnosis) else number
            for text, points in zip((number, percentage(ranked.inclusion)), _TEXT_END, strict=True):
                write_right(axis, text, row, points, ha="right")
        _scale(axis, [x for r in ranking if (x := r.log_bayes_factor) is not None], tight)
        _label(axis, diagnosis, ranking)
        _legend(figure, diagnosis, tight)
        _notes(figure, diagnosis, tight)
    return axis


def _look_of(name: str) -> dict[str, Any]:
    """Return face and edge of a kind of bar, with the colours in use."""
    palette = colours()
    return {k: palette[v] if isinstance(v, int) else v for k, v in _LOOKS[name].items()}


def _look(diagnosis: DiagnosisResult, ranked: Ranked) -> str:
    if ranked.effect in diagnosis.effects:
        return _NAMED
    if ranked.effect in diagnosis.group:
        return _GROUP
    if ranked.effect in diagnosis.tried:
        return _TRIED
    return _UNSEEN if ranked.effect in _unseen(diagnosis) else _OTHER


def _unseen(diagnosis: DiagnosisResult) -> list[str]:
    return [one.effect for one in diagnosis.not_identifiable]


def _scale(axis: Axes, values: list[float], tight: bool) -> None:
    """Scale the axis: linear, or logarithmic beyond 10 where small values would vanish."""
    low, high = min([0.0, *values]), max([0.0, *values])
    gap = "\n" if tight else " "
    name = f"log Bayes factor for being in the model{gap}(natural logarithm, no unit)"
    if max(high, -low) > _MUCH:
        axis.set_xscale("symlog", linthresh=_LINEAR, linscale=1.0)
        axis.xaxis.set_major_locator(FixedLocator(_ticks(low, high, tight)))
        axis.xaxis.set_minor_locator(NullLocator())
        axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_xlim(1.3 * low if low < -_LINEAR else low - 1.0, 1.3 * max(high, _ODDS))
        name += f";{gap}linear to ±10, logarithmic beyond"
    axis.set_xlabel(name)


def _ticks(low: float, high: float, tight: bool) -> list[float]:
    steps = [(10.0 if high < 100.0 or not tight else 100.0) ** k for k in range(1, 5)]
    fine = [step * 10.0**k for k in range(1, 9) for step in (1, 2, 5)]
    beyond = steps if tight or low < -100.0 else fine
    middle = [0.0] if tight else [-5.0, 0.0, 5.0]
    ticks = [-x for x in beyond if x <= -low] + middle + [x for x in beyond if x <= high]
    return [x for x in ticks if x >= 1.3 * low]


def _label(axis: Axes, diagnosis: DiagnosisResult, ranking: tuple[Ranked, ...]) -> None:
    refused = _refused(diagnosis)
    bold = [k for k, one in enumerate(ranking) if _look(diagnosis, one) in (_NAMED, _GROUP)]
    name_rows(axis, [_name(ranked, refused) for ranked in ranking], bold)
    axis.axvline(0.0, color=BLACK, linewidth=0.6)
    axis.axvline(_ODDS, color="0.4", linewidth=0.6, linestyle=":")
    for text, points in zip(("log BF", "probability"), _TEXT_END, strict=True):
        write_right(axis, text, 1.0, points, xycoords="axes fraction", ha="right", va="bottom")
    place: dict[str, Any] = {"xycoords": axis.get_xaxis_transform(), "va": "bottom"}
    axis.annotate("strong", (_ODDS, 1.0), ha="center", color="0.3", **place)


def _name(ranked: Ranked, refused: set[str]) -> str:
    if ranked.effect == "none":
        return _NONE
    return shortened(ranked.effect) + " ×" * (ranked.effect in refused)


def _measured(diagnosis: DiagnosisResult) -> set[str]:
    """Return the effects that every hypothesis has, as the readings show them beyond doubt."""
    shown = {one.effect for one in diagnosis.direct_evidence if one.beyond_doubt}
    without = {one.effect for one in diagnosis.ranking if one.log_bayes_factor is None}
    return shown & without & set(diagnosis.effects)


def _refused(diagnosis: DiagnosisResult) -> set[str]:
    return {refusal.effect for refusal in diagnosis.refused}


def _legend(figure: Figure, diagnosis: DiagnosisResult, tight: bool) -> None:
    used = {_look(diagnosis, ranked) for ranked in diagnosis.ranking}
    handles = [Patch(**_look_of(name), label=name) for name in _LOOKS if name in used]
    title = heading(diagnosis, tight=tight)
    titled_legend(figure, title, handles=handles, ncols=1 if tight else len(handles))


def _notes(figure: Figure, diagnosis: DiagnosisResult, tight: bool) -> None:
    ranked = {entry.effect for entry in diagnosis.ranking}
    unseen = [effect for effect in _unseen(diagnosis) if effect not in ranked]
    used = diagnosis.settings
    named = f"; an effect is named from {used.thresholds.named:g} on" if used else ""
    lines = [
        f"Sorted by probability, summed over all laws and all other effects{named}. Dotted: "
        f"odds of {exp(_ODDS):.0f} to 1 for the effect."
    ]
    if _measured(diagnosis):
        lines += [
            "Measured: the readings show it beyond doubt, so that every hypothesis that counts has "
            "it; –: no hypothesis with this one counts."
        ]
    if _refused(diagnosis):
        lines += ["×: refused by a check of the tests; the text of the diagnosis gives the reason."]
    if unseen:
        lines += [f"Not ranked, as these tests cannot show them: {', '.join(unseen)}."]
    text = "\n".join(fill(line, _NOTE_TIGHT if tight else _NOTE) for line in lines)
    figure.supxlabel(text, x=0.01, ha="left")


_STEP, _MARGIN, _TIGHT = 11.0, 30.0, 12.0  # mm: a step, the margins, and more in one column
_NAME, _NAME_TIGHT = 30, 18  # characters a line, of an effect's name
_LONG, _LONG_TIGHT = 130, 60  # characters a line
_FAR = 6.0  # ratio of highest to lowest beyond which the axis is logarithmic
_DECADES = 50.0  # ratio of highest to lowest below which 2 and 5 have ticks too
_RISE = (
    "An effect is added where the evidence rises, which weights readings by all their noise; RMSE "
    "weights them by stated sds alone."
)


def plot_error_staircase(diagnosis: DiagnosisResult, *, width: float = DOUBLE) -> Axes:
    """Draw the root mean square error of all samples after each step of the search, row by row.

    ``diagnosis`` is the diagnosis's result, ``width`` in mm; returns the axes. Full lines are all
    tests fitted together, dashes each test predicted from the others.
    """
    units, tight, stages = diagnosis.units, narrow(width), diagnosis.stages
    rows, fitted = np.arange(len(stages)), np.array([stage.rmse for stage in stages])
    heldout = np.array([stage.heldout_rmse for stage in stages], float)
    part = parts(diagnosis).removesuffix("s")
    with style():
        inks = colours()
        series: list[tuple[np.ndarray, str, Any, str, str]] = [
            (fitted, inks[0], "-", "o", f"all {part}s fitted"),
            (heldout, inks[1], "--", "s", f"each {part} predicted from the others"),
        ]
        shown = series if np.isfinite(heldout).all() else series[:1]  # nothing to predict
        figure = canvas(width, _MARGIN + _TIGHT * tight + _STEP * len(stages))
        axis = figure.subplots()
        _scale_errors(axis, np.concatenate([*(values for values, *_ in shown), [diagnosis.noise]]))
        for values, ink, line, marker, label in shown:
            edges = np.arange(values.size + 1) - 0.5
            look: dict[str, Any] = {"color": ink, "linestyle": line, "linewidth": 0.9}
            axis.stairs(values, edges, baseline=None, orientation="horizontal", **look)
            face = ink if marker == "o" else "none"
            size = 4.0 if marker == "o" else 7.0
            axis.plot(values, rows, marker, color=ink, mfc=face, markersize=size, label=label)
            for row, value in zip(rows, values, strict=True):
                # the larger of two values to the right of its mark, the smaller to the left
                right = not value < max(other[row] for other, *_ in shown)
                axis.annotate(
                    three(value), (value, row), xytext=(6 if right else -6, 0), color=ink,
                    textcoords="offset points", ha="left" if right else "right", va="center",
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8}, zorder=3,
                )  # fmt: skip
        floor = f"noise floor, {three(diagnosis.noise)} {units.force}"
        axis.axvline(diagnosis.noise, color=BLACK, linestyle=":", zorder=1, label=floor)
        most = _NAME_TIGHT if tight else _NAME
        names = ["plain model", *(_change(*pair, most) for pair in pairwise(stages))]
        name_rows(axis, names)
        axis.set_xlabel(quantity("RMSE, measured − modelled", units.force))
        entries = axis.get_legend_handles_labels()
        titled_legend(figure, heading(diagnosis, tight=tight), *entries, ncols=1 if tight else 3)
        if any(np.any(np.diff(values) > 0.0) for values, *_ in shown):
            note = fill(_RISE, _LONG_TIGHT if tight else _LONG)
            figure.supxlabel(note, x=0.01, ha="left")
    return axis


def _scale_errors(axis: Axes, values: np.ndarray) -> None:
    low, high = values.min(), values.max()
    if low > 0.0 and high > _FAR * low:
        axis.set_xscale("log")
        axis.set_xlim(0.5 * low, 2.0 * high)
        steps = (1.0, 2.0, 5.0) if high < _DECADES * low else (1.0,)
        axis.xaxis.set_major_locator(LogLocator(subs=steps))
        axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_formatter(NullFormatter())
    else:
        axis.set_xlim(0.0, 1.35 * high)


def _change(before: Stage, after: Stage, most: int) -> str:
    """Return what a step changed: '+ friction', '− viscous_drag', or the name of another law."""
    added = [name for name in after.effects if name not in before.effects]
    dropped = [name for name in before.effects if name not in after.effects]
    lines = [f"+ {broken(name, most)}" for name in added]
    lines += [f"− {broken(name, most)}" for name in dropped]
    lines += [broken(law, most) for law in after.base.others(before.base)]
    return "\n".join(lines)


_TEST, _MARGINS = 4.6, 16.0  # mm, a test and the margins of a panel


def plot_strengths(diagnosis: DiagnosisResult, *, width: float = SINGLE) -> Axes:
    """Draw the strength of each named effect in each test, over its mean, with one sd.

    The shaded region holds the scatter between tests, one sd either way. ``diagnosis`` is the
    diagnosis's result, ``width`` in mm; returns the axes of the last effect, or raises ValueError
    where no effect is named whose strength differs between tests.
    """
    found = diagnosis.strengths
    if not found:
        raise ValueError("no effect is named whose strength differs between tests")
    with style():
        heights = [_TEST * len(one.parts) + _MARGINS for one in found.values()]
        figure = canvas(width, sum(heights))
        panels = figure.subplots(len(found), squeeze=False, height_ratios=heights)[:, 0]
        for axis, (name, own) in zip(panels, found.items(), strict=True):
            _draw_strengths(axis, own)
            axis.set_xlabel(f"strength of {name} over its mean")
    return axis


def _draw_strengths(axis: Axes, own: Strengths) -> None:
    rows = np.arange(len(own.parts))[::-1]
    ratios, sds, shares = np.array([(one.ratio, one.sd, one.share) for one in own.parts]).T
    axis.axvspan(1.0 - own.spread, 1.0 + own.spread, color="0.9", linewidth=0.0)
    axis.axvline(1.0, color=BLACK, linewidth=0.6)
    axis.errorbar(ratios, rows, xerr=sds, fmt="none", color=colours()[0], linewidth=0.8)
    axis.scatter(ratios, rows, s=4.0 + 30.0 * shares / shares.max(), color=colours()[0], zorder=3)
    axis.set_yticks(rows, [one.test for one in own.parts])
    axis.set_ylim(-0.7, rows.size - 0.3)
    axis.set_xlim(left=min(0.0, float((ratios - sds).min())))
