r"""Find the zero of displacement and force, from the contact in the file or on its stage.

The files of a pad on one stage share one contact, in which slow tests count most. A drag of
viscosity or of a film adds a jump in proportion to the speed to the onset of the force, and a lag
between the channels moves it by the speed times a delay. The power of depth with which the force
begins, the drag and the delay are common to the files. For each power and drag, the contacts that
the files show are

.. math:: d_i = d_0 + (v_i - v_0) T + e_i, \quad T \sim N(0, \tau),

where v_0 is the slowest speed of the stage and tau 5 ms, or 25 ms where that is likelier. The files
decide together on the power and the drag.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.io.contact import (
    FORMS,
    UNLIKELY,
    FirstContact,
    force_at_start,
    level_at_rest,
    mean_over_forms,
    most_slide,
    onsets_of,
)
from qlvbayes.io.loading import FILE, Answers, Loaded
from qlvbayes.io.recording import UnsureError
from qlvbayes.io.wording import plain

_APART = 3.0  # standard errors beyond which the contacts of two files differ
# s: lag, or drag over stiffness, by which the onset of a quick test may be off; that of a slow
# filter is taken where it is likelier
_DELAYS = (0.005, 0.025)
_DRAGS = (0.0, *np.geomspace(0.002, 0.25, 15).tolist())  # of the peak force at the largest speed
_FASTER = 1.5  # ratio of the speeds above which they show a drag
_TINY = 1e-12  # share of the positions' size that an error has at least
_NEAR = 0.01  # share of the travel before its start in which a stated contact may lie
_AGREES = 2.0  # standard errors within which the file's own zero is kept
_ENOUGH = 2  # files whose contacts have to agree for others to take theirs
_RISEN = 0.3  # share of the peak force at which the speed of the approach is read

# The contacts of a stage


@dataclass(frozen=True)
class StageContact:
    """Contact and force at rest of the files of one stage, and their standard errors.

    ``tare_sd`` is that of the force at rest of one file more. ``members`` are the indices of the
    files that agree on the contact.
    """

    position: float
    sd: float
    force: float
    tare_sd: float
    members: tuple[int, ...]

    @property
    def kept(self) -> bool:
        """Return whether the contact agrees with the file's own zero."""
        return abs(self.position) <= _AGREES * self.sd


def _speed(one: Loaded) -> float:
    """Return the speed (1/s) from before contact until the force has risen."""
    before = max(one.contact.rows - 1, 0) if one.contact is not None else 0
    start = force_at_start(one.displacement, one.force)
    risen = one.force[before + 1 :] >= start + _RISEN * (one.peak - start)
    after = before + 1 + int(np.argmax(risen))
    moved = float(one.displacement[after] - one.displacement[before])
    return abs(moved) / float(one.time[after] - one.time[before])


def _stage_contacts(tests: Sequence[Loaded], stage: tuple[object, ...]) -> list[StageContact]:
    """Return the contacts on which tests of a stage agree, that of the most first."""
    shown = {
        k: one.contact
        for k, one in enumerate(tests)
        if one.stage == stage and one.contact is not None and one.approached
    }
    speeds = {k: _speed(tests[k]) for k in shown}
    left = sorted(shown, key=lambda k: (speeds[k], shown[k].sd, shown[k].position))
    stages: list[StageContact] = []
    while left:
        groups: list[list[int]] = []
        for first in left:
            groups.append(_agreeing(shown, speeds, first, left))
            if len(groups[-1]) == len(left):
                break
        largest = max(groups, key=len)  # of equals that with the slowest file
        contacts = [shown[k] for k in largest]
        position, sd = contacts[0].position, contacts[0].sd
        forces = np.array([contact.force for contact in contacts])
        tare_sd = max(contact.tare_sd for contact in contacts)
        if len(largest) > 1:
            own_speeds = np.array([speeds[k] for k in largest])
            position, sd = _joint_position([tests[k] for k in largest], contacts, own_speeds)
            scatter = float(forces.std(ddof=1)) * (1.0 + 1.0 / forces.size) ** 0.5
            tare_sd = max(tare_sd, scatter)  # of the force of one file more
        members = tuple(sorted(largest))
        stages.append(StageContact(position, sd, float(forces.mean()), tare_sd, members))
        left = [k for k in left if k not in largest]
    return stages


