"""Find the zero of displacement and force, from the contact in the file or in the pad's others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.answers import FILE, Answers, UnsureError
from qlvbayes.io.formats.contact import FirstContact, force_at_start
from qlvbayes.io.formats.loading import Loaded
from qlvbayes.io.formats.stage import APART, Approach, StageContact, stage_contacts
from qlvbayes.io.wording import plain

_NEAR = 0.01  # share of the travel before its start in which a stated contact may lie
_AGREES = 2.0  # standard errors within which the file's own zero is kept
_ENOUGH = 2  # files whose contacts have to agree for others to take theirs


@dataclass(frozen=True)
class Zero:
    """Zeros subtracted from displacement and force, and the displacement's standard error.

    ``position`` is the displacement, and ``sd`` is None where it was not measured. ``finding`` says
    how it was found; ``contact`` is where the file's own rise of the force shows it. ``stage``
    names the contact whose error all recordings of that name share.
    """

    position: float
    force: float
    finding: str
    sd: float | None = None
    contact: FirstContact | None = None
    stage: str = ""


def zeros(shown: Sequence[Loaded], answers: Answers) -> list[Zero | UnsureError]:
    """Return the zero of each recording, or the question that has to be asked for it."""
    results: list[Zero | UnsureError] = []
    before: dict[tuple[object, ...], Zero] = {}
    contacts = {stage: _contacts(shown, stage) for stage in {one.stage for one in shown}}
    for k, one in enumerate(shown):
        key = (one.file, *one.stage)
        zero = _zero(one, k, contacts[one.stage], before.get(key), answers)
        if isinstance(zero, Zero) and zero.contact is not None:
            before[key] = zero
        results.append(zero)
    return results


def _contacts(shown: Sequence[Loaded], stage: tuple[object, ...]) -> list[StageContact]:
    """Return the contacts on which recordings of a stage agree, that of the most first."""
    own = [
        (k, Approach(one.way, one.load, one.contact, one.speed))
        for k, one in enumerate(shown)
        if one.stage == stage and one.contact is not None and one.approached
    ]
    found = stage_contacts([approach for _, approach in own])
    return [replace(one, members=tuple(own[m][0] for m in one.members)) for one in found]


def _zero(
    one: Loaded,
    index: int,
    contacts: Sequence[StageContact],
    before: Zero | None,
    answers: Answers,
) -> Zero | UnsureError:
    if answers.contact == FILE:
        return Zero(
            0.0, 0.0, "contact at the file's own zero, as stated by the user", contact=one.contact
        )
    if answers.contact is not None:
        return _stated(one, float(answers.contact))
    if np.ptp(one.load) == 0.0:
        return Zero(0.0, 0.0, "contact at the file's own zero: the force never changes")
    if one.units.dimensionless:
        finding = "strain has the file's own zero: a fixed specimen has no contact"
        return Zero(0.0, 0.0, finding)
    own = next((stage for stage in contacts if index in stage.members), None)
    if own is not None and one.contact is not None:
        return _at_contact(one, one.contact, own, contacts[0])
    if contacts and _kept(contacts[0]) and one.begins_at_zero and one.begins_without_force:
        zero = _at_start(one)
        if isinstance(zero, Zero):
            return replace(zero, sd=contacts[0].sd, stage=_label(one, contacts[0]))
    agreed = _agreed(contacts)
    if agreed is not None and _may_take(one, agreed):
        return _from_others(one, agreed)
    if before is not None:
        finding = (
            f"contact at {one.written(before.position)} {one.units.displacement}, the zero of the "
            "file's test before: this one begins in contact"
        )
        return replace(before, force=0.0, finding=finding)
    zero = _at_start(one)
    if isinstance(zero, Zero) and agreed is not None:
        return replace(zero, finding=zero.finding + _doubt(one, agreed))
    return zero


def _stated(one: Loaded, written: float) -> Zero:
    """Return the zero that the user states, with the sign that it has in the file."""
    position, length = one.signs.way * written, one.units.displacement
    low, high = float(one.way.min()), float(one.way.max())
    before = (_NEAR if one.begins_without_force else 1.0) * (high - low)
    if not low - before <= position < high:
        raise InputError(
            f"--contact {written:.6g} lies outside the travel, {one.written(float(one.way[0]))} "
            f"{length} at the start and {one.written(high)} {length} at the deepest",
            file=one.file,
            remedy="state it in the unit of the tidy file and with the sign of the file",
        )
    finding = f"contact at {written:.6g} {length}, as stated by the user"
    return Zero(position, 0.0, finding, contact=one.contact)


def _kept(stage: StageContact) -> bool:
    """Return whether a contact agrees with the file's own zero."""
    return abs(stage.position) <= _AGREES * stage.sd


