"""One pad from random constants: simulated, fitted and checked as a user would, in one dict."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes import Choices, Fit, Pad, Settings, Test
from qlvbayes.fitting.fit import fit_pad
from qlvbayes.fitting.prediction import predict
from qlvbayes.fitting.residuals import check
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import (
    NOISES,
    PAPER_RATES,
    Constants,
    Noise,
    SimulatedTest,
    draw_constants,
    simulate_study,
)

MOST_STEPS = 15_000  # fewer than the default, as a fit that needs more would take minutes


@dataclass(frozen=True)
class Setting:
    """Setting of a simulation: kind of noise, rows a test keeps, loading rates."""

    noise: str
    rows: int | None
    rates: tuple[float, ...] = PAPER_RATES

    @property
    def name(self) -> str:
        """A name for files."""
        rows = "full" if self.rows is None else str(self.rows)
        return f"{self.noise}-{rows}-{len(self.rates)}"

    def describe(self) -> str:
        """In words."""
        noise = NOISES[self.noise]
        kind = f"white noise of {noise.white:g} N"
        if noise.correlated:
            kind += (
                f" and correlated noise of {noise.correlated:g} N over {noise.correlation_time:g} s"
            )
        rows = "1 kHz records" if self.rows is None else f"records of {self.rows} rows"
        tests = "six tests a pad" if len(self.rates) > 1 else "one test a pad"
        return f"{kind}, {rows}, {tests}"


def run(setting: Setting, seed: int, index: int, settings: Settings | None = None) -> dict:
    """Simulate pad ``index``, fit its 20 mm/s test, and check the fit against every test.

    The pad depends on setting, seed and index only, not on how many pads there are.
    """
    rng = np.random.default_rng([seed, index, *setting.name.encode()])
    truth = draw_constants(rng)
    noise = NOISES[setting.noise]
    tests = simulate_study(
        {"pad": truth}, setting.rates, noise, int(rng.integers(2**32)), setting.rows
    )
    begun = time.perf_counter()
    experiment = prepare(measured(tests))
    fit = fit_pad(
        experiment,
        Choices(),
        settings=settings or Settings(seed=index, max_steps=MOST_STEPS),
    )
    summary = fit.summary()
    seconds = time.perf_counter() - begun
    return {
        "index": index,
        "seconds": seconds,
        "converged": summary.converged,
        "steps": fit.facts["steps"],
        "parameters": _parameters(fit, summary, true_values(truth, noise)),
        "cells": _cells(fit),
    }


def measured(tests: Sequence[SimulatedTest]) -> Pad:
    """Simulated tests of one pad as if they had been read from a file."""
    found = tuple(
        Test(t.name, t.pad, t.record.time, t.record.displacement, t.record.force, start_s=t.start_s)
        for t in tests
    )
    return Pad(tests[0].pad, found, PAD)


def true_values(truth: Constants, noise: Noise) -> dict[str, float]:
    """Every constant of the simulation by the name that a fit gives it."""
    values = {"m": truth.m, "b": truth.b}
    values |= {f"c[{k}]": c for k, c in enumerate(truth.c)}
    values |= {f"v[{k}]": v for k, v in enumerate(truth.v, start=1)}
    values["noise.white"] = noise.white
    if noise.correlated:
        values |= {"noise.ou": noise.correlated, "noise.tau": noise.correlation_time}
    return values


def _parameters(fit: Fit, summary: FitSummary, truth: dict[str, float]) -> dict[str, dict]:
    draws = fit.every.reshape(-1, fit.every.shape[-1])
    return {
        name: {
            "truth": truth[name],
            "mean": c.mean,
            "sd": c.sd,
            "low": c.hdi90[0],
            "high": c.hdi90[1],
            "below": float(np.mean(draws[:, k] < truth[name])),
        }
        for k, (name, c) in enumerate(summary.parameters.items())
        if name in truth and not c.fixed
    }


def _cells(fit: Fit) -> list[dict]:
    constants = {name: fit.constants[..., k] for k, name in enumerate(fit.names)}
    experiment = fit.experiment
    predictions = predict(experiment, fit.choices, constants, experiment.trials)
    return check(fit.pad, experiment.floor.total, predictions).as_dict()["cells"]