def _agreeing(
    shown: dict[int, FirstContact], speeds: dict[int, float], first: int, others: Sequence[int]
) -> list[int]:
    """Return the files that agree with one and with each other, each compared to those before."""
    group = [first]
    for k in (k for k in others if k != first):
        known = np.array([(shown[j].position, shown[j].sd, speeds[j]) for j in group]).T
        slowest = min(float(known[2].min()), speeds[k])
        mean, covariance, _ = _line(known[0], known[1], known[2] - slowest)
        row = np.array([1.0, speeds[k] - slowest])
        error = np.sqrt(row @ covariance @ row + shown[k].sd ** 2)
        if abs(shown[k].position - row @ mean) <= _APART * error:
            group.append(k)
    return group


def _line(positions: Floats, sds: Floats, speeds: Floats) -> tuple[Floats, Floats, float]:
    """Return the line through contacts (n,) over speeds (n,) above the slowest one.

    Its mean (2,) is the contact at the slowest speed and the delay (s), with covariance (2, 2) and
    misfit, for the sd of the delay with the larger evidence.
    """
    centre = float(np.median(positions))
    least = _TINY * max(float(np.abs(positions).max()), np.finfo(float).tiny)
    weights = np.maximum(sds, least) ** -2.0
    rows = np.stack([np.ones_like(speeds), speeds])
    lines = []
    for delay in _DELAYS:
        precision = (rows * weights) @ rows.T + np.diag([0.0, delay**-2.0])
        covariance = np.asarray(np.linalg.inv(precision), float)
        mean = np.asarray(covariance @ (rows * weights) @ (positions - centre))
        misfit = float(weights @ (positions - centre - mean @ rows) ** 2 + (mean[1] / delay) ** 2)
        evidence = 0.5 * float(np.linalg.slogdet(covariance)[1]) - np.log(delay) - 0.5 * misfit
        lines.append((round(evidence, 6), mean + np.array([centre, 0.0]), covariance, misfit))
    return max(lines, key=itemgetter(0))[1:]  # of equals the shorter delay


def _joint_position(
    tests: Sequence[Loaded], contacts: Sequence[FirstContact], speeds: Floats
) -> tuple[float, float]:
    """Return the contact that files (n,) with these speeds show together, and its error."""
    jump = max(one.peak for one in tests) * speeds / speeds.max()
    found: list[Floats | None] = []
    # a press of few rows may show a contact without drag, and none where drag is likelier
    for drags in (_DRAGS if speeds.max() > _FASTER * speeds.min() else _DRAGS[:1], _DRAGS[:1]):
        found = [
            onsets_of(
                one.displacement[contact.slid :], one.force[contact.slid :], contact.level,
                [(power, float(drag * jump[k])) for drag in drags for power, _ in FORMS],
            )
            for k, (one, contact) in enumerate(zip(tests, contacts, strict=True))
        ]  # fmt: skip
        telling = [k for k, rows in enumerate(found) if rows is not None and len(rows)]
        if len(telling) > 1:
            break
    spacings = np.array([contacts[k].spacing for k in telling])
    own = np.array([contacts[k].sd for k in telling])
    by_form = np.stack([rows for k in telling if (rows := found[k]) is not None], axis=1)
    joint = [_over_files(rows, spacings, own, speeds[telling]) for rows in by_form]
    position, sd = mean_over_forms(np.array(joint))
    weights = np.array([contact.sd for contact in contacts]) ** -2.0
    choices = np.array([contact.choice for contact in contacts])
    common = float(np.average(choices**2, weights=weights))
    return position, float(np.sqrt(sd**2 + common))


def _over_files(
    onsets: Floats, spacings: Floats, own: Floats, speeds: Floats
) -> tuple[float, float, float]:
    """Return position, sd and height of the contact that files (n, 3) show with one form."""
    positions, sds, heights = onsets.T
    errors = np.hypot(sds, spacings)
    errors = np.where(errors > 0.0, errors, own)  # an unlikely form has no error of its own
    mean, covariance, misfit = _line(positions, errors, speeds - speeds.min())
    scatter = max(misfit / (len(positions) - 1), 1.0)
    height = float(np.maximum(heights, -UNLIKELY).sum()) - 0.5 * misfit
    return float(mean[0]), float(np.sqrt(covariance[0, 0] * scatter)), height


# The zeros of a test


def with_sliding(shown: Sequence[Loaded]) -> list[Loaded]:
    """Return recordings with the contact after sliding, where most of their stage have one."""
    slides = {
        stage: most_slide([one.sliding for one in shown if one.stage == stage])
        for stage in {one.stage for one in shown}
    }
    return [
        replace(one, contact=one.sliding) if one.sliding and slides[one.stage] else one
        for one in shown
    ]