def _label(one: Loaded, stage: StageContact) -> str:
    return "0" if _kept(stage) else one.written(stage.position)


def _agreed(contacts: Sequence[StageContact]) -> StageContact | None:
    """Return the contact on which most files of a stage agree; None where they are too few."""
    counts = [len(stage.members) for stage in contacts]
    if not counts or counts[0] < max(_ENOUGH, sum(counts) / 2.0) or counts[0] in counts[1:]:
        return None
    return contacts[0]


def _may_take(one: Loaded, agreed: StageContact) -> bool:
    """Return whether a test begins beyond the others' contact and carries force there."""
    beyond = float(one.way[0]) > agreed.position - APART * agreed.sd
    return beyond and not one.begins_without_force


def _from_others(one: Loaded, agreed: StageContact) -> Zero:
    length, force = one.units.displacement, one.units.force
    start = one.signs.load * force_at_start(one.way, one.load)
    finding = (
        f"contact at {one.written(agreed.position)} +- {plain(agreed.sd, 2)} {length}, on which "
        f"the pad's {len(agreed.members)} other files agree: this one begins beyond it, at "
        f"{one.written(float(one.way[0]))} {length} with {plain(start)} {force}; taken off the "
        f"force: {plain(one.signs.load * agreed.force)} {force}, theirs at rest"
    )
    stage = _label(one, agreed)
    return Zero(agreed.position, agreed.force, finding, agreed.sd, stage=stage)


def _doubt(one: Loaded, others: StageContact) -> str:
    """Return the words on other files whose contact lies elsewhere, and the option that joins."""
    count, position = len(others.members), one.written(others.position)
    have = f"{count} other files have" if count > 1 else "other file has"
    return (
        f"; doubt: the pad's {have} it at {position} +- {plain(others.sd, 2)} "
        f"{one.units.displacement}: was the stage or the pad moved, or the zero set anew? If not, "
        f"--contact {position} gives all files one zero"
    )


def _at_contact(
    one: Loaded, contact: FirstContact, stage: StageContact, most: StageContact
) -> Zero:
    """Return the zero of a file at the contact of its stage; ``most`` is that of most files."""
    length, force = one.units.displacement, one.units.force
    offset = contact.force if abs(contact.force) > _AGREES * contact.force_sd else 0.0
    alone = f"{one.written(contact.position)} +- {plain(contact.sd, 2)} {length}"
    together = len(stage.members) > 1
    more = f", in {len(stage.members)} files of one stage (this one alone: {alone})" * together
    if offset:
        more += (
            f"; taken off the force: {plain(contact.force)} +- {plain(contact.force_sd, 1)} {force}"
            " before contact"
        )
    if stage is not most:
        more += _doubt(one, most)
    if together and stage.contradicts(contact):
        position = one.written(stage.position)
        more += (
            "; doubt: that of this one alone is off beyond the errors, as a film, drag or a lag "
            f"does in a quick test; --contact {position} states this zero for all files"
        )
    label = _label(one, stage)
    if _kept(stage):
        found = f"{plain(one.signs.way * stage.position, 4)} +- {plain(stage.sd, 2)} {length}"
        finding = f"contact {found} agrees with the file's zero, which is kept{more}"
        return Zero(0.0, offset, finding, stage.sd, contact, label)
    where = "" if together else ", where the force begins to rise"
    finding = (
        f"contact at {one.written(stage.position)} +- {plain(stage.sd, 2)} {length} of the "
        f"file{where}{more}; that is the new zero"
    )
    return Zero(stage.position, offset, finding, stage.sd, contact, label)


def _at_start(one: Loaded) -> Zero | UnsureError:
    """Return the first row as zero, if the force is none there: the test begins in contact."""
    length, force = one.units.displacement, one.units.force
    first, peak = one.force_at_first, float(np.abs(one.load).max())
    share = abs(first) / peak if peak > 0.0 else 1.0
    if not one.begins_without_force:
        return UnsureError(
            f"the test begins in contact, with {plain(one.signs.load * first)} {force} "
            f"({share:.1%} of the largest force): where the specimen is first touched is not in it",
            file=one.file,
            option="contact",
            question=f"displacement at first contact in {length}, before it is set to "
            f"zero, or '{FILE}' for its own zero",
            say="VALUE, or --contact file for the file's own zero",
        )
    position, near = float(one.way[0]), one.begins_at_zero
    where = "the file's own zero" if near else f"the first row, {one.written(position)} {length}"
    # the force of the first row over the mean stiffness bounds how far contact may lie above
    reach = abs(first) / peak * float(one.way[int(np.argmax(one.load))] - position)
    finding = (
        f"contact at {where}: there is no approach, and the first row has "
        f"{share:.2%} of the peak force (it may lie {plain(reach, 2)} {length} higher)"
    )
    return Zero(0.0 if near else position, 0.0, finding)
