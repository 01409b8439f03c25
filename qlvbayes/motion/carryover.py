"""Carryover: how much of one test's force was still relaxing when the next began."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes.laws.motion import Motion
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.past import ROUNDED, pause, remembered_tests
from qlvbayes.motion.record import Record

_SEEN = 0.25  # of the noise at rest: the mean of sixteen independent samples shows as much

Predict = Callable[[Record], np.ndarray]


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
    if record.motion.ago is None:
        return ()
    change = np.abs(predict(record) - predict(_forgetting(record)))
    sizes = np.max(np.where(np.asarray(record.blocks.real), change, 0.0), axis=1)
    every = [trial.whole for trial in experiment.trials]
    carryovers = []
    for trial, size in zip(trials, sizes, strict=True):
        remembered = remembered_tests(every.index(trial.whole), every, experiment.longest)
        if not remembered or experiment.rested:
            continue
        before = every[remembered[0]]
        between = pause(before, trial.whole) or 0.0
        peak = float(np.max(np.abs(experiment.trials[remembered[0]].test.force)))
        carryovers.append(Carryover(trial.name, before.name, between, float(size), size / peak))
    return tuple(carryovers)


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
        f"{_percent(most.share)} of the largest force of {most.before} still relaxing, which the "
        f"model takes into account{others}",
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


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def _forgetting(record: Record) -> Record:
    """Return the record, of the same shape, with every test begun at rest."""

    def alone(motion: Motion) -> Motion:
        return replace(motion.alone, ago=motion.ago)

    return Record(
        jax.vmap(alone)(jax.tree.map(jnp.asarray, record.motion)), record.nodes, record.blocks
    )
