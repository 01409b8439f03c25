"""Direct evidence from first contacts: force before depth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.io.contact import FirstContact, first_rises, most_slide
from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.record import CLEAR, DirectEvidence, Place, names_of, pooled
from qlvbayes.motion.experiment import Experiment, Trial

_AT_ZERO = 0.01  # of the depth, within which the platen has not left the file's zero
_AGREE = 3.0  # errors, within which tests have one contact


def contacts_of(experiment: Experiment) -> list[FirstContact | None]:
    """Return where the force of each test begins to rise; None if no approach shows it."""
    found = [_contact_of(experiment, trial) for trial in experiment.trials]
    slides = most_slide([later for _, later in found])
    return [later if slides and later else first for first, later in found]


def _contact_of(
    experiment: Experiment, trial: Trial
) -> tuple[FirstContact | None, FirstContact | None]:
    """Return the first rise of a test's force, and the one after sliding if that may be it."""
    first = next((phase for phase in trial.phases if phase.kind == "ramp"), trial.phases[0])
    if experiment.units.dimensionless or first.control == Control.FORCE:
        return None, None
    way, force = trial.test.displacement, trial.test.force
    at_zero = abs(float(way[0])) <= _AT_ZERO * experiment.depth
    contact, later = first_rises(way, force, at_zero=at_zero)
    return contact if contact is not None and contact.is_finite else None, later


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
            places.append(Place(trial, "ramp", float(contact.position), float(contact.sd)))
    if len(places) < 2:
        return ()
    value, sd = pooled(places)
    if abs(value) < CLEAR * sd:
        return ()
    off = [abs(one.value - value) / np.hypot(one.sd, sd) for one in places]
    tests, phases = names_of(places)
    unit, early = experiment.units.displacement, value < 0.0
    return (
        DirectEvidence(
            "contact_offset", "depth at which the force begins", value, sd, unit, tests, phases,
            f"the force begins at {plain(value)} +- {plain(sd, 2)} {unit}, "
            + ("before" if early else "after")
            + " the file's zero"
            + ("" if early else ", where a soft beginning looks alike"),
            early and max(off) < _AGREE,
        ),
    )  # fmt: skip
