"""A fit in numbers: ``summary.json``, and what terminal and report show of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from qlvbayes.carried import carried_notices, clock_notices
from qlvbayes.fit import Fit
from qlvbayes.inference import compiled
from qlvbayes.inference.diagnostics import Diagnostics, diagnose_chain, highest_density
from qlvbayes.inference.ensemble import STEPS_PER_TIME
from qlvbayes.records.record import Record
from qlvbayes.resultfile import Part, Result
from qlvbayes.units import PAD, UnitSystem
from qlvbayes.unresolved import unresolved_times


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
    against it; troubles: what does; notices: what one should know of the tests; parameters: the
    constants by name.
    """

    pad: str
    units: UnitSystem = PAD
    effects: tuple[str, ...]
    sampler: str
    converged: bool
    troubles: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    parameters: dict[str, Constant]

    def __getitem__(self, name: str) -> Constant:
        """The constant of that name."""
        return self.parameters[name]


def summarise(fit: Fit) -> FitSummary:
    """Means, sds, medians, intervals and diagnostics of every constant, before thinning."""
    judged = diagnose_chain(fit.every) if fit.method == "emcee" else None
    troubles = (*(judged.troubles if judged else ()), *_length_troubles(fit))
    return FitSummary(
        pad=fit.pad,
        units=fit.experiment.units,
        effects=fit.choices.effects,
        sampler=fit.method,
        converged=not troubles,
        troubles=troubles,
        notices=tuple(_notices(fit)),
        parameters={
            name: constant_of(fit.every[..., k], unit, k, judged)
            for k, (name, unit) in enumerate(zip(fit.names, fit.units, strict=True))
        },
    )


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


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _length_troubles(fit: Fit) -> list[str]:
    if fit.method != "emcee":
        return [] if fit.enough else ["no two starts came to the same optimum"]
    steps, time = fit.facts["kept_steps"], fit.facts["autocorrelation_steps"]
    if steps >= STEPS_PER_TIME * time:
        return []
    return [f"{steps:.0f} steps are less than {STEPS_PER_TIME} autocorrelation times of {time:.0f}"]
