"""Write the four figures of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.axes import Axes

from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.plots.error_staircase import plot_error_staircase
from qlvbayes.plots.evidence import plot_evidence
from qlvbayes.plots.files import save_figure
from qlvbayes.plots.forces_before_after import plot_forces_before_after
from qlvbayes.plots.residuals_before_after import plot_residuals_before_after

FIGURES: dict[str, Callable[[Diagnosis], Axes | Sequence[Axes]]] = {
    "residuals_before_after": lambda diagnosis: plot_residuals_before_after(diagnosis.result),
    "forces_before_after": plot_forces_before_after,
    "evidence": lambda diagnosis: plot_evidence(diagnosis.result),
    "error_staircase": lambda diagnosis: plot_error_staircase(diagnosis.result),
}


def save_diagnosis_figures(diagnosis: Diagnosis, folder: Path) -> list[Path]:
    """Write every figure into a folder, as PDF and PNG, and return the paths of the images.

    An OSError is raised where nothing can be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return [save_figure(plot(diagnosis), folder / name) for name, plot in FIGURES.items()]