def with_zeros(shown: Sequence[Loaded], answers: Answers) -> list[Loaded | UnsureError]:
    """Return each test with its zeros, or the question that has to be asked for it."""
    results: list[Loaded | UnsureError] = []
    before: dict[tuple[object, ...], Loaded] = {}
    contacts = {stage: _stage_contacts(shown, stage) for stage in {one.stage for one in shown}}
    for k, one in enumerate(shown):
        key = (one.file, *one.stage)
        found: Loaded | UnsureError
        if answers.contact == FILE:
            finding = "contact at the file's own zero, as stated by the user"
            found = _with_zero(one, 0.0, finding, one.contact)
        elif answers.contact is not None:
            found = _stated(one, float(answers.contact))
        else:
            found = _zeroed(one, k, contacts[one.stage], before.get(key))
        if isinstance(found, Loaded):
            if found.contact is not None:
                before[key] = found
            late = one.sliding
            if answers.contact is None and late is not None and late is not one.contact:
                position = one.written(late.position)
                *others, last = found.findings
                last += (
                    f"; doubt: the force steps by {plain(late.sliding)} {one.units.force} as the "
                    f"platen begins to move and rises again at {position} "
                    f"{one.units.displacement}: if friction or drag of the rig makes the step, "
                    f"--contact {position}"
                )
                found = replace(found, findings=(*others, last))
        results.append(found)
    return results


def _with_zero(
    one: Loaded, zero: float, finding: str, contact: FirstContact | None = None, **more: Any
) -> Loaded:
    """Return a test with its zeros, the contact that shows them, and how they were found."""
    return replace(one, zero=zero, findings=(*one.findings, finding), contact=contact, **more)


def _zeroed(
    one: Loaded, index: int, contacts: Sequence[StageContact], before: Loaded | None
) -> Loaded | UnsureError:
    """Return a test with its zeros; ``before`` is the file's test before on the same stage."""
    if np.ptp(one.force) == 0.0:
        return _with_zero(one, 0.0, "contact at the file's own zero: the force never changes")
    if one.units.dimensionless:
        finding = "strain has the file's own zero: a fixed specimen has no contact"
        return _with_zero(one, 0.0, finding)
    own = next((stage for stage in contacts if index in stage.members), None)
    if own is not None and one.contact is not None:
        return _at_contact(one, one.contact, own, contacts[0])
    if contacts and contacts[0].kept and one.begins_at_zero and one.begins_with(0.0):
        zero = _at_start(one)
        if isinstance(zero, Loaded):
            return replace(zero, zero_sd=contacts[0].sd, contact_stage=_label(one, contacts[0]))
    counts = [len(stage.members) for stage in contacts]
    most = counts and counts[0] >= max(_ENOUGH, sum(counts) / 2.0) and counts[0] not in counts[1:]
    agreed = contacts[0] if most else None
    late = agreed and float(one.displacement[0]) > agreed.position - _APART * agreed.sd
    if agreed is not None and not one.begins_with(0.0):
        # off the specimen by the others' contact, its cell as untared as theirs
        untared = agreed.force != 0.0 and one.begins_with(agreed.force)
        if late or untared:
            return _from_others(one, agreed, "beyond" if late else "before")
    if before is not None:
        finding = (
            f"contact at {one.written(before.zero)} {one.units.displacement}, the zero of the "
            "file's test before: this one begins in contact"
        )
        same = {key: getattr(before, key) for key in ("zero_sd", "contact_stage", "tare_sd")}
        return _with_zero(one, before.zero, finding, before.contact, **same)
    return _at_start(one, "" if agreed is None else _doubt(one, agreed))


def _stated(one: Loaded, written: float) -> Loaded:
    """Return the zero that the user states, with the sign that it has in the file."""
    position, length = one.signs.way * written, one.units.displacement
    low, high = float(one.displacement.min()), float(one.displacement.max())
    before = (_NEAR if one.begins_with(0.0) else 1.0) * (high - low)
    if not low - before <= position < high:
        raise InputError(
            f"--contact {written:.6g} lies outside the travel, {one.written(one.displacement[0])} "
            f"{length} at the start and {one.written(high)} {length} at the deepest",
            file=one.file,
            remedy="state it in the unit of the tidy file and with the sign of the file",
        )
    finding = f"contact at {written:.6g} {length}, as stated by the user"
    rest, sd = level_at_rest(one.displacement, one.force)
    if position - low <= _NEAR * (high - low) or abs(rest) <= _AGREES * sd:
        return _with_zero(one, position, finding, one.contact)
    finding += _taken_off(one, rest)
    return _with_zero(one, position, finding, one.contact, tare=rest, tare_sd=sd)


