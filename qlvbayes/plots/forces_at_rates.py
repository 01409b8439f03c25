"""Draw force against time at a few loading rates, for several pads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import pad_title, rated
from qlvbayes.plots.panels import legend_entries
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    LINES,
    MARKERS,
    canvas,
    colours,
    force_label,
    narrow,
    shortened,
    style,
)
from qlvbayes.plots.timeline import decades, logarithmic, since_contact

RATES = (0.1, 1.0, 30.0)  # mm/s, the paper's Fig. 5
_PANEL, _FRAME, _LINE = 46.0, 12.0, 4.2  # mm: a panel, the margins, a line of the legend
_TIME = "time since the first movement (s)"
_SAME = 0.02  # relative difference of rates below which pads share a label


def plot_forces_at_rates(
    predictions: Mapping[str, Sequence[Prediction]],
    units: UnitSystem,
    *,
    rates: Sequence[float] | None = None,
    width: float = DOUBLE,
) -> list[Axes]:
    """Draw measured and predicted force of each pad's tests nearest to some loading rates.

    Time since the first movement is logarithmic (upper panels; left in one column) and linear;
    where the rates do not span a decade, linear alone.

    Parameters
    ----------
    predictions, units, width
        The predictions by the pad's name, the units of displacement and force, the width (mm).
    rates
        In the unit of speed, the nearest in the logarithm are drawn; by default 0.1, 1 and 30 mm/s,
        or for specimens in strain the slowest, the middle and the fastest of the first.

    Returns
    -------
    list of Axes
        The panels, pad by pad.
    """
    tight = narrow(width)
    asked = rates or _default_rates(units, next(iter(predictions.values())))
    chosen = {name: _nearest(nearby, asked) for name, nearby in predictions.items()}
    trials = [p.trial for nearby in chosen.values() for p in nearby]
    scales = ["log", "linear"] if decades(trials) else ["linear"]
    every = range(max(map(len, chosen.values())))
    rates_of = [[p[k].trial.rate for p in chosen.values() if len(p) > k] for k in every]
    names = [_rates_text(rates, units.speed) for rates in rates_of]
    with style():
        shape = (len(chosen), len(scales)) if tight else (len(scales), len(chosen))
        lines = 3 if tight else 2
        figure = canvas(width, _FRAME + _PANEL * shape[0] + _LINE * lines)
        axes = figure.subplots(*shape, sharey=True, squeeze=False)
        by_pad = axes if tight else axes.T
        for (name, nearby), row in zip(chosen.items(), by_pad, strict=True):
            row[0].set_title(pad_title(shortened(name, 24)), loc="left", weight="bold")
            for axis, scale in zip(row, scales, strict=True):
                _draw(axis, nearby, names)
                if scale == "log":
                    logarithmic(axis, trials, ticks=3 if tight else 6)
        for axis in axes[:, 0]:
            axis.set_ylabel(force_label(units))
        for axis in axes[-1]:
            axis.set_xlabel("time since the\nfirst movement (s)" if tight else _TIME)
        title, most = "marks: measured; lines: posterior mean", 2 if tight else len(names) + 1
        look: dict[str, Any] = {"loc": "outside upper center", "markerscale": 3.0, "ncols": most}
        figure.legend(*legend_entries(figure), title=title, **look)
    return list(by_pad.flat)


def _default_rates(units: UnitSystem, predictions: Sequence[Prediction]) -> tuple[float, ...]:
    if not units.dimensionless:
        return tuple(rate * units.mm_per_s for rate in RATES)
    rates = sorted(p.trial.rate for p in predictions if np.isfinite(p.trial.rate))
    return (rates[0], rates[len(rates) // 2], rates[-1]) if rates else ()


def _nearest(predictions: Sequence[Prediction], rates: Sequence[float]) -> list[Prediction]:
    """Return the test nearest to each rate, each once, slowest first; all where none has a rate."""
    rated_ones = [p for p in predictions if np.isfinite(p.trial.rate)]
    picked = {
        min(range(len(rated_ones)), key=lambda k: abs(np.log(rated_ones[k].trial.rate / rate)))
        for rate in rates
        if rated_ones
    }
    nearest = sorted((rated_ones[k] for k in picked), key=lambda p: p.trial.rate)
    return nearest or list(predictions)


def _draw(axis: Axes, predictions: Sequence[Prediction], names: Sequence[str]) -> None:
    palette = colours()
    for k, (prediction, name) in enumerate(zip(predictions, names, strict=False)):
        colour, mark = palette[k % len(palette)], MARKERS[k % len(MARKERS)]
        time = since_contact(prediction.trial, prediction.time)
        look: dict[str, Any] = {"markersize": 1.5, "markeredgewidth": 0, "label": name}
        axis.plot(time, prediction.observed, mark, color=colour, gid="measured", **look)
        axis.plot(time, prediction.mean, LINES[k % len(LINES)], color=BLACK, linewidth=0.7)
        band = "90 % predictive band" if name == names[-1] else ""
        look = {"color": colour, "alpha": 0.3, "linewidth": 0, "label": band}
        axis.fill_between(time, prediction.low, prediction.high, **look)


def _rates_text(rates: Sequence[float], unit: str) -> str:
    low, high = min(rates), max(rates)
    if not np.isfinite(low):
        return "all tests"
    middle = rated(float(np.median(rates)), unit)
    same = high - low < _SAME * low
    return middle if same else f"{rated(low, unit)} to {rated(high, unit)}"
