"""Direct evidence: effects that show in the readings themselves, without any model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from qlvbayes.io.contact import FirstContact
from qlvbayes.motion.evidence.levels import DirectEvidence, Levels
from qlvbayes.motion.evidence.lifting import adhesion_seen, friction_seen
from qlvbayes.motion.evidence.starting import inertia_seen, lag_seen, ringing_seen
from qlvbayes.motion.evidence.touching import contact_seen, contacts_of
from qlvbayes.motion.experiment import Experiment

__all__ = ["DirectEvidence", "direct_evidence", "with_mass"]


def direct_evidence(
    experiment: Experiment, bonded: bool, contacts: Sequence[FirstContact | None] | None = None
) -> tuple[DirectEvidence, ...]:
    """Return what the readings show without a model, those beyond doubt first.

    bonded: whether the specimen is fixed to the platen, which then may pull; contacts: those of the
    tests, where they are known already.
    """
    tests = _tests_of(experiment)
    every = (
        *(() if bonded or experiment.units.dimensionless else adhesion_seen(tests)),
        *inertia_seen(tests),
        *friction_seen(tests),
        *ringing_seen(tests),
        *lag_seen(tests),
        *contact_seen(experiment, contacts_of(experiment) if contacts is None else contacts),
    )
    return tuple(sorted(every, key=lambda one: not one.beyond_doubt))


def with_mass(experiment: Experiment) -> Experiment:
    """Return the experiment with the mass that its starts and stops show beyond doubt, if any.

    It is the impulse of the force over the change of speed, which needs no acceleration: where
    readings do not resolve that, no fit can find the mass.
    """
    seen = inertia_seen(_tests_of(experiment))
    shown = next((one for one in seen if one.beyond_doubt), None)
    return replace(experiment, mass=None if shown is None else (shown.value, shown.sd))


def _tests_of(experiment: Experiment) -> list[Levels]:
    return [Levels(experiment, trial) for trial in experiment.trials]
