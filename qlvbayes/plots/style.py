"""One look for every figure: widths of a journal's columns, type, colours."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

import matplotlib

MM = 1.0 / 25.4  # inches
SINGLE, MIDDLE, DOUBLE = 85.0, 120.0, 180.0  # mm, one, one and a half and two columns

# Okabe and Ito, told apart by colour-blind readers.
BLACK = "#000000"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with Matplotlib
    "font.size": 7.5,
    "axes.titlesize": 7.5,
    "axes.labelsize": 7.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.5,
    "figure.facecolor": "white",
    "axes.linewidth": 0.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.minor.width": 0.3,
    "ytick.minor.width": 0.3,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "lines.linewidth": 0.8,
    "legend.frameon": False,
    "hatch.linewidth": 0.4,
    "pdf.fonttype": 42,  # whole TrueType fonts: text stays text
    "svg.fonttype": "none",
}


def style() -> AbstractContextManager[None]:
    """Use ``STYLE`` within a ``with``; settings made by others come back after it."""
    return matplotlib.rc_context(STYLE)


def quantity(name: str, unit: str) -> str:
    """Label of an axis: 'force (N)'; the name alone where the unit is 1, dimensionless."""
    return name if unit == "1" else f"{name} ({unit})"


def rated(rate: float, unit: str) -> str:
    """Three digits of a loading rate with its unit: '29.3 mm/s', '0.226/s'."""
    return f"{float(f'{rate:.3g}'):g} {unit}".replace(" 1/", "/")


def shortened(name: str, most: int = 40) -> str:
    """Cut a name that would not fit on the page."""
    return name if len(name) <= most else f"{name[: most - 1]}…"
