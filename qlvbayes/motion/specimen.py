"""Effects of a pad's tests on each other and on the model's assumptions: carryover, and pulls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence import DirectEvidence, direct_evidence
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.past import ROUNDED, pause, remembered_tests

if TYPE_CHECKING:
    from qlvbayes.motion.record import Record

_SEEN = 0.25  # of the noise at rest: the mean of sixteen independent samples shows as much
_CLEAR = 0.05  # of the peak force below zero; less may be a tare that is off
_BEYOND = 6.0  # times the noise floor

Predict = Callable[["Record"], np.ndarray]


@dataclass(frozen=True)
class Carryover:
    """The part of a test's force that earlier tests cause."""

    test: str
    before: str  # the test just before it
    pause: float  # seconds between them
    size: float  # largest change of its force (N) against a beginning at rest
    share: float  # that over the largest force of the test before


def carryovers(
    experiment: Experiment, trials: Sequence[Trial], record: Record, predict: Predict
) -> tuple[Carryover, ...]:
    """Return the carryover of each of ``trials``; none where all began at rest."""
    if record.motion.ago is None or experiment.rested:
        return ()
    from qlvbayes.motion.record import forgetting  # loads JAX, which a first look does not need

    change = np.abs(predict(record) - predict(forgetting(record)))
    sizes = np.max(np.where(np.asarray(record.blocks.real), change, 0.0), axis=1)
    every = [trial.whole for trial in experiment.trials]
    found = []
    for trial, size in zip(trials, sizes.tolist(), strict=True):
        remembered = remembered_tests(every.index(trial.whole), every, experiment.longest)
        if remembered:
            before = every[remembered[0]]
            between = pause(before, trial.whole) or 0.0
            peak = float(np.max(np.abs(experiment.trials[remembered[0]].test.force)))
            found.append(Carryover(trial.name, before.name, between, size, size / peak))
    return tuple(found)


def carryover_notices(
    experiment: Experiment, trials: Sequence[Trial], record: Record, predict: Predict
) -> tuple[str, ...]:
    """Return one sentence on the test with the largest carryover, where that can be seen."""
    every = carryovers(experiment, trials, record, predict)
    seen = [one for one in every if one.size > _SEEN * experiment.floor.total]
    if not seen:
        return ()
    most = max(seen, key=lambda one: one.share)
    others = f"; {len(seen) - 1} more tests began so, with less" if len(seen) > 1 else ""
    return (
        f"pad {experiment.pad}: test {most.test} began {most.pause:.3g} s after {most.before} with "
        f"{100.0 * most.share:.2g} % of the largest force of {most.before} still relaxing, which "
        f"the model takes into account{others}",
    )


def clock_notices(experiment: Experiment) -> tuple[str, ...]:
    """Return one sentence on a test that began, by the declared clock, before another ended."""
    tests = sorted((t.whole for t in experiment.trials), key=lambda test: test.start_s)
    early = [
        f"pad {experiment.pad}: test {after.name} begins, by its start_s, before {before.name} has "
        "ended: no carryover from one to the other is modelled"
        for before, after in pairwise(tests)
        if (pause(before, after) or 0.0) < -ROUNDED
    ]
    return tuple(early[:1])


@dataclass(frozen=True)
class TensileForce:
    """The lowest force (N, below zero), its test, its time (s), and its share of the peak force."""

    test: str
    time: float
    force: float
    share: float


def pull_of(experiment: Experiment) -> TensileForce | None:
    """Return the strongest pull, if below zero by more than 5 % of the peak and 6 noise floors."""
    trial = min(experiment.trials, key=lambda one: float(np.min(one.test.force)))
    lowest = int(np.argmin(trial.test.force))
    force, peak = float(trial.test.force[lowest]), experiment.peak
    if force >= -max(_CLEAR * peak, _BEYOND * experiment.floor.total):
        return None
    return TensileForce(trial.name, float(trial.test.time[lowest]), force, -force / peak)


def pull_notices(
    experiment: Experiment,
    *,
    bonded: bool,
    effects: tuple[str, ...] = (),
    shown: Sequence[DirectEvidence] | None = None,
) -> tuple[str, ...]:
    """Return one line if a pad pulls that neither is bonded nor has adhesion in its model.

    A mass that is moved and a guide that rubs make the force negative, too: where the readings show
    one beyond doubt, and no adhesion, there is no line. ``shown`` is what they show, if known.
    """
    pull = None if bonded or "adhesion" in effects else pull_of(experiment)
    if pull is None:
        return ()
    shown = direct_evidence(experiment, bonded) if shown is None else shown
    sure = {one.effect for one in shown if one.beyond_doubt}
    if sure & {"inertia", "friction"} and "adhesion" not in sure:
        return ()
    unit, share = experiment.units.force, plain(100.0 * pull.share, 2)
    return (
        f"pad {experiment.pad}: the measured force falls to {pull.force:.3g} {unit} at "
        f"{pull.time:.4g} s of test {pull.test} ({share} % of the peak, pulling), "
        "but a loose specimen cannot pull: add --bonded if it is glued to the platen, "
        "--add adhesion if it sticks",
    )
