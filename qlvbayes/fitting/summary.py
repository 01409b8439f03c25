"""A fit in numbers: ``summary.json``, and what terminal and report show of it."""

from __future__ import annotations

import numpy as np

from qlvbayes.fitting.diagnostics import Diagnostics, highest_density
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.io.resultfile import Part, Result
from qlvbayes.io.units import PAD, UnitSystem


class Constant(Part, frozen=True):
    """One constant's posterior: mean, sd, median, 90 % highest-density interval, diagnostics.

    r_hat, ess_bulk: None where there is no chain to judge.
    """

    unit: str
    mean: float
    sd: float
    median: float
    hdi90: tuple[float, float]
    r_hat: float | None
    ess_bulk: float | None

    @property
    def fixed(self) -> bool:
        """Whether it was not fitted."""
        return self.sd == 0.0


class FitSummary(Result, frozen=True, kw_only=True):
    """All constants of one pad, and whether the sampling can be trusted: ``summary.json``.

    sampler: the method; converged: no R-hat, effective sample size or autocorrelation time speaks
    against it; troubles: what does; notices: what one should know of the tests; settings: of the
    sampler; parameters: the constants by name.
    """

    pad: str
    units: UnitSystem = PAD
    effects: tuple[str, ...]
    sampler: str
    converged: bool
    troubles: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    settings: Settings | None = None
    parameters: dict[str, Constant]

    def __getitem__(self, name: str) -> Constant:
        """The constant of that name."""
        return self.parameters[name]

    def __str__(self) -> str:
        """A line a constant: median, 90 % interval and unit."""
        wide = max(map(len, self.parameters), default=0)
        lines = [
            f"{name:{wide}}  {c.median:.4g} [{c.hdi90[0]:.4g}, {c.hdi90[1]:.4g}]"
            f"{'' if c.unit == '1' else f' {c.unit}'}{' (fixed)' if c.fixed else ''}"
            for name, c in self.parameters.items()
        ]
        return "\n".join([*lines, *(f"not converged: {text}" for text in self.troubles)])


def constant_of(values: np.ndarray, unit: str, place: int, judged: Diagnostics | None) -> Constant:
    """Draws (chains, draws) of one constant in numbers; place: its own in the diagnostics."""
    varies = np.ptp(values) > 0.0  # else exactly the constant's value, and exactly 0
    return Constant(
        unit=unit,
        mean=float(values.mean()) if varies else float(values.flat[0]),
        sd=float(values.std()) if varies else 0.0,
        median=float(np.median(values)),
        hdi90=highest_density(values),
        r_hat=_or_none(judged.r_hat[place]) if judged else None,
        ess_bulk=_or_none(judged.ess_bulk[place]) if judged else None,
    )


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
