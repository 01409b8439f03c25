"""Where the force of each test begins to rise, and the evidence that it is not the file's zero."""

from __future__ import annotations

from collections.abc import Sequence

from qlvbayes.io.contact import FirstContact, first_rises, most_slide
from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.levels import (
    AGREE,
    CLEAR,
    DirectEvidence,
    Place,
    off_their_mean,
    pooled,
    shown,
)
from qlvbayes.motion.experiment import Experiment

_AT_ZERO = 0.01  # of the depth, within which the platen has not left the file's zero


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
