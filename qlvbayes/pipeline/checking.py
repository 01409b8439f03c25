"""The second step: predict every test from a saved fit and leave what was found on disk."""

from __future__ import annotations

from pathlib import Path

from qlvbayes.fitting.checked import CheckedPad, check_pad, curves
from qlvbayes.fitting.results import Saved
from qlvbayes.io.data import Measurements
from qlvbayes.pipeline.watcher import Watcher


def check_into(
    folder: Path, saved: Saved, study: Measurements, *, seed: int, watcher: Watcher
) -> tuple[CheckedPad, list[Path]]:
    """Check one fit; leave ``check.json``, ``curves.json`` and three figures in a folder.

    Returns what was found and the figures' paths. Raises InputError on an unknown pad.
    """
    with watcher.doing(f"pad {saved.pad}: predicting"):
        checked = check_pad(saved, study.pad(saved.pad), seed=seed)
        checked.check.write(folder / "check.json")
        curves(checked).write(folder / "curves.json")
        figures = _figures(checked, folder)
    for text in checked.check.notices:
        watcher.notice(text)
    watcher.checked(checked)
    return checked, figures


def _figures(checked: CheckedPad, folder: Path) -> list[Path]:
    # here, so that the other steps do not wait for matplotlib
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.forces import plot_forces
    from qlvbayes.plots.hysteresis import plot_hysteresis
    from qlvbayes.plots.residual_map import plot_residual_map

    units = checked.experiment.units
    return [
        save_figure(plot_forces(checked.predictions, units), folder / "forces"),
        save_figure(plot_hysteresis(checked.predictions, units), folder / "hysteresis"),
        save_figure(plot_residual_map(checked.check, units), folder / "residual_map"),
    ]
