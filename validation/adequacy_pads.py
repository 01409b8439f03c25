"""Empty pads under one kind of noise: simulated, fitted with the right model, tested."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.signal import butter, lfilter

from qlvbayes import Choices, Pad, Test
from qlvbayes.diagnosis.checks.structure import adequacy
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.fitting.optimum import find_start
from qlvbayes.fitting.prediction import predict
from qlvbayes.fitting.residuals import CheckResult, check
from qlvbayes.inference.density import Point
from qlvbayes.inference.modes import find_mode
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.motion.record import Record
from qlvbayes.simulate import Noise, SimulatedTest, draw_constants, simulate_study, thin

RATES = (1.0, 20.0, 100.0)
ROWS = 500
PADS = 4  # sets of constants that are simulated; each gets fresh noise many times,
NOISELESS_PADS = 300  # or, without noise, only its own
_NO_NOISE = Noise(white=0.0, correlated=0.0)

Errors = Callable[[np.ndarray, np.ndarray, np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Kind:
    """A kind of noise: in words, and the force read (n,) of times (s), true force (N), stream.

    jitter: sd of the clock (s); dwells: False cuts the holds off.
    """

    words: str
    read: Errors
    jitter: float = 0.0
    dwells: bool = True
    noisy: bool = True

    @property
    def pads(self) -> int:
        """Sets of constants."""
        return PADS if self.noisy else NOISELESS_PADS


def _plus(noise: Noise) -> Errors:
    return lambda t, force, rng: force + noise.draw(t, rng)


def _low_passed(t: np.ndarray, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    # four times as fast as the readings: an amplifier's filter is analogue
    b, a = butter(2, 10.0, fs=4.0 / float(np.median(np.diff(t))))
    errors = lfilter(b, a, rng.standard_normal(4 * t.size + 8000))[8000::4]
    return force + 0.008 * errors / errors.std()


def _growing(t: np.ndarray, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return force + (0.003 + 0.01 * force) * rng.standard_normal(t.size)


def _digitised(t: np.ndarray, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.round((force + 0.004 * rng.standard_normal(t.size)) / 0.01) * 0.01


KINDS = {
    "a": Kind("correlated, without a white part", _plus(Noise(0.0, 0.006, 1.0))),
    "b": Kind("white, low-passed at 10 Hz by a second-order filter", _low_passed),
    "c": Kind("white of 4 mN, digitised in steps of 10 mN", _digitised),
    "d": Kind("growing with the force", _growing),
    "e": Kind(
        "correlated, with a clock that jitters by 20 us", _plus(Noise(0.0, 0.006, 0.2)), 2e-5
    ),
    "f": Kind("correlated over a quarter of a hold", _plus(Noise(0.006, 0.008, 7.5))),
    "g": Kind("white and correlated, without any hold", _plus(Noise()), dwells=False),
    "h": Kind("none", _plus(_NO_NOISE), noisy=False),
}


class Bench:
    """Compiled functions and true forces that all pads of a kind share."""

    def __init__(self, kind: str, seed: int) -> None:
        self.kind, self.letter, self.seed = KINDS[kind], kind, seed
        self._tops: dict[int, np.ndarray] = {}
        self.true = cache(self._true)

    def run(self, index: int) -> dict:
        """Pad ``index``: p-values of adequacy, and of the cells of ``check``."""
        rng = np.random.default_rng([self.seed, index, ord(self.letter)])
        begun = time.perf_counter()
        pad = index % self.kind.pads
        experiment = prepare(self._measured(pad, rng), all_tests=True)
        record, mode = self._mode(experiment, pad)
        found = adequacy(experiment, record, mode, DiagnosisSettings().cells)
        cells = self._check(experiment, rng)
        return {
            "index": index,
            "p": found.p_value,
            "testable": found.testable,
            "cells": [cell.p_value for cell in cells.cells],
            "alarm": any(cell.fails for cell in cells.cells),
            "seconds": time.perf_counter() - begun,
        }

    def _true(self, pad: int) -> list[SimulatedTest]:
        constants = draw_constants(np.random.default_rng([self.seed, pad]))
        return simulate_study({"pad": constants}, RATES, _NO_NOISE, 0)

    def _measured(self, pad: int, rng: np.random.Generator) -> Pad:
        return Pad("pad", tuple(self._test(test, rng) for test in self.true(pad)), PAD)

    def _test(self, test: SimulatedTest, rng: np.random.Generator) -> Test:
        record = test.record
        force = self.kind.read(record.time, record.true_force, rng)
        kept = thin(record.time, record.displacement, ROWS)
        if not self.kind.dwells:
            kept = kept[record.time[kept] <= _first_turn(record.time, record.displacement)]
        stamp = record.time[kept]
        if self.kind.jitter:
            stamp = np.sort(stamp + self.kind.jitter * rng.standard_normal(stamp.size))
        return Test(
            test.name, "pad", stamp, record.displacement[kept], force[kept], start_s=test.start_s
        )

    def _mode(self, experiment: Experiment, pad: int) -> tuple[Record, Point]:
        """The right model at its mode under the floor, from where the last noise had it."""
        search = build_search(experiment, kinds=())
        if pad not in self._tops:
            search.evaluate(search.baseline)
            self._tops[pad] = search.modes[search.baseline][0].point.theta
        mode = find_mode(search.density, search.baseline, self._tops[pad])
        assert mode is not None
        return search.density.space.record, mode.point

    def _check(self, experiment: Experiment, rng: np.random.Generator) -> CheckResult:
        """Cells of ``check``, from normal draws about the mode of a fit."""
        start = find_start(experiment, Choices(), experiment.trials)
        theta = start.posterior.parameters.within(start.normal.draw(400, rng))
        draws = start.posterior.drawn_constants(theta, rng)
        constants = dict(zip(start.posterior.names, draws.T, strict=True))
        predictions = predict(experiment, Choices(), constants, experiment.trials)
        return check("pad", experiment.floor.total, predictions)


def _first_turn(time: np.ndarray, displacement: np.ndarray) -> float:
    """Time at which the ramp ends."""
    return float(time[np.argmax(displacement >= displacement.max())])
