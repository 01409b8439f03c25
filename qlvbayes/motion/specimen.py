"""Effects of a pad's tests on each other and on a model's assumptions: carryover, pulls."""

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


@dataclass(frozen=True)
class Carryover:
    """The part of a test's force that earlier tests cause."""

    test: str
    before: str  # the test just before it
    pause: float  # seconds between them
    size: float  # largest change of its force (N) against a beginning at rest
    share: float  # that over the largest force of the test before


def carryovers(
    experiment: Experiment,
    trials: Sequence[Trial],
    record: Record,
    predict: Callable[[Record], np.ndarray],
) -> list[Carryover]:
    """Return the carryover of each of ``trials``; none where all began at rest."""
    if record.motion.ago is None or experiment.rested:
        return []
    from qlvbayes.motion.record import forgetting  # loads JAX, which a first look does not need

    change = np.abs(predict(record) - predict(forgetting(record)))
    sizes = np.max(np.where(np.asarray(record.blocks.real), change, 0.0), axis=1)
    every = [trial.whole for trial in experiment.trials]
    found = []
    for trial, size in zip(trials, sizes.tolist(), strict=True):
        for last in remembered_tests(every.index(trial.whole), every, experiment.longest)[:1]:
            before = every[last]
            between = pause(before, trial.whole) or 0.0
            peak = float(np.max(np.abs(experiment.trials[last].test.force)))
            found.append(Carryover(trial.name, before.name, between, size, size / peak))
    return found


def carryover_notices(
    experiment: Experiment,
    trials: Sequence[Trial],
    record: Record,
    predict: Callable[[Record], np.ndarray],
) -> tuple[str, ...]:
    """Return a sentence on the largest carryover that can be seen, one on clocks that overlap."""
    every = carryovers(experiment, trials, record, predict)
    seen = [one for one in every if one.size > _SEEN * experiment.floor.total]
    said = []
    if seen:
        most = max(seen, key=lambda one: one.share)
        others = f"; {len(seen) - 1} more tests began so, with less" if len(seen) > 1 else ""
        said.append(
            f"pad {experiment.pad}: test {most.test} began {most.pause:.3g} s after {most.before} "
            f"with {100.0 * most.share:.2g} % of the largest force of {most.before} still "
            f"relaxing, which the model takes into account{others}"
        )
    tests = sorted((t.whole for t in experiment.trials), key=lambda test: test.start_s)
    early = [
        f"pad {experiment.pad}: test {after.name} begins, by its start_s, before {before.name} has "
        "ended: no carryover from one to the other is modelled"
        for before, after in pairwise(tests)
        if (pause(before, after) or 0.0) < -ROUNDED
    ]
    return (*said, *([] if experiment.rested else early[:1]))


def pull_notices(
    experiment: Experiment,
    *,
    bonded: bool,
    effects: tuple[str, ...] = (),
    shown: Sequence[DirectEvidence] | None = None,
) -> tuple[str, ...]:
    """Return one line if a pad pulls that neither is bonded nor has adhesion in its model.

    It pulls where its force is below zero by more than 5 % of the peak and 6 noise floors. A mass
    that is moved and a guide that rubs make the force negative, too: where the readings show one
    beyond doubt, and no adhesion, there is no line. ``shown`` is what they show, if known.
    """
    trial = min(experiment.trials, key=lambda one: float(np.min(one.test.force)))
    lowest, peak = int(np.argmin(trial.test.force)), experiment.peak
    force = float(trial.test.force[lowest])
    clear = force < -max(_CLEAR * peak, _BEYOND * experiment.floor.total)
    if bonded or "adhesion" in effects or not clear:
        return ()
    shown = direct_evidence(experiment, bonded) if shown is None else shown
    sure = {one.effect for one in shown if one.beyond_doubt}
    if sure & {"inertia", "friction"} and "adhesion" not in sure:
        return ()
    return (
        f"pad {experiment.pad}: the measured force falls to {force:.3g} {experiment.units.force} "
        f"at {trial.test.time[lowest]:.4g} s of test {trial.name} "
        f"({plain(-100.0 * force / peak, 2)} % of the peak, pulling), "
        "but a loose specimen cannot pull: add --bonded if it is glued to the platen, "
        "--add adhesion if it sticks",
    )
