"""Save the figures and tables of all pads.

Matplotlib is imported when something is drawn, so that the other steps do not wait for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from qlvbayes.fitting.pad_check import Curves, TestCurves
from qlvbayes.fitting.summary import (
    FitSummary,
    constants_table,
    matching_references,
    read_references,
    write_constants,
)
from qlvbayes.pipeline.source import REFERENCES
from qlvbayes.report.page import MOST_ON_A_PAGE


@dataclass(frozen=True)
class ReferenceFile:
    """File of reference values; ``required``: the user gave it, so all must be usable."""

    file: Path
    required: bool


def find_references(folder: Path, given: Path | None) -> ReferenceFile | None:
    """Return the file of references: the one given, else paper_table1.csv in the data's folder."""
    if given is not None:
        read_references(given)
        return ReferenceFile(given, required=True)
    default = folder / REFERENCES
    return ReferenceFile(default, required=False) if default.is_file() else None


def draw_constants(out: Path, references: ReferenceFile | None) -> list[Path]:
    """Write the constants of all pads into ``out``: constants.csv, constants.tex and a figure."""
    files = sorted(out.glob("*/summary.json"))
    summaries = [FitSummary.read(file) for file in files]
    known = read_references(references.file) if references else {}
    required = references is not None and references.required
    usable = known if required else matching_references(known, summaries)
    entries = constants_table(summaries, usable)
    few = len(files) <= MOST_ON_A_PAGE
    write_constants(out, entries, for_print=few)
    if not few:
        return []
    from qlvbayes.plots.constants import plot_constants
    from qlvbayes.plots.files import save_figure

    label = f"reference ({references.file.name})" if references else "reference"
    return [save_figure(plot_constants(entries, reference=label), out / "constants")]


def draw_forces_at_rates(out: Path) -> list[Path]:
    """Draw the figure forces_at_rates of two checked pads or more in one unit; return its path."""
    files = sorted(out.glob("*/curves.json"))
    if not 2 <= len(files) <= MOST_ON_A_PAGE:
        return []
    pads = [Curves.read(file) for file in files]
    if len({pad.units for pad in pads}) > 1:
        return []
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.forces_at_rates import plot_forces_at_rates

    predictions: Any = {
        pad.pad: [_DrawnPrediction.from_curves(test) for test in pad.tests] for pad in pads
    }
    return [save_figure(plot_forces_at_rates(predictions, pads[0].units), out / "forces_at_rates")]


@dataclass(frozen=True, eq=False)
class _DrawnPrediction:
    """Saved curves that a figure of the force needs of a prediction."""

    trial: SimpleNamespace
    time: np.ndarray
    observed: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def from_curves(cls, test: TestCurves) -> _DrawnPrediction:
        rate = np.nan if test.rate is None else test.rate
        trial = SimpleNamespace(rate=rate, phases=test.phases)
        curves = (test.time, test.observed, test.mean, test.low, test.high)
        return cls(trial, *map(np.asarray, curves))
