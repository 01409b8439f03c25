"""The page of many pads: a table to search, with a page for each of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from qlvbayes.diagnosis.phrases import BADGES, shown_effects
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.wording import number, to_sd
from qlvbayes.plots.cellmap import over_floor
from qlvbayes.report.collect import MARKS, facts_of, read_if_there

_CONSTANTS = 12  # columns of constants: those of most pads come first


@dataclass(frozen=True)
class OverviewRow:
    """A pad of the overview: folder, contents, verdict and its effects, errors, constants."""

    pad: str
    folder: str
    fluid: str
    verdict: str
    named: str
    fails: int | None  # phases in which structure beyond noise is left
    worst: str  # largest error over the noise
    constants: dict[str, tuple[str, float]]  # medians, as they are shown and as values to sort by


def overview_row(folder: Path) -> OverviewRow:
    """Return the row of one pad."""
    summary = read_if_there(FitSummary, folder / "summary.json")
    check = read_if_there(CheckResult, folder / "check.json")
    diagnosis = read_if_there(DiagnosisResult, folder / "diagnosis.json")
    parameters = summary.parameters if summary else {}
    worst = (
        max((over_floor(cell, check.noise) for cell in check.cells), default=None)
        if check
        else None
    )
    return OverviewRow(
        next((part.pad for part in (summary, check, diagnosis) if part), folder.name),
        folder.name,
        str(facts_of(folder / "posterior.nc").get("fluid") or ""),
        BADGES[diagnosis.verdict] if diagnosis else "not diagnosed",
        ", ".join(shown_effects(diagnosis)) if diagnosis else "",
        len(check.failing) if check else None,
        "" if worst is None else number(worst, 2),
        {
            f"{name} ({c.unit})" if c.unit != "1" else name: (to_sd(c.median, c.sd), c.median)
            for name, c in parameters.items()
            if not name.startswith("noise.")
        },
    )


def shown_constants(rows: Sequence[OverviewRow]) -> list[str]:
    """Return the constants that the table shows."""
    known = Counter(name for row in rows for name in row.constants)
    return [name for name, _ in known.most_common(_CONSTANTS)]


def is_older(page: Path, folder: Path) -> bool:
    """Return whether a pad's page is missing, or older than its results."""
    if not page.exists():
        return True
    made = page.stat().st_mtime_ns
    return any(f.stat().st_mtime_ns > made for m in MARKS if (f := folder / m).exists())
