"""Simulated tests of a pad with one relaxation mode, and the priors of its constants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from qlvbayes.effects.effect import AbstractEffect, Protocol
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space, in_natural_amplitude
from qlvbayes.io.data import Test
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.model.noise import AbstractNoise, Correlated
from qlvbayes.motion.phases import find_phases
from qlvbayes.motion.record import Record, batch
from qlvbayes.motion.reduction import reduce_test
from qlvbayes.motion.trajectory import Stroke, Trajectory, planned
from qlvbayes.priors import Dirichlet, Ordered

SHOWING = Protocol(unloads=True, returns=True, tests=2, bonded=False, curved=True)
"""Protocol of the simulated tests."""

_DEPTH, _HOLD, _PAUSE = 1.6, 10.0, 60.0  # mm, s, s
_ACCELERATION = 100.0  # mm/s2
_SLOW, _FAST = 1.0, 10.0  # mm/s
_PEAK, _STIFFNESS = 3.0, 4.0  # N, N/mm
_WHITE, _OU, _TAU = 3e-3, 1e-3, 1.0  # N, N, s
_MOVING, _RESTING = 5, 10  # samples of a stretch of constant acceleration, and of a hold
_SOONEST = 0.02  # s from the beginning of a hold to its first sample


@dataclass(frozen=True, eq=False)
class RecoveryBench:
    """Tests whose record holds no force yet, their scales, and the priors of law and noise."""

    record: Record
    scales: Scales
    elastic: AbstractElastic
    relaxation: AbstractRelaxation
    noise: AbstractNoise

    def space(self, effects: Sequence[AbstractEffect], *, bonded: bool = False) -> Space:
        """Return the hypotheses with some effects; the noise has no influence."""
        return Space(
            self.record,
            {self.elastic.name: self.elastic},
            {self.relaxation.name: self.relaxation},
            {one.name: in_natural_amplitude(one) for one in effects},
            Correlated(_WHITE, _OU, _TAU),
            bonded=bonded,
        )

    def hypothesis(self, effect: str) -> Hypothesis:
        """Return the law with one effect."""
        return Hypothesis(self.elastic.name, self.relaxation.name, frozenset((effect,)))


@cache
def bench() -> RecoveryBench:
    """Return a test at 1 mm/s back to half depth, and one at 10 mm/s with full retraction.

    Pads differ from one like the paper's pad B by a factor 1.2 in m and b and 1.5 in the rate (one
    sd). The package's own priors are for pads of which nothing is known; a draw from them may weigh
    tons.
    """
    paths = [_path(_SLOW, 0.5 * _DEPTH), _path(_FAST, 0.0)]
    second = float(paths[0].knots[-1]) + _PAUSE
    record = batch([_record(paths[0], 0.0), _record(paths[1], second)])
    scales = Scales(
        force=_PEAK,
        depth=_DEPTH,
        shortest=_SOONEST,
        longest=_HOLD,
        white=_WHITE,
        ou=_OU,
        tau=_TAU,
        speed=_FAST,
        acceleration=_ACCELERATION,
        clock=second + float(paths[1].knots[-1]),
        stiffness=_STIFFNESS,
    )
    elastic = Exponential(lognormal(0.34, 1.2), lognormal(1.165, 1.2))
    noise = Correlated(*(lognormal(size, 1.5) for size in (_WHITE, _OU, _TAU)))
    relaxation = Prony(Dirichlet([6.0, 14.0]), Ordered((lognormal(0.5, 1.5),)))
    return RecoveryBench(record, scales, elastic, relaxation, noise)


def _path(rate: float, back: float) -> Trajectory:
    return planned([Stroke(_DEPTH, rate, _HOLD), Stroke(back, rate, _HOLD)], _ACCELERATION)


def _record(path: Trajectory, start: float) -> Record:
    time = _times(path)
    test = Test("", "", time, path.displacement(time), np.zeros_like(time))
    return reduce_test(test, path, find_phases(path), start=start, samples=np.arange(time.size))


def _times(path: Trajectory) -> np.ndarray:
    """Return few samples, each a block: even ones in motion, geometrically spaced in holds."""
    moving = (np.arange(_MOVING) + 0.5) / _MOVING
    resting = np.geomspace(_SOONEST / _HOLD, 1.0, _RESTING)
    times = [np.zeros(1)]
    for start, stop in zip(path.knots[:-1], path.knots[1:], strict=True):
        at_rest = path.velocity(np.array([0.5 * (start + stop)]))[0] == 0.0
        times.append(start + (stop - start) * (resting if at_rest else moving))
    return np.concatenate(times)
