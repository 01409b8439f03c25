"""The figures and tables of all pads, and those of one fit, on disk.

Matplotlib is imported when something is drawn, so that the other steps do not wait for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from qlvbayes.fitting.checked import CheckedPad
from qlvbayes.fitting.constants_table import (
    constants_table,
    read_references,
    that_fit,
    write_constants,
)
from qlvbayes.fitting.fit import Fit
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.data import Measurements
from qlvbayes.preprocess.experiment import Experiment

REFERENCES = "paper_table1.csv"


def draw_fit(folder: Path, found: Fit, experiment: Experiment) -> list[Path]:
    """Leave the figures pairs and programme of one pad in a folder; return the images."""
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.pairs import plot_pairs
    from qlvbayes.plots.programme import plot_programme

    return [
        save_figure(plot_pairs(found), folder / "pairs"),
        save_figure(plot_programme(experiment), folder / "programme"),
    ]


@dataclass(frozen=True)
class Known:
    """A file of reference values, and whether it was asked for: then all of it must be usable."""

    file: Path
    asked: bool


def references_of(study: Measurements, given: Path | None) -> Known | None:
    """The file of reference values: what is given, else paper_table1.csv beside the measurements.

    None where there is none. Raises InputError where a given file cannot be used.
    """
    if given is not None:
        read_references(given)
        return Known(given, asked=True)
    beside = Path(study.source).with_name(REFERENCES)
    return Known(beside, asked=False) if beside.is_file() else None


def draw_constants(out: Path, references: Known | None) -> list[Path]:
    """Leave the constants of all pads in ``out`` as figure, constants.csv and constants.tex.

    Returns the images. Raises InputError where the references cannot be used.
    """
    from qlvbayes.plots.constants import plot_constants
    from qlvbayes.plots.files import save_figure

    files = sorted(out.glob("*/summary.json"))
    summaries = [FitSummary.read(file) for file in files]
    known = read_references(references.file) if references else {}
    usable = known if references and references.asked else that_fit(known, summaries)
    entries = constants_table(summaries, usable)
    write_constants(out, entries)
    label = f"reference ({references.file.name})" if references else "reference"
    return [save_figure(plot_constants(entries, reference=label), out / "constants")]


def draw_forces_at_rates(out: Path, checked: Sequence[CheckedPad]) -> list[Path]:
    """Leave the figure forces_at_rates in ``out`` where there are two pads or more in one unit."""
    if len(checked) < 2 or len({pad.experiment.units for pad in checked}) > 1:
        return []
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.forces_at_rates import plot_forces_at_rates

    predictions = {pad.check.pad: pad.predictions for pad in checked}
    axes = plot_forces_at_rates(predictions, checked[0].experiment.units)
    return [save_figure(axes, out / "forces_at_rates")]
