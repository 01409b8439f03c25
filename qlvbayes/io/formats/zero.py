"""The zero of displacement and force: from the contact that a file shows, or that others show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qlvbayes.io.formats.answers import FILE, Answers, UnsureError
from qlvbayes.io.formats.contact import Contact, Signs, force_at_start, scatter
from qlvbayes.io.formats.format import Floats
from qlvbayes.io.units import UnitSystem

_REST = 0.01  # share of the peak force below which a test begins with none
_NEAR = 0.01  # share of the travel, within which a first row stands at the file's own zero
_STILL = 1e-3  # share of the travel, within which rows at the beginning are at one place
_AGREES = 2.0  # standard errors within which the file's own zero is kept
_APART = 3.0  # standard errors, from which on the contacts of two files are at two places
_ENOUGH = 2  # other files whose contacts agree, from which on a pad lies on one stage


@dataclass(frozen=True, eq=False)
class Shown:
    """What one recording shows: pressing is positive in ``way`` and ``load`` (n,).

    ``stage`` is alike for recordings whose displacement may have one zero: those of one pad and
    layout. ``contact`` is None where a strain has none to show.
    """

    file: Path
    stage: tuple[object, ...]
    units: UnitSystem
    way: Floats
    load: Floats
    signs: Signs
    contact: Contact | None

    @property
    def peak(self) -> float:
        """The largest force."""
        return float(self.load.max())

    @property
    def approached(self) -> bool:
        """Whether it moved before the force began to rise, or rests there without a force."""
        if self.contact is None:
            return False
        travelled = self.contact.place - float(self.way[0]) > _AGREES * self.contact.sd
        return travelled or abs(self.contact.force) <= _REST * self.peak

    def written(self, place: float) -> str:
        """A displacement with its sign in the file."""
        return f"{self.signs.way * place:.6g}"


@dataclass(frozen=True)
class Zero:
    """What is taken off displacement and force; ``sd`` of the former, where it was measured.

    ``told`` says how it was found; ``contact`` is where the file's own rise of the force shows it.
    """

    place: float
    force: float
    told: str
    sd: float | None = None
    contact: Contact | None = None


def zeros(shown: Sequence[Shown], answers: Answers) -> list[Zero | UnsureError]:
    """The zero of each recording, or what has to be asked for it; all of a stage together.

    A recording that begins in contact has the zero of the others on its stage, where two of them
    or more agree, else that of the file's recording before. Contacts that differ from those of all
    others are told.
    """
    found: list[Zero | UnsureError] = []
    before: dict[tuple[object, ...], Zero] = {}
    for k, one in enumerate(shown):
        others = [o for o in [*shown[:k], *shown[k + 1 :]] if o.stage == one.stage]
        key = (one.file, *one.stage)
        zero = _zero(one, others, before.get(key), answers)
        if isinstance(zero, Zero) and zero.contact is not None:
            before[key] = zero
        found.append(zero)
    return found


def _zero(
    one: Shown, others: Sequence[Shown], before: Zero | None, answers: Answers
) -> Zero | UnsureError:
    if answers.contact == FILE:
        return Zero(0.0, 0.0, "contact at the file's own zero, as said", contact=one.contact)
    length = one.units.displacement
    if answers.contact is not None:
        place = one.signs.way * float(answers.contact)
        told = f"contact at {float(answers.contact):.6g} {length}, as said"
        return Zero(place, 0.0, told, contact=one.contact)
    if one.units.dimensionless:
        told = "strain has the file's own zero: a fixed specimen has no contact"
        return Zero(0.0, 0.0, told)
    agreed = _agreed(others)
    if one.contact is not None and one.approached:
        return _at_contact(one, one.contact, agreed)
    if agreed is not None:
        return _of_others(one, agreed)
    if before is not None:
        told = (
            f"contact at {one.written(before.place)} {length}, the zero of the file's test "
            "before: this one begins in contact"
        )
        return Zero(before.place, 0.0, told, before.sd, before.contact)
    return _at_start(one)


@dataclass(frozen=True)
class _Agreed:
    """Contact and force at rest of files that agree: means, their standard errors, how many."""

    place: float
    sd: float
    force: float
    force_sd: float
    files: int


def _agreed(others: Sequence[Shown]) -> _Agreed | None:
    """What most of the other files of a stage agree on; None where they are too few."""
    seen = [o.contact for o in others if o.contact is not None and o.approached]
    if len(seen) < _ENOUGH:
        return None
    places, sds = (np.array([getattr(c, key) for c in seen]) for key in ("place", "sd"))
    middle = float(np.median(places))
    alike = np.abs(places - middle) <= _APART * sds
    if np.count_nonzero(alike) < max(_ENOUGH, len(seen) / 2.0):
        return None
    weights = sds[alike] ** -2.0
    place = float(np.average(places[alike], weights=weights))
    spread = float(np.std(places[alike])) / np.sqrt(np.count_nonzero(alike))
    forces = np.array([c.force for c in seen])[alike]
    own = np.array([c.force_sd for c in seen])[alike]
    force_sd = float(np.hypot(np.std(forces), np.sqrt(np.mean(own**2))))
    sd = float(np.hypot(weights.sum() ** -0.5, spread))
    return _Agreed(place, sd, float(np.mean(forces)), force_sd, int(np.count_nonzero(alike)))


def _of_others(one: Shown, agreed: _Agreed) -> Zero:
    length, force = one.units.displacement, one.units.force
    start = one.signs.load * force_at_start(one.way, one.load)
    told = (
        f"contact at {one.written(agreed.place)} +- {agreed.sd:.2g} {length}, on which the pad's "
        f"{agreed.files} other files agree: this one begins beyond it, at "
        f"{one.written(float(one.way[0]))} {length} with {start:.3g} {force}; taken off the force: "
        f"{one.signs.load * agreed.force:.3g} {force}, theirs at rest"
    )
    return Zero(agreed.place, agreed.force, told, agreed.sd)


def _at_contact(one: Shown, contact: Contact, agreed: _Agreed | None) -> Zero:
    length, force = one.units.displacement, one.units.force
    offset = contact.force if abs(contact.force) > _AGREES * contact.force_sd else 0.0
    off = (
        f"; taken off the force: {contact.force:.3g} +- {contact.force_sd:.1g} {force} before "
        "contact"
        if offset
        else ""
    )
    if agreed is not None and abs(contact.place - agreed.place) > _APART * np.hypot(
        contact.sd, agreed.sd
    ):
        off += (
            f"; doubt: the pad's {agreed.files} other files have it at "
            f"{one.written(agreed.place)} +- {agreed.sd:.2g} {length}: was the stage or the pad "
            "moved, or the zero set anew"
        )
    if abs(contact.place) <= _AGREES * contact.sd:
        told = (
            f"contact {one.signs.way * contact.place:.4g} +- {contact.sd:.2g} {length} agrees with "
            f"the file's zero, which is kept{off}"
        )
        return Zero(0.0, offset, told, contact.sd, contact)
    told = (
        f"contact at {one.written(contact.place)} +- {contact.sd:.2g} {length} of the file, where "
        f"the force begins to rise; that is the new zero{off}"
    )
    return Zero(contact.place, offset, told, contact.sd, contact)


def _at_start(one: Shown) -> Zero | UnsureError:
    """The zero of a test that begins in contact: its first row, if that touches with no force.

    The force there is that of the rows at its place alone: of a test that moves at once the next
    rows have more.
    """
    length, force = one.units.displacement, one.units.force
    way, load, peak = one.way, one.load, one.peak
    moved = np.abs(way - way[0]) > _STILL * float(np.ptp(way))
    first = float(np.median(load[: max(int(np.argmax(moved)), 1)]))
    share = abs(first) / peak if peak > 0.0 else 1.0
    if abs(first) > max(_REST * peak, _AGREES * scatter(load)):
        return UnsureError(
            f"the test begins in contact, with {one.signs.load * first:.3g} {force} "
            f"({share:.1%} of the peak force): where the specimen is first touched is not in it",
            file=one.file,
            option="contact",
            question=f"displacement at first contact in {length}, before it is set to "
            f"zero, or '{FILE}' for its own zero",
            say="VALUE, or --contact file for the file's own zero",
        )
    place = float(way[0])
    near = abs(place) <= _NEAR * float(np.ptp(way))
    where = "the file's own zero" if near else f"the first row, {one.written(place)}"
    # the force of the first row over the mean stiffness bounds how far contact may lie above
    reach = abs(first) / peak * float(way[int(np.argmax(load))] - place)
    told = (
        f"contact at {where} {length}: there is no approach, and the first row has "
        f"{share:.2%} of the peak force (it may lie {reach:.2g} {length} higher)"
    )
    return Zero(0.0 if near else place, 0.0, told)
