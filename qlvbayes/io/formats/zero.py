"""Find the zero of displacement and force, from the contact in the file or in the pad's others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.answers import FILE, Answers, UnsureError
from qlvbayes.io.formats.contact import FirstContact, Signs, force_at_start, scatter
from qlvbayes.io.formats.format import Floats
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain

_REST = 0.01  # share of the peak force below which a test begins without force
_NEAR = 0.01  # share of the travel within which a first row is at the file's own zero
_STILL = 1e-3  # share of the travel within which rows at the beginning are at one position
_AGREES = 2.0  # standard errors within which the file's own zero is kept
_APART = 3.0  # standard errors beyond which the contacts of two files differ
_ENOUGH = 2  # other files whose contacts have to agree for a pad to lie on one stage


@dataclass(frozen=True, eq=False)
class OrientedRecording:
    """A recording in which pressing is positive in ``way`` and ``load`` (n,).

    ``stage`` is equal for recordings whose displacement may have one zero: those of one pad and
    layout. ``contact`` is None where the recording shows none.
    """

    file: Path
    stage: tuple[object, ...]
    units: UnitSystem
    way: Floats
    load: Floats
    signs: Signs
    contact: FirstContact | None

    @property
    def peak(self) -> float:
        """Return the largest force."""
        return float(self.load.max())

    @property
    def approached(self) -> bool:
        """Return whether it moved before the force began to rise, or rests without a force."""
        if self.contact is None:
            return False
        travelled = self.contact.position - float(self.way[0]) > _AGREES * self.contact.sd
        return travelled or abs(self.contact.force) <= _REST * self.peak

    def written(self, displacement: float) -> str:
        """Return a displacement as text with its sign in the file."""
        return f"{self.signs.way * displacement:.6g}"


@dataclass(frozen=True)
class Zero:
    """Zeros subtracted from displacement and force, and the displacement's standard error.

    ``position`` is the displacement, and ``sd`` is None where it was not measured. ``finding`` says
    how it was found; ``contact`` is where the file's own rise of the force shows it.
    """

    position: float
    force: float
    finding: str
    sd: float | None = None
    contact: FirstContact | None = None


def zeros(shown: Sequence[OrientedRecording], answers: Answers) -> list[Zero | UnsureError]:
    """Return the zero of each recording, or the question that has to be asked for it.

    A recording that begins in contact takes the zero of the others on its stage where two or more
    of them agree, or else that of the file's recording before. Contacts that differ from those of
    all others are reported.
    """
    results: list[Zero | UnsureError] = []
    before: dict[tuple[object, ...], Zero] = {}
    for k, one in enumerate(shown):
        others = [o for o in [*shown[:k], *shown[k + 1 :]] if o.stage == one.stage]
        key = (one.file, *one.stage)
        zero = _zero(one, others, before.get(key), answers)
        if isinstance(zero, Zero) and zero.contact is not None:
            before[key] = zero
        results.append(zero)
    return results


def _zero(
    one: OrientedRecording,
    others: Sequence[OrientedRecording],
    before: Zero | None,
    answers: Answers,
) -> Zero | UnsureError:
    if answers.contact == FILE:
        return Zero(
            0.0, 0.0, "contact at the file's own zero, as stated by the user", contact=one.contact
        )
    length = one.units.displacement
    if answers.contact is not None:
        position = one.signs.way * float(answers.contact)
        if position >= float(one.way.max()):
            raise InputError(
                f"--contact {float(answers.contact):.6g} lies beyond the largest displacement, "
                f"{one.written(float(one.way.max()))} {length}",
                file=one.file,
                remedy="state it in the unit of the tidy file",
            )
        finding = f"contact at {float(answers.contact):.6g} {length}, as stated by the user"
        return Zero(position, 0.0, finding, contact=one.contact)
    if one.units.dimensionless:
        finding = "strain has the file's own zero: a fixed specimen has no contact"
        return Zero(0.0, 0.0, finding)
    agreed = _agreed(others)
    if one.contact is not None and one.approached:
        return _at_contact(one, one.contact, agreed)
    if agreed is not None:
        return _from_others(one, agreed)
    if before is not None:
        finding = (
            f"contact at {one.written(before.position)} {length}, the zero of the file's test "
            "before: this one begins in contact"
        )
        return Zero(before.position, 0.0, finding, before.sd, before.contact)
    return _at_start(one)


@dataclass(frozen=True)
class _Agreed:
    """Contact and force at rest of files that agree: means, standard errors, number of files."""

    position: float
    sd: float
    force: float
    force_sd: float
    files: int


def _agreed(others: Sequence[OrientedRecording]) -> _Agreed | None:
    """Return what most of the other files of a stage agree on; None where they are too few."""
    seen = [o.contact for o in others if o.contact is not None and o.approached]
    if len(seen) < _ENOUGH:
        return None
    positions, sds = (np.array([getattr(c, key) for c in seen]) for key in ("position", "sd"))
    middle = float(np.median(positions))
    alike = np.abs(positions - middle) <= _APART * sds
    if np.count_nonzero(alike) < max(_ENOUGH, len(seen) / 2.0):
        return None
    weights = sds[alike] ** -2.0
    position = float(np.average(positions[alike], weights=weights))
    spread = float(np.std(positions[alike])) / np.sqrt(np.count_nonzero(alike))
    forces = np.array([c.force for c in seen])[alike]
    own = np.array([c.force_sd for c in seen])[alike]
    force_sd = float(np.hypot(np.std(forces), np.sqrt(np.mean(own**2))))
    sd = float(np.hypot(weights.sum() ** -0.5, spread))
    return _Agreed(position, sd, float(np.mean(forces)), force_sd, int(np.count_nonzero(alike)))


def _from_others(one: OrientedRecording, agreed: _Agreed) -> Zero:
    length, force = one.units.displacement, one.units.force
    start = one.signs.load * force_at_start(one.way, one.load)
    finding = (
        f"contact at {one.written(agreed.position)} +- {plain(agreed.sd, 2)} {length}, on which "
        f"the pad's {agreed.files} other files agree: this one begins beyond it, at "
        f"{one.written(float(one.way[0]))} {length} with {plain(start)} {force}; taken off the "
        f"force: {plain(one.signs.load * agreed.force)} {force}, theirs at rest"
    )
    return Zero(agreed.position, agreed.force, finding, agreed.sd)


def _at_contact(one: OrientedRecording, contact: FirstContact, agreed: _Agreed | None) -> Zero:
    length, force = one.units.displacement, one.units.force
    offset = contact.force if abs(contact.force) > _AGREES * contact.force_sd else 0.0
    off = (
        f"; taken off the force: {plain(contact.force)} +- {plain(contact.force_sd, 1)} {force} "
        "before contact"
        if offset
        else ""
    )
    if agreed is not None and abs(contact.position - agreed.position) > _APART * np.hypot(
        contact.sd, agreed.sd
    ):
        off += (
            f"; doubt: the pad's {agreed.files} other files have it at "
            f"{one.written(agreed.position)} +- {plain(agreed.sd, 2)} {length}: was the stage "
            "or the pad moved, or the zero set anew"
        )
    if abs(contact.position) <= _AGREES * contact.sd:
        finding = (
            f"contact {plain(one.signs.way * contact.position, 4)} +- {plain(contact.sd, 2)} "
            f"{length} agrees "
            f"with the file's zero, which is kept{off}"
        )
        return Zero(0.0, offset, finding, contact.sd, contact)
    finding = (
        f"contact at {one.written(contact.position)} +- {plain(contact.sd, 2)} {length} of the "
        f"file, where the force begins to rise; that is the new zero{off}"
    )
    return Zero(contact.position, offset, finding, contact.sd, contact)


def _at_start(one: OrientedRecording) -> Zero | UnsureError:
    """Return the zero of a test that begins in contact: its first row, if the force is none there.

    The force there is that of the rows at the first position alone: in a test that moves at once
    the next rows have more.
    """
    length, force = one.units.displacement, one.units.force
    way, load, peak = one.way, one.load, one.peak
    moved = np.abs(way - way[0]) > _STILL * float(np.ptp(way))
    first = float(np.median(load[: max(int(np.argmax(moved)), 1)]))
    share = abs(first) / peak if peak > 0.0 else 1.0
    if abs(first) > max(_REST * peak, _AGREES * scatter(load)):
        return UnsureError(
            f"the test begins in contact, with {plain(one.signs.load * first)} {force} "
            f"({share:.1%} of the peak force): where the specimen is first touched is not in it",
            file=one.file,
            option="contact",
            question=f"displacement at first contact in {length}, before it is set to "
            f"zero, or '{FILE}' for its own zero",
            say="VALUE, or --contact file for the file's own zero",
        )
    position = float(way[0])
    near = abs(position) <= _NEAR * float(np.ptp(way))
    where = "the file's own zero" if near else f"the first row, {one.written(position)} {length}"
    # the force of the first row over the mean stiffness bounds how far contact may lie above
    reach = abs(first) / peak * float(way[int(np.argmax(load))] - position)
    finding = (
        f"contact at {where}: there is no approach, and the first row has "
        f"{share:.2%} of the peak force (it may lie {plain(reach, 2)} {length} higher)"
    )
    return Zero(0.0 if near else position, 0.0, finding)
