"""Direct evidence: effects that show in the readings themselves, without any model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from qlvbayes.io.contact import FirstContact, first_rises, most_slide
from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.levels import (
    AGREE,
    CLEAR,
    DirectEvidence,
    Levels,
    Place,
    off_their_mean,
    pooled,
    shown,
)
from qlvbayes.motion.evidence.lifting import adhesion_seen, friction_seen
from qlvbayes.motion.evidence.starting import inertia_seen, lag_seen, ringing_seen
from qlvbayes.motion.experiment import Experiment

__all__ = ["DirectEvidence", "contacts_of", "direct_evidence", "with_mass"]

_AT_ZERO = 0.01  # of the depth, within which the platen has not left the file's zero


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


def contacts_of(experiment: Experiment) -> list[FirstContact | None]:
    """Return where the force of each test begins to rise; None if no approach shows it."""
    found: list[tuple[FirstContact | None, FirstContact | None]] = []
    for trial in experiment.trials:
        first, contact, later = trial.first_ramp or trial.phases[0], None, None
        if not experiment.units.dimensionless and first.control != Control.FORCE:
            way, force = trial.test.displacement, trial.test.force
            at_zero = abs(float(way[0])) <= _AT_ZERO * experiment.depth
            contact, later = first_rises(way, force, at_zero=at_zero)
        found.append((contact if contact is not None and contact.is_finite else None, later))
    slides = most_slide([later for _, later in found])
    return [later if slides and later else first for first, later in found]


def contact_seen(
    experiment: Experiment, contacts: Sequence[FirstContact | None]
) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force that begins before or after the file's zero.

    A soft beginning looks like a late contact, which is therefore not beyond doubt.
    """
    places = []
    for trial, contact in zip(experiment.trials, contacts, strict=True):
        begun = float(trial.test.displacement[0]) > _AT_ZERO * experiment.depth
        if contact is not None and not begun and contact.sd > 0.0:
            places.append(Place(float(contact.position), float(contact.sd), trial, "ramp"))
    if len(places) < 2:
        return ()
    size = value, sd = pooled(places)
    if abs(value) < CLEAR * sd:
        return ()
    unit, early = experiment.units.displacement, value < 0.0
    where = "before the file's zero" if early else "after the file's zero, where a soft beginning"
    return shown(
        "contact_offset", "depth at which the force begins", places, size, unit,
        f"the force begins at {plain(value)} +- {plain(sd, 2)} {unit}, {where}"
        + ("" if early else " looks alike"),
        sure=early and off_their_mean(places, size) < AGREE,
    )  # fmt: skip
