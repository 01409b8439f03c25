"""Direct evidence: effects that show in the readings themselves, without any model."""

from __future__ import annotations

from qlvbayes.motion.evidence.levels import DirectEvidence
from qlvbayes.motion.evidence.lifting import adhesion_seen, friction_seen
from qlvbayes.motion.evidence.loading import contact_of, contact_seen, repeated_seen
from qlvbayes.motion.evidence.starting import inertia_seen, ringing_seen
from qlvbayes.motion.experiment import Experiment

__all__ = ["DirectEvidence", "contact_of", "direct_evidence"]


def direct_evidence(experiment: Experiment, bonded: bool) -> tuple[DirectEvidence, ...]:
    """Return what the readings show without a model, those beyond doubt first.

    bonded: whether the specimen is fixed to the platen, which then may pull.
    """
    pulls = () if bonded or experiment.units.dimensionless else adhesion_seen(experiment)
    seen = (inertia_seen, friction_seen, ringing_seen, contact_seen, repeated_seen)
    every = (*pulls, *(one for look in seen for one in look(experiment)))
    return tuple(sorted(every, key=lambda one: not one.beyond_doubt))
