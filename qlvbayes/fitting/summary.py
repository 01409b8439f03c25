"""Summarise a fit in numbers: ``summary.json``, and what terminal and report show of it."""

from __future__ import annotations

import numpy as np

from qlvbayes.fitting.diagnostics import Diagnostics, highest_density
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.io.arrays import finite_or_none
from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem


class Constant(Part, frozen=True):
    """The posterior of one constant: mean, sd, median, 90 % highest-density interval, diagnostics.

    r_hat, ess_bulk: None where there is no chain.
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
        """Return whether the constant was not fitted."""
        return self.sd == 0.0


class FitSummary(Result, frozen=True, kw_only=True):
    """Posterior of every constant of one pad, and whether its sampling converged: ``summary.json``.

    pad: Name of the pad; units: Units of displacement and force, from which those of the constants
    follow; effects: Names of the model's effects; sampler: Method of the fit: ``emcee``,
    ``least-squares`` or ``two-step``; converged: Whether no R-hat, effective sample size or
    autocorrelation time speaks against the sampling; of least squares, whether two starts came to
    the same optimum; troubles: Messages on what speaks against it; empty where ``converged`` is
    true; notices: Sentences on the tests and their noise, such as what the tests cannot determine;
    settings: Settings of the sampler, of which least squares use the seed alone; None where not
    stated; parameters: Posterior of each constant by its name, as ``m`` or ``v[1]``, in the
    constant's own unit.
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
        """Return the constant of a name."""
        return self.parameters[name]

    def __str__(self) -> str:
        """Return a line for each constant: median, 90 % interval and unit."""
        wide = max(map(len, self.parameters), default=0)
        lines = [
            f"{name:{wide}}  {c.median:.4g} [{c.hdi90[0]:.4g}, {c.hdi90[1]:.4g}]"
            f"{'' if c.unit == '1' else f' {c.unit}'}{' (fixed)' if c.fixed else ''}"
            for name, c in self.parameters.items()
        ]
        return "\n".join([*lines, *(f"not converged: {text}" for text in self.troubles)])


def constant_of(
    values: np.ndarray, unit: str, index: int, diagnostics: Diagnostics | None
) -> Constant:
    """Return the summary of draws (chains, draws) of one constant."""
    varies = (
        np.ptp(values) > 0.0
    )  # a fixed constant keeps its exact value, and has an sd of exactly 0
    return Constant(
        unit=unit,
        mean=float(values.mean()) if varies else float(values.flat[0]),
        sd=float(values.std()) if varies else 0.0,
        median=float(np.median(values)),
        hdi90=highest_density(values),
        r_hat=finite_or_none(diagnostics.r_hat[index]) if diagnostics else None,
        ess_bulk=finite_or_none(diagnostics.ess_bulk[index]) if diagnostics else None,
    )
