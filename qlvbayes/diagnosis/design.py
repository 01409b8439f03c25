r"""Which further test would tell two explanations apart: expected evidence of practicable ones.

If model A is right, its rival B, left free within what the present tests allow, is missed by the
new test's forces by

.. math:: 2 \ln BF \approx d^T (\Sigma + J_B C_B J_B^T)^{-1} d, \qquad d = f_A - f_B

with the noise covariance Sigma, and B's sensitivities J and posterior covariance C.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.result import Suggestion
from qlvbayes.diagnosis.search import Weighed
from qlvbayes.experiment import Experiment
from qlvbayes.inference.density import Density
from qlvbayes.inference.whitening import Whitener
from qlvbayes.kinematics.programme import Stroke, planned
from qlvbayes.records.batching import batch
from qlvbayes.records.record import Record
from qlvbayes.records.reduction import planned_record
from qlvbayes.wording import plain

Array = NDArray[np.float64]

_HOLD = 30.0  # s
_PER_STRETCH = 60  # samples between two kinks, evenly spaced in the logarithm of time
_LATER = 3600.0  # s


@dataclass(frozen=True)
class _Candidate:
    words: str
    strokes: tuple[Stroke, ...]
    delay: float = 60.0  # s after the last test


def suggest(experiment: Experiment, density: Density, found: list[Weighed]) -> list[Suggestion]:
    """Practicable tests, best first; the evidence is that between the two nearest explanations."""
    plans = _candidates(experiment)
    record = batch([_record(experiment, plan) for plan in plans])
    whitener = Whitener.of(experiment.floor, record.blocks, experiment.scales.force)
    future = Density(replace(density.space, record=record), whitener, density.discrepancy)
    worth = np.full(len(plans), np.inf)
    for a in found:
        for b in found:
            if a is not b:
                worth = np.minimum(worth, _evidence(future, a, b))
    order = np.argsort(-worth)
    return [Suggestion(plans[k].words, float(worth[k])) for k in order]


def _candidates(experiment: Experiment) -> list[_Candidate]:
    """Tests that the rig of these tests can do."""
    scales, units = experiment.scales, experiment.units
    depth, top = scales.depth, scales.speed
    slow = min(trial.rate for trial in experiment.trials)
    hold = min(_HOLD, scales.longest)
    steps = tuple(Stroke(depth * k / 4, top, hold / 2) for k in (1, 2, 3, 4, 3, 2, 1, 0))
    cycles = tuple(Stroke(place, top / 10, 0.5) for place in (depth, 0.0) * 3)

    def at(speed: float) -> str:
        return f"{plain(speed)} {units.speed}"

    return [
        _Candidate(
            f"press at {at(top)}, hold, retract fully to zero at the same speed",
            (Stroke(depth, top, hold), Stroke(0.0, top, hold)),
        ),
        _Candidate(
            f"press and retract fully at {at(slow)}, a hold between",
            (Stroke(depth, slow, hold), Stroke(0.0, slow, hold)),
        ),
        _Candidate(
            f"a ramp and hold ten times slower, {at(slow / 10)}", (Stroke(depth, slow / 10, hold),)
        ),
        _Candidate(
            f"a ramp to half the depth at {at(top)}, then a hold", (Stroke(depth / 2, top, hold),)
        ),
        _Candidate(f"a staircase of four steps up and down at {at(top)}", steps),
        _Candidate(f"three cycles between zero and full depth at {at(top / 10)}", cycles),
        _Candidate(
            f"a hold ten times longer after a ramp at {at(top)}", (Stroke(depth, top, 10.0 * hold),)
        ),
        _Candidate(
            "the fastest test once more, an hour later", (Stroke(depth, top, hold),), _LATER
        ),
    ]


def _record(experiment: Experiment, plan: _Candidate) -> Record:
    scales = experiment.scales
    acceleration = scales.acceleration or scales.speed / (10.0 * scales.shortest)
    trajectory = planned(plan.strokes, acceleration)
    time = _times(trajectory.knots, scales.shortest)
    return planned_record(trajectory, time, start=scales.clock + plan.delay)


def _times(knots: Array, shortest: float) -> Array:
    """Sampling times, dense after each kink."""
    stretches = [
        a + np.geomspace(min(shortest, 0.1 * (b - a)), b - a, _PER_STRETCH)
        for a, b in pairwise(knots)
    ]
    return np.unique(np.concatenate([[0.0], *stretches]))


def _evidence(future: Density, a: Weighed, b: Weighed) -> Array:
    """Expected 2 ln BF (T,) of a, if it is right, against b, by each test alone."""
    of_a = future.space.forces(a.hypothesis, a.point.constants[None])[0]
    of_b, slopes = future.predicted(b.hypothesis, b.point.theta)
    white = future.whitener(np.concatenate([(of_a - of_b)[None], slopes]))
    curvature = np.linalg.inv(b.evidence.covariance)
    worth = []
    for test in range(len(of_a)):
        own = white[:, future.whitener.tests == test]
        d, J = own[0], own[1:]
        taken = J @ d
        left = d @ d - taken @ np.linalg.solve(curvature + J @ J.T, taken)
        worth.append(max(float(left), 0.0))
    return np.array(worth)
