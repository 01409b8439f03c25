"""A fit in numbers: what ``summary.json`` and the terminal's table show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from qlvbayes.carried import carried_notices, clock_notices
from qlvbayes.fit import Fit
from qlvbayes.inference import compiled
from qlvbayes.inference.diagnostics import diagnose_chain, highest_density
from qlvbayes.inference.ensemble import STEPS_PER_TIME
from qlvbayes.records.record import Record
from qlvbayes.units import PAD, UnitSystem
from qlvbayes.unresolved import unresolved_times


@dataclass(frozen=True)
class Constant:
    """One constant's posterior: mean, sd, median, 90 % highest-density interval, diagnostics."""

    name: str
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


@dataclass(frozen=True)
class Summary:
    """All constants of one pad, and whether the sampling can be trusted.

    troubles: what speaks against the sampling; notices: what one should know of the tests.
    """

    pad: str
    method: str
    effects: tuple[str, ...]
    constants: tuple[Constant, ...]
    troubles: tuple[str, ...]
    units: UnitSystem = PAD
    notices: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        """No R-hat, effective sample size or autocorrelation time speaks against it."""
        return not self.troubles

    def __getitem__(self, name: str) -> Constant:
        """The constant of that name."""
        return next(constant for constant in self.constants if constant.name == name)

    def as_dict(self) -> dict:
        """The content of ``summary.json``."""
        parameters = {
            c.name: {
                "unit": c.unit,
                "mean": c.mean,
                "sd": c.sd,
                "median": c.median,
                "hdi90": list(c.hdi90),
                "r_hat": c.r_hat,
                "ess_bulk": c.ess_bulk,
            }
            for c in self.constants
        }
        return {
            "schema": 1,
            "pad": self.pad,
            "units": self.units.as_dict(),
            "effects": list(self.effects),
            "sampler": self.method,
            "converged": self.converged,
            "troubles": list(self.troubles),
            "notices": list(self.notices),
            "parameters": parameters,
        }


def summarise(fit: Fit) -> Summary:
    """Means, sds, medians, intervals and diagnostics of every constant, before thinning."""
    sampled = fit.method == "emcee"
    diagnostics = diagnose_chain(fit.every) if sampled else None
    rows = []
    for k, (name, unit) in enumerate(zip(fit.names, fit.units, strict=True)):
        values = fit.every[..., k]
        rows.append(
            Constant(
                name,
                unit,
                _mean(values),
                _spread(values),
                float(np.median(values)),
                highest_density(values),
                _or_none(diagnostics.r_hat[k]) if diagnostics else None,
                _or_none(diagnostics.ess_bulk[k]) if diagnostics else None,
            )
        )
    return Summary(
        fit.pad,
        fit.method,
        fit.choices.effects,
        tuple(rows),
        (*(diagnostics.troubles if diagnostics else ()), *_length_troubles(fit)),
        fit.experiment.units,
        tuple(_notices(fit)),
    )


def _notices(fit: Fit) -> Iterator[str]:
    """What the tests have from each other and cannot say, by the median constants."""
    constants = np.median(fit.constants.reshape(-1, fit.constants.shape[-1]), axis=0)

    def predict(record: Record) -> np.ndarray:
        posterior = replace(fit.posterior, record=record)
        return np.asarray(compiled.predictions(posterior, constants[None]))[0]

    yield from carried_notices(fit.experiment, fit.trials, fit.posterior.record, predict)
    if not fit.choices.rested:
        yield from clock_notices(fit.experiment)
    model = fit.posterior.with_constants(jnp.asarray(constants))[0]
    times = unresolved_times(model.relaxation, fit.experiment.scales)
    for text in (*fit.experiment.floor.notices, *times):
        yield f"pad {fit.pad}: {text}"


def _mean(values: np.ndarray) -> float:
    """Mean; exactly the constant's value for one that does not vary."""
    return float(values.mean()) if np.ptp(values) > 0.0 else float(values.flat[0])


def _spread(values: np.ndarray) -> float:
    """Standard deviation; exactly 0 for a constant that does not vary."""
    return float(values.std()) if np.ptp(values) > 0.0 else 0.0


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _length_troubles(fit: Fit) -> list[str]:
    if fit.method != "emcee":
        return [] if fit.enough else ["no two starts came to the same optimum"]
    steps, time = fit.facts["kept_steps"], fit.facts["autocorrelation_steps"]
    if steps >= STEPS_PER_TIME * time:
        return []
    return [f"{steps:.0f} steps are less than {STEPS_PER_TIME} autocorrelation times of {time:.0f}"]
