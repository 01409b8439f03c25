"""One blind study: a random pad with something hidden, tested and measured by the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np

from qlvbayes.evaluation.plan import Item, Plan
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.simulate import (
    NOISES,
    PAPER_RATES,
    Constants,
    Effect,
    HiddenPad,
    Noise,
    SimulatedTest,
    Step,
    draw_constants,
    draw_effect,
    elastic_force,
    full_retraction_protocol,
    paper_protocol,
    record_study,
)

ROWS = 500  # a test
DEPTH = 1.6  # mm, of both protocols
SIZES = {"single": (0.02, 0.12), "double": (0.04, 0.12), "form": (0.02, 0.12)}
SIZES |= {"outside": (0.05, 0.15)}  # largest contribution of an effect over the peak force
NOISE_FACTOR = 2.0  # either way, of the sds of the noise
NOISE_TIME = (0.2, 1.5)  # s
RETRACTIONS = 2  # tests of a mixed study that go back to zero, the others are the paper's


@dataclass(frozen=True)
class Tests:
    """Programs of a study: the paper's test at every rate (mm/s), but full retraction at some."""

    __test__ = False  # not for pytest

    retracted: tuple[float, ...] = ()

    def program(self, rate: float) -> tuple[Step, ...]:
        """What the platen does at one rate (mm/s)."""
        protocol = full_retraction_protocol if rate in self.retracted else paper_protocol
        return protocol(rate)

    def run(self, pad: HiddenPad, noise: Noise, seed: int) -> list[SimulatedTest]:
        """Test one pad at the paper's rates."""
        programs = {f"{rate:g}": self.program(rate) for rate in PAPER_RATES}
        return record_study({"pad": pad}, programs, noise, seed, ROWS)


@dataclass(frozen=True, eq=False)
class Study:
    """What is hidden, and what was measured.

    item: place in the plan, with the kind and the hidden effects' names; effects: the same with
    their parameters; sizes: asked for, over the peak force; fitted: kind of noise to be fitted;
    pad: the tests as if they had been read from a file.
    """

    item: Item
    constants: Constants
    effects: tuple[Effect, ...]
    sizes: tuple[float, ...]
    noise: Noise
    fitted: str
    tests: Tests
    pad: Pad

    def forces(self, effects: Sequence[Effect]) -> list[np.ndarray]:
        """True force (N) at every test's samples (n,), with some effects in place of the hidden."""
        hidden = HiddenPad(self.constants, tuple(effects))
        found = self.tests.run(hidden, NOISES["none"], 0)
        return [test.record.true_force for test in found]


def make_study(plan: Plan, index: int) -> Study:
    """Simulate the study at one place of the plan; it depends on the plan's seed and index only."""
    item = plan.item(index)
    rng = np.random.default_rng([plan.seed, index, *plan.noise.encode()])
    constants = draw_constants(rng)
    noise = _noise(plan.noise, rng)
    retracted = rng.choice(PAPER_RATES, RETRACTIONS, replace=False)
    tests = Tests(tuple(map(float, retracted)) if item.protocol == "mixed" else ())
    sizes = tuple(_spread(rng, *SIZES[item.kind]) for _ in item.names)
    peak = float(elastic_force(constants, np.array([DEPTH]))[0])
    effects = tuple(
        draw_effect(
            name, rng, peak, DEPTH, max(PAPER_RATES), size, constants=constants,
            protocol=tests.program,
        )
        for name, size in zip(item.names, sizes, strict=True)
    )  # fmt: skip
    found = tests.run(HiddenPad(constants, effects), noise, int(rng.integers(2**32)))
    pad = measured(found, f"study {index}")
    return Study(item, constants, effects, sizes, noise, plan.noise, tests, pad)


def measured(tests: Sequence[SimulatedTest], name: str) -> Pad:
    """Simulated tests of one pad as if they had been read from a file."""
    found = tuple(
        Test(t.name, name, t.record.time, t.record.displacement, t.record.force, start_s=t.start_s)
        for t in tests
    )
    return Pad(name, found, PAD)


def true_values(constants: Constants) -> dict[str, float]:
    """The pad's constants by the names that a fit gives them."""
    values = {"m": constants.m, "b": constants.b}
    values |= {f"c[{k}]": c for k, c in enumerate(constants.c)}
    return values | {f"v[{k}]": v for k, v in enumerate(constants.v, start=1)}


def true_noise(noise: Noise, fitted: str) -> dict[str, float]:
    """The noise's constants by the names that a fit of this kind of noise gives them."""
    values = {"noise.white": noise.white}
    if fitted == "correlated":
        values |= {"noise.ou": noise.correlated, "noise.tau": noise.correlation_time}
    return values


def _noise(kind: str, rng: np.random.Generator) -> Noise:
    usual = NOISES[kind]
    low, high = 1.0 / NOISE_FACTOR, NOISE_FACTOR
    white, correlated = (_spread(rng, low, high) for _ in range(2))
    return replace(
        usual,
        white=usual.white * white,
        correlated=usual.correlated * correlated,
        correlation_time=_spread(rng, *NOISE_TIME),
    )


def _spread(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform between two bounds."""
    return float(np.exp(rng.uniform(log(low), log(high))))
