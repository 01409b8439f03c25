"""Do the second step: predict every test from a saved fit and save the errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from qlvbayes.fitting.pad_check import CheckedPad, check_pad, curves
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.results import Saved, load
from qlvbayes.io.data import Measurements
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.plots.catalogue import save_figures


@dataclass(frozen=True)
class CheckStep:
    """Step that checks a pad's fit, repeated for many pads; ``posterior``: digest of the fit."""

    name: ClassVar[str] = "check"
    reads: ClassVar[tuple[str, ...]] = ("posterior.nc",)

    posterior: str
    seed: int

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Check the fit in the folder; see `check_into`."""
        check_into(folder, load(folder / "posterior.nc"), study, seed=self.seed, watcher=watcher)

    def report_saved(self, folder: Path, watcher: Watcher) -> None:
        """Report the check in the folder; see `report_saved_check`."""
        report_saved_check(folder, watcher)


def report_saved_check(folder: Path, watcher: Watcher) -> None:
    """Report the check that is saved in a folder."""
    check = CheckResult.read(folder / "check.json")
    for text in check.notices:
        watcher.notice(text)
    watcher.checked(check)


def check_into(
    folder: Path, saved: Saved, study: Measurements, *, seed: int, watcher: Watcher
) -> CheckedPad:
    """Check one fit; leave ``check.json``, ``curves.json`` and the figures in a folder."""
    with watcher.doing(f"pad {saved.pad}: predicting"):
        checked = check_pad(saved, study.pad(saved.pad), seed=seed)
        checked.check.write(folder / "check.json")
        curves(checked).write(folder / "curves.json")
        save_figures("check", folder, checked)
    for text in checked.check.notices:
        watcher.notice(text)
    watcher.checked(checked.check)
    return checked