def _taken_off(one: Loaded, rest: float) -> str:
    return f"; taken off the force: {plain(one.signs.load * rest)} {one.units.force} before contact"


def _label(one: Loaded, stage: StageContact) -> str:
    return "0" if stage.kept else one.written(stage.position)


def _placed(one: Loaded, at: StageContact | FirstContact) -> str:
    """Return a contact as text with its error: '7.01 +- 0.02 mm'."""
    return f"{one.written(at.position)} +- {plain(at.sd, 2)} {one.units.displacement}"


def _from_others(one: Loaded, agreed: StageContact, where: str) -> Loaded:
    start = one.signs.load * force_at_start(one.displacement, one.force)
    length, force = one.units.displacement, one.units.force
    finding = (
        f"contact at {_placed(one, agreed)}, on which the pad's {len(agreed.members)} other files "
        f"agree: this one begins {where} it, at {one.written(one.displacement[0])} {length} with "
        f"{plain(start)} {force}; taken off the force: {plain(one.signs.load * agreed.force)} "
        f"{force}, theirs at rest"
    )
    return _with_zero(
        one, agreed.position, finding, tare=agreed.force, contact_stage=_label(one, agreed),
        zero_sd=agreed.sd, tare_sd=agreed.tare_sd,
    )  # fmt: skip


def _doubt(one: Loaded, others: StageContact) -> str:
    """Return the words on other files whose contact lies elsewhere, and the option that joins."""
    count = len(others.members)
    have = f"{count} other files have" if count > 1 else "other file has"
    return (
        f"; doubt: the pad's {have} it at {_placed(one, others)}: was the stage or the pad moved, "
        f"or the zero set anew? If not, --contact {one.written(others.position)} gives all files "
        "one zero"
    )


def _at_contact(
    one: Loaded, contact: FirstContact, stage: StageContact, most: StageContact
) -> Loaded:
    """Return the zero of a file at the contact of its stage; ``most`` is that of most files."""
    together = len(stage.members) > 1
    finding = f"contact at {_placed(one, stage)}"
    finding += " agrees with the file's zero, which is kept" if stage.kept else ", the new zero"
    if together:
        finding += f", in {len(stage.members)} files of one stage (this one alone: "
        finding += f"{_placed(one, contact)})"
    offset = contact.force if abs(contact.force) > _AGREES * contact.tare_sd else 0.0
    if offset:
        finding += _taken_off(one, contact.force)
    if contact.sliding:
        finding += (
            "; as the platen begins to move the force rises by "
            f"{plain(contact.sliding)} {one.units.force}, before the specimen is touched: friction "
            "or drag of the rig, which is left in"
        )
    if stage is not most:
        finding += _doubt(one, most)
    apart = abs(contact.position - stage.position) > _APART * float(np.hypot(contact.sd, stage.sd))
    if together and apart:
        finding += (
            "; doubt: that of this one alone is off beyond the errors, as a film, drag or a lag "
            f"does in a quick test; --contact {one.written(stage.position)} states this zero"
        )
    return _with_zero(
        one, 0.0 if stage.kept else stage.position, finding, contact, tare=offset,
        contact_stage=_label(one, stage), zero_sd=stage.sd, tare_sd=contact.tare_sd,
    )  # fmt: skip


def _at_start(one: Loaded, doubt: str = "") -> Loaded | UnsureError:
    """Return the first row as zero, if the force is none there: the test begins in contact."""
    length, force = one.units.displacement, one.units.force
    first, peak = one.force_at_first, float(np.abs(one.force).max())
    share = abs(first) / peak if peak > 0.0 else 1.0
    if not one.begins_with(0.0):
        return UnsureError(
            f"the test begins in contact, with {plain(one.signs.load * first)} {force} "
            f"({share:.1%} of the largest force): where the specimen is first touched is not in it",
            file=one.file,
            option="contact",
            question=f"displacement at first contact in {length}, before it is set to "
            f"zero, or '{FILE}' for its own zero",
            say="VALUE, or --contact file for the file's own zero",
        )
    position, near = float(one.displacement[0]), one.begins_at_zero
    where = "the file's own zero" if near else f"the first row, {one.written(position)} {length}"
    # the force of the first row over the mean stiffness bounds how far contact may lie above
    reach = share * float(one.displacement[int(np.argmax(one.force))] - position)
    finding = (
        f"contact at {where}: there is no approach, and the first row has "
        f"{share:.2%} of the peak force (it may lie {plain(reach, 2)} {length} higher){doubt}"
    )
    return _with_zero(one, 0.0 if near else position, finding)
