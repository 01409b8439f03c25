r"""Estimate one contact for the files of a pad on one stage, in which slow tests count most.

A drag of viscosity or of a film adds a jump in proportion to the speed to the onset of the force,
and a lag between the channels moves it by the speed times a delay. The power of depth with which
the force begins, the drag and the delay are common to the files. For each power and drag, the
contacts that the files show are

.. math:: d_i = d_0 + (v_i - v_0) T + e_i, \quad T \sim N(0, 5\,\mathrm{ms}),

where v_0 is the slowest speed of the stage. The files decide together on the power and the drag.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.io.formats.contact import (
    FORMS,
    UNLIKELY,
    FirstContact,
    Form,
    Onset,
    mean_over_forms,
    onsets_of,
)
from qlvbayes.io.formats.format import Floats

APART = 3.0  # standard errors beyond which the contacts of two files differ
_DELAY = 0.005  # s: lag, or drag over stiffness, by which the onset of a quick test may be off
_DRAGS = (0.0, *np.geomspace(0.002, 0.25, 15).tolist())  # of the peak force at the largest speed
_APART = 1.5  # ratio of the speeds above which they show a drag
_TINY = 1e-12  # share of the positions' size that an error has at least


@dataclass(frozen=True, eq=False)
class Approach:
    """The contact that one file shows, and the speed with which it was approached."""

    way: Floats
    load: Floats
    contact: FirstContact
    speed: float


@dataclass(frozen=True)
class StageContact:
    """Contact and force at rest of the files of one stage, each with its standard error.

    ``members`` are the indices of the files that agree on it.
    """

    position: float
    sd: float
    force: float
    force_sd: float
    members: tuple[int, ...]

    def contradicts(self, contact: FirstContact) -> bool:
        """Return whether a file's own contact is beyond the errors of both."""
        return abs(contact.position - self.position) > APART * float(np.hypot(contact.sd, self.sd))


def stage_contacts(approaches: Sequence[Approach]) -> list[StageContact]:
    """Return the contacts on which files agree, that of the most files first."""

    def slow_first(k: int) -> tuple[float, float, float]:
        contact = approaches[k].contact
        return approaches[k].speed, contact.sd, contact.position

    left = sorted(range(len(approaches)), key=slow_first)
    stages: list[StageContact] = []
    while left:
        groups: list[list[int]] = []
        for first in left:
            groups.append(_agreeing(approaches, first, left))
            if len(groups[-1]) == len(left):
                break
        largest = max(groups, key=len)  # of equals that with the slowest file
        stages.append(_joint(approaches, largest))
        left = [k for k in left if k not in largest]
    return stages


def _agreeing(approaches: Sequence[Approach], first: int, others: Sequence[int]) -> list[int]:
    """Return the files that agree with one and with each other, each compared to those before."""
    group = [first]
    for k in (k for k in others if k != first):
        one = approaches[k]
        known = [approaches[j] for j in group]
        speeds = np.array([o.speed for o in known])
        slowest = min(float(speeds.min()), one.speed)
        line = _line(
            np.array([o.contact.position for o in known]),
            np.array([o.contact.sd for o in known]),
            speeds - slowest,
        )
        row = np.array([1.0, one.speed - slowest])
        error = np.sqrt(row @ line.covariance @ row + one.contact.sd**2)
        if abs(one.contact.position - row @ line.mean) <= APART * error:
            group.append(k)
    return group


@dataclass(frozen=True)
class _Line:
    """Contact at the slowest speed and delay (s): mean (2,), covariance (2, 2), misfit."""

    mean: Floats
    covariance: Floats
    misfit: float


def _line(positions: Floats, sds: Floats, speeds: Floats) -> _Line:
    """Return the line through contacts (n,) over speeds (n,) above the slowest one."""
    centre = float(np.median(positions))
    least = _TINY * max(float(np.abs(positions).max()), np.finfo(float).tiny)
    weights = np.maximum(sds, least) ** -2.0
    rows = np.stack([np.ones_like(speeds), speeds])
    precision = (rows * weights) @ rows.T + np.diag([0.0, _DELAY**-2.0])
    covariance = np.linalg.inv(precision)
    mean = np.asarray(covariance @ (rows * weights) @ (positions - centre))
    residual = positions - centre - mean @ rows
    misfit = float(weights @ residual**2 + (mean[1] / _DELAY) ** 2)
    return _Line(mean + np.array([centre, 0.0]), np.asarray(covariance, float), misfit)


def _joint(approaches: Sequence[Approach], members: Sequence[int]) -> StageContact:
    """Return what the files of one stage show together."""
    known = [approaches[k] for k in members]
    contacts = [one.contact for one in known]
    forces = np.array([contact.force for contact in contacts])
    own = np.array([contact.force_sd for contact in contacts])
    force_sd = float(np.hypot(np.std(forces), np.sqrt(np.mean(own**2))))
    if len(known) == 1:
        position, sd = contacts[0].position, contacts[0].sd
    else:
        position, sd = _joint_position(known)
    return StageContact(position, sd, float(forces.mean()), force_sd, tuple(sorted(members)))


def _joint_position(known: Sequence[Approach]) -> tuple[float, float]:
    speeds = np.array([one.speed for one in known])
    peak = max(float(one.load.max()) for one in known)
    drags = _DRAGS if speeds.max() > _APART * speeds.min() else _DRAGS[:1]
    found = []
    for one in known:
        jumps = [drag * peak * one.speed / speeds.max() for drag in drags]
        forms = [Form(form.power, jump) for jump in jumps for form in FORMS]
        found.append(onsets_of(one.way, one.load, one.contact.level, forms))
    if sum(map(bool, found)) < 2:  # without drag each shows its own contact
        found = [onsets_of(one.way, one.load, one.contact.level, FORMS) for one in known]
    # A press of few rows may show a contact without drag, and none where drag is likelier.
    telling = [k for k, onsets in enumerate(found) if onsets]
    shown, speeds = [found[k] for k in telling], speeds[telling]
    spacings = np.array([known[k].contact.spacing for k in telling])
    own = np.array([known[k].contact.sd for k in telling])
    joint = [_over_files(onsets, spacings, own, speeds) for onsets in zip(*shown, strict=True)]
    position, sd = mean_over_forms(joint)
    weights = np.array([one.contact.sd for one in known]) ** -2.0
    choices = np.array([one.contact.choice for one in known])
    common = float(np.average(choices**2, weights=weights))
    return position, float(np.sqrt(sd**2 + common))


def _over_files(onsets: Sequence[Onset], spacings: Floats, own: Floats, speeds: Floats) -> Onset:
    """Return the contact that all files show if the force begins with one form."""
    height = sum(max(onset.height, -UNLIKELY) for onset in onsets)
    errors = np.hypot([onset.sd for onset in onsets], spacings)
    errors = np.where(errors > 0.0, errors, own)  # an unlikely form has no error of its own
    positions = np.array([onset.position for onset in onsets])
    line = _line(positions, errors, speeds - speeds.min())
    scatter = max(line.misfit / (len(onsets) - 1), 1.0)
    sd = float(np.sqrt(line.covariance[0, 0] * scatter))
    return Onset(float(line.mean[0]), sd, height - 0.5 * line.misfit)
