"""Two pads, equal or not: simulated, fitted and compared as a user would, in one dict."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from simulated_fits import MOST_STEPS, measured, true_values

from qlvbayes import Choices, Comparison, Fit, Settings, compare
from qlvbayes.comparison.readings import choose, read, readings
from qlvbayes.comparison.side import side_of
from qlvbayes.fitting.fit import fit_pad
from qlvbayes.io.units import PAD
from qlvbayes.model.drawn import described_model, drawn_models
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import NOISES, PAPER_RATES, Constants, draw_constants, simulate_study

KINDS = ("equal", "near", "equal", "far")
NEAR = 0.05  # sd of the logarithm of each constant's ratio, in a near pair
ROWS = 500
PLACES = {"depth": 1.5, "rates": (0.1, 3.0, 30.0), "frequencies": (0.1, 0.3, 1.0, 3.0)}


def run_pair(
    seed: int,
    index: int,
    settings: Settings | None = None,
    rates: tuple[float, ...] = PAPER_RATES,
) -> dict:
    """Simulate pair ``index``, fit all tests of both pads, compare, and set it against the truth.

    The pair depends on seed and index only, not on how many there are.
    """
    rng = np.random.default_rng([seed, index, *b"pairs"])
    kind = KINDS[index % len(KINDS)]
    truth = draw_pair(kind, rng)
    begun = time.perf_counter()
    fits = [_fit(constants, rng, index, settings, rates) for constants in truth]
    fitted = time.perf_counter()
    found = compare(*fits, names=("first", "second"), seed=index, **PLACES)
    omnibus = found.omnibus
    return {
        "index": index,
        "kind": kind,
        "fit_seconds": fitted - begun,
        "compare_seconds": time.perf_counter() - fitted,
        "converged": [fit.summary().converged for fit in fits],
        "differ": found.differ,
        "p_value": None if omnibus is None else omnibus.p_value,
        "region": found.region,
        "contrasts": _against_truth(found, fits[0], truth),
    }


def draw_pair(kind: str, rng: np.random.Generator) -> tuple[Constants, Constants]:
    """Constants of both: the same, a few per cent apart, or drawn independently."""
    first = draw_constants(rng)
    if kind == "equal":
        return first, first
    if kind == "far":
        return first, draw_constants(rng)
    shift = np.exp(NEAR * rng.standard_normal(7))
    c = np.array(first.c) * shift[2:5]
    v = tuple(float(x) for x in np.array(first.v) * shift[5:])
    c0, c1, c2 = (float(x) for x in c / c.sum())
    return first, replace(
        first, m=first.m * float(shift[0]), b=first.b * float(shift[1]), c=(c0, c1, c2), v=v
    )


def _fit(
    truth: Constants,
    rng: np.random.Generator,
    index: int,
    settings: Settings | None,
    rates: tuple[float, ...],
) -> Fit:
    noise = NOISES["correlated"]
    tests = simulate_study({"pad": truth}, rates, noise, int(rng.integers(2**32)), ROWS)
    experiment = prepare(measured(tests), all_tests=True)
    chosen = settings or Settings(seed=index, max_steps=MOST_STEPS)
    return fit_pad(experiment, Choices(), settings=chosen)


def true_quantities(fit: Fit, truth: Constants) -> dict[str, float]:
    """Every constant, and what is read from a model with the true ones."""
    values = true_values(truth, NOISES["correlated"])
    names = [name for name in values if not name.startswith("noise.")]
    table = np.array([[values[name] for name in names]])
    settings = choose([side_of(fit, "").reach], **PLACES)
    numbers = read(drawn_models(described_model(Choices()), names, table), settings)[0]
    read_names = [reading.quantity for reading in readings(settings, PAD)]
    return {name: values[name] for name in names} | dict(
        zip(read_names, map(float, numbers), strict=True)
    )


def _against_truth(
    found: Comparison, fit: Fit, truth: tuple[Constants, Constants]
) -> dict[str, dict]:
    first, second = (true_quantities(fit, constants) for constants in truth)
    return {
        c.quantity: {
            "group": c.group,
            "first": first[c.quantity],
            "second": second[c.quantity],
            "low": c.difference.low,
            "high": c.difference.high,
            "answer": c.answer,
        }
        for c in found.contrasts
    }
