"""Compute from a set of fits the coverage of intervals, errors and false alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

LOW, HIGH = 0.85, 0.95  # share of 90 % intervals that must hold the truth


@dataclass(frozen=True)
class Calibration:
    """One constant over n fits.

    inside: share of 90 % intervals that hold the truth; z_mean, z_sd: of (mean - truth)/sd; width:
    median width of the interval over the truth.
    """

    name: str
    n: int
    inside: float
    z_mean: float
    z_sd: float
    width: float

    @property
    def error(self) -> float:
        """Binomial standard error of ``inside``, from the share seen (shrunk off 0 and 1)."""
        share = (self.inside * self.n + 1.0) / (self.n + 2.0)
        return sqrt(share * (1.0 - share) / self.n)

    @property
    def within(self) -> bool:
        """Return whether the share is between 85 % and 95 %."""
        return LOW <= self.inside <= HIGH


def calibrations(fits: Sequence[dict]) -> list[Calibration]:
    """One row a constant, in the fits' order."""
    return [_calibration(name, fits) for name in fits[0]["parameters"]]


def _calibration(name: str, fits: Sequence[dict]) -> Calibration:
    columns = ("truth", "mean", "sd", "low", "high")
    rows = np.array([[fit["parameters"][name][key] for key in columns] for fit in fits])
    truth, mean, sd, low, high = rows.T
    z = (mean - truth) / sd
    inside = (low <= truth) & (truth <= high)
    return Calibration(
        name,
        len(fits),
        float(inside.mean()),
        float(z.mean()),
        float(z.std(ddof=1)) if len(fits) > 1 else float("nan"),
        float(np.median((high - low) / truth)),
    )


@dataclass(frozen=True)
class Alarms:
    """Cells called failing although the model is right: over studies, and over all cells."""

    studies: int
    alarmed: int
    cells: int
    failing: int


def alarms(fits: Sequence[dict]) -> Alarms:
    """Count false alarms."""
    failing = [sum(cell["fails"] for cell in fit["cells"]) for fit in fits]
    cells = sum(len(fit["cells"]) for fit in fits)
    return Alarms(len(fits), sum(count > 0 for count in failing), cells, sum(failing))


def predicted(fits: Sequence[dict], phase: str) -> tuple[float, float] | None:
    """Share of samples of unseen tests inside the 90 % predictive interval, in one kind of phase.

    Mean over fits, and its standard error; None where no such samples were seen.
    """
    shares = []
    for fit in fits:
        cells = [c for c in fit["cells"] if c["role"] == "validate" and c["phase"] == phase]
        if cells:
            weights = [cell["n"] for cell in cells]
            shares.append(np.average([cell["coverage90"] for cell in cells], weights=weights))
    if len(shares) < 2:
        return None
    return float(np.mean(shares)), float(np.std(shares, ddof=1) / sqrt(len(shares)))


def converged(fits: Sequence[dict]) -> float:
    """Share of fits whose sampling nothing speaks against."""
    return float(np.mean([fit["converged"] for fit in fits]))
