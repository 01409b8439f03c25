"""Tensile forces: a force clearly below zero, which a loose specimen cannot exert."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.motion.evidence import direct_evidence
from qlvbayes.motion.experiment import Experiment

_CLEAR = 0.05  # of the peak force below zero; less may be a tare that is off
_BEYOND = 6.0  # times the noise floor


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
    experiment: Experiment, *, bonded: bool, effects: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """Return one line if a pad pulls that neither is bonded nor has adhesion in its model.

    A mass that is moved, or a guide that rubs, also makes the force negative: where the readings
    show one of these beyond doubt, and no adhesion, there is no line.
    """
    pull = None if bonded or "adhesion" in effects else pull_of(experiment)
    if pull is None:
        return ()
    shown = direct_evidence(experiment, bonded)
    other = any(one.beyond_doubt and one.effect in ("inertia", "friction") for one in shown)
    if other and all(one.effect != "adhesion" for one in shown):
        return ()
    unit = experiment.units.force
    return (
        f"pad {experiment.pad}: the measured force falls to {pull.force:.3g} {unit} at "
        f"{pull.time:.4g} s of test {pull.test} ({100.0 * pull.share:.2g} % of the peak, pulling), "
        "but a loose specimen cannot pull: add --bonded if it is glued to the platen, "
        "--add adhesion if it sticks",
    )
