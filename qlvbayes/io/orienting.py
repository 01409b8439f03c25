"""Orient tests so that pressing is positive, leave out those of dead channels, and copies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.contact import Signs, first_rises, is_dead
from qlvbayes.io.loading import SIGNS, Answers, Loaded
from qlvbayes.io.readings import same_readings, wrong_signs
from qlvbayes.io.recording import UnsureError
from qlvbayes.io.wording import joined, listed, plain


def oriented_tests(
    own: Sequence[Loaded], every: Sequence[Loaded], answers: Answers
) -> list[Loaded]:
    """Return a file's tests in which pressing is positive; dead ones go where others are not."""
    known = answers.sign is not None
    dead = [
        one
        for one in own
        if one.signs.doubt and not (known or one.recording.pressing) and _is_dead(one)
    ]
    prepared = [
        _oriented(one, _signs(one, every, answers), answers) for one in own if one not in dead
    ]
    if not prepared:
        raise InputError(
            f"the force does not answer to the displacement: its {len(dead[0].force)} readings "
            f"scatter by {plain(float(np.std(dead[0].force)), 2)} about one level",
            file=dead[0].file,
            remedy="check the load cell and its cable, or leave the file out",
        )
    live = [one for one in prepared if not _is_dead(one)] or prepared
    live[0].dropped.update(own[0].dropped)
    for test in (*dead, *(one for one in prepared if one not in live)):
        name = f"rows of '{test.recording.name}', in which the force does not answer"
        live[0].dropped[name] = len(test.recording.time.values)
    return live


def _is_dead(one: Loaded) -> bool:
    return is_dead(one.displacement, one.force)


def _oriented(one: Loaded, signs: Signs, answers: Answers) -> Loaded:
    """Return a recording in which pressing is positive, with the contact that it shows."""
    way, load = one.displacement * signs.way, one.force * signs.load
    wrong = wrong_signs(way, load)
    if wrong and not (one.units.dimensionless and len(wrong) > 1):
        what = f"the specimen is pressed with {joined([*wrong])} negative"
        if answers.sign is None:
            raise _unsure_of_sign(one.file, what)
        remedy = "leave --sign out"
        raise InputError(f"with --sign {answers.sign} {what}", file=one.file, remedy=remedy)
    constant = float(np.ptp(load)) == 0.0
    contact = sliding = None
    if not (one.units.dimensionless or constant):
        contact, sliding = first_rises(way, load, at_zero=one.begins_at_zero)
    unused = one.recording.unused
    findings = [*one.findings, *([f"columns not used: {listed(unused)}"] if unused else [])]
    findings.append(_sign_finding(one, signs, answers))
    if constant:
        findings.append(
            f"the force is {plain(float(one.force[0]))} {one.units.force} in every row: it is "
            "taken as prescribed, and the test as creep (column control)"
        )
    return replace(
        one, displacement=way, force=load, signs=signs, contact=contact, sliding=sliding,
        findings=tuple(findings),
    )  # fmt: skip


def _signs(one: Loaded, every: Sequence[Loaded], answers: Answers) -> Signs:
    """Return the signs of a recording: one for a file and layout, from parts that begin at rest."""
    if answers.sign is not None:
        of_way, of_load = SIGNS[answers.sign]
        return replace(one.signs, way=of_way, load=of_load, doubt="")
    if one.recording.pressing:
        return replace(one.signs, way=1, load=1, doubt="")
    alike = [other for other in every if _layout(other) == _layout(one) and other.signs.rank]
    within = [other for other in alike if other.file == one.file]
    if within:
        first = max(within, key=lambda other: (other.signs.rank, float(np.ptp(other.force))))
        return replace(one.signs, way=first.signs.way, load=first.signs.load, doubt="")
    found = {(other.signs.way, other.signs.load) for other in alike}
    if len(found) != 1:
        raise _unsure_of_sign(one.file, one.signs.doubt)
    way, load = found.pop()
    return replace(one.signs, way=way, load=load, doubt="")


def _layout(one: Loaded) -> tuple[str, str, str]:
    return one.format.name, one.recording.way.name, one.recording.load.name


def _unsure_of_sign(file: Path, doubt: str) -> UnsureError:
    return UnsureError(
        f"the direction that presses cannot be determined: {doubt}",
        file=file,
        option="sign",
        question="which columns are to be turned over so that pressing is positive "
        f"({', '.join(SIGNS)})",
        say="|".join(SIGNS),
    )


def _sign_finding(one: Loaded, signs: Signs, answers: Answers) -> str:
    pairs = ((one.recording.way, signs.way), (one.recording.load, signs.load))
    turned = [channel.name for channel, factor in pairs if factor < 0]
    what = f"sign turned over: {' and '.join(turned)}" if turned else "sign kept as written"
    if answers.sign is not None:
        return f"{what}, as stated by the user"
    if one.recording.pressing:
        return f"{what}: this layout fixes it"
    if not one.signs.rank:
        return f"{what}: taken from the parts or files of this layout that begin at rest"
    return (
        f"{what}: taken as pressing, with the largest force at {signs.travel:.0%} of the travel "
        "(a test in tension would look the same)"
    )


def without_copies(read: Sequence[Loaded]) -> list[Loaded]:
    """Return the records without those that are equal, after conversion, to one before of the pad.

    A machine may write one force in N and in kgf, side by side, below one another or in two files.
    """
    kept: list[Loaded] = []
    for one in read:
        same = next((k for k, other in enumerate(kept) if _equal(one, other)), None)
        if same is None:
            kept.append(one)
            continue
        names = f"{one.recording.way.name} and {one.recording.load.name}"
        finding = f"'{one.named}' ({names}) has the same readings and is left out"
        other = kept[same]
        recording = other.recording
        if recording.name.isdecimal() and other.file == one.file:
            recording = replace(recording, name="")  # a number that told them apart
        findings = (*other.findings, finding)
        kept[same] = replace(other, recording=recording, findings=findings)
    return kept


def _equal(one: Loaded, other: Loaded) -> bool:
    """Return whether two records are equal within the digits in which they are written."""
    units = one.units.dimensionless == other.units.dimensionless
    if one.pad != other.pad or len(one.time) != len(other.time) or not units:
        return False
    way, load = (one.units.factor_to(other.units, kind) for kind in ("displacement", "force"))
    return (
        one.recording.stated.began == other.recording.stated.began
        and same_readings(one.time - one.time[0], other.time - other.time[0])
        and same_readings(one.displacement * way, other.displacement)
        and same_readings(one.force * load, other.force)
    )
