r"""A slope of the force before contact: a tilted stage, a cable that pulls, a sensor that drifts.

Off the specimen, on the way in and on the way back, the force is

.. math:: F = F_0 + s\,d + r\,t

with a slope s along the displacement, a drift r, or both, whichever the readings off the specimen
need. It goes on while the specimen is pressed, so that it is taken off all readings, and the point
of contact is found again. A drag or a guide that rubs turns with the direction of the movement, and
a film or an attraction grows as the gap closes: they are no such lines, and are left to the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qlvbayes.io.arrays import Array
from qlvbayes.io.contact import FirstContact, find_contact
from qlvbayes.io.data import Control, Pad, Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain

_FEWEST = 20  # readings off the specimen, on the way in
_BACK = 10  # and on the way back, where they count
_SURE = 6.0  # standard errors of a slope or a drift that is there and back,
_SURER = 12.0  # and of one that is seen on the way in alone, where a soft beginning looks alike,
_MATTERS = 0.01  # of the largest force, by which it changes the force at least
_STRAIGHT = 4.0  # standard errors, within which it does not bend,
_AGREE = 2.0  # times the scatter of neighbouring readings that a line leaves at most,
_TURNS = 0.2  # and the part of its change by which the force may turn with the direction
_MOST = 0.6  # of the tests that show it: a slope is the rig's, and no single test's
_AGREES = 4.0  # standard errors, within which the tests of a pad have one slope
_CLEAR = 0.1  # of the way in before contact, that is left out next to it
_ROUNDS = 4  # of finding the contact and the line


@dataclass(frozen=True, eq=False)
class Slope:
    """Line of the force off the specimen: level, slope along displacement, drift, and their sds."""

    line: Array  # (3,)
    sds: Array  # (3,), 0 where it is not needed
    seen_back: bool  # whether the way back shows it as well
    change: float  # of the force from the first reading to contact, over the largest force
    contact: FirstContact  # found without it

    @property
    def is_sure(self) -> bool:
        """True if a slope or a drift is there."""
        least = (_SURE if self.seen_back else _SURER) * self.sds[1:]
        return bool(np.any(np.abs(self.line[1:]) > least))


def without_slopes(pad: Pad) -> tuple[Pad, tuple[str, ...]]:
    """Return a pad without slopes of the force before contact, and a sentence on each."""
    slopes = [None if pad.units.dimensionless else _slope_of(test) for test in pad.tests]
    known = [slope for slope in slopes if slope is not None]
    if not known or len(known) < _MOST * len(slopes) or not _alike(known):
        return pad, ()
    tests, notices = [], []
    for test, slope in zip(pad.tests, slopes, strict=True):
        if slope is None:
            tests.append(test)
            continue
        force = test.force - slope.line @ _columns(test.displacement, test.time)
        way, sd = test.displacement, test.contact_sd
        if sd is not None:  # the old zero was the contact found, with a stage's other tests
            stage = test.contact_stage
            found = [
                other.contact
                for one, other in zip(pad.tests, slopes, strict=True)
                if other is not None and (one is test or (stage and one.contact_stage == stage))
            ]
            positions, sds = np.array([(one.position, one.sd) for one in found]).T
            sd = float(np.sum(sds**-2.0) ** -0.5)
            way = way - float(positions @ sds**-2.0) * sd**2
        tare = float(slope.sds[0])
        tests.append(replace(test, force=force, displacement=way, contact_sd=sd, tare_sd=tare))
        notices.append(_notice(pad.name, test, slope, pad.units))
    return replace(pad, tests=tuple(tests)), tuple(notices)


def _alike(slopes: Sequence[Slope]) -> bool:
    """Return whether the tests have one slope and one drift, 0 where neither was needed."""
    every = np.array([(slope.line, slope.sds) for slope in slopes])
    for values, sds in (every[:, :, 1].T, every[:, :, 2].T):
        if sds.any():
            sure = np.where(sds > 0.0, sds, sds.max())
            mean = float(np.average(values, weights=sure**-2.0))
            if np.any(np.abs(values - mean) > _AGREES * np.hypot(sure, 0.1 * np.abs(mean))):
                return False
    return True


def _columns(way: Array, time: Array) -> Array:
    return np.stack([np.ones_like(way), way, time])


def _slope_of(test: Test) -> Slope | None:
    """Return the slope of a test's force off the specimen; None where there is none."""
    if test.control == Control.FORCE or test.changes or test.time.size < 2 * _FEWEST:
        return None
    fresh = np.ones(test.time.size, dtype=bool) if test.used is None else test.used
    time, way, force = test.time[fresh], test.displacement[fresh], test.force[fresh]
    # where the file's own zero is the contact, all beyond it is the specimen's
    beyond = 0.0 if test.contact_sd is None else np.inf
    contact, slope = find_contact(way, force) if way[0] < beyond else None, None
    for _ in range(_ROUNDS):
        if contact is None:  # it begins in contact
            return None
        way_in = contact.position - float(way[0])
        spare = max(_CLEAR * way_in, min(2.0 * contact.sd, 0.5 * way_in))
        slope = _line(time, way, force, min(contact.position - spare, beyond), contact)
        if slope is None or not slope.is_sure:
            return None
        contact = find_contact(way, force - slope.line @ _columns(way, time))
    if contact is None or slope is None:
        return None
    first = np.array([contact.position - way[0], time[contact.rows] - time[0]])
    span = np.abs(slope.line[1:]) @ [np.ptp(way), np.ptp(time)]
    largest = float(force.max())
    if span < _MATTERS * largest:
        return None
    return replace(slope, change=float(slope.line[1:] @ first) / largest, contact=contact)


def _line(
    time: Array, way: Array, force: Array, limit: float, contact: FirstContact
) -> Slope | None:
    """Return the line of the force below a displacement, on the way in and, where read, back.

    None where the force off the specimen is no line, or hardly any reading shows it.
    """
    rows, peak = np.arange(way.size), int(np.argmax(force))
    inward = np.flatnonzero((rows < peak) & (way < limit))
    outward = np.flatnonzero((rows > peak) & (way < limit))
    if inward.size < _FEWEST or np.ptp(way[inward]) == 0.0:
        return None
    scatter = float(np.sqrt(np.mean(np.diff(force[inward], 2) ** 2) / 6.0))
    back = outward.size >= _BACK
    both = np.concatenate([inward, outward]) if back else inward
    for needed in ((1,), (2,), (1, 2)) if back else ((1,),):
        line, sds = np.zeros(3), np.zeros(3)
        columns = [0, *needed]
        design = _columns(way, time)[columns][:, both].T
        line[columns], sds[columns], left = _least_squares(design, force[both])
        bent = np.column_stack([design, (way[both] - np.mean(way[both])) ** 2])
        bend, bend_sds, _ = _least_squares(bent, force[both])
        if left > _AGREE * scatter or abs(bend[-1]) > _STRAIGHT * bend_sds[-1]:
            continue
        own = line @ _columns(way, time)
        sides = [float(np.mean((force - own)[rows])) for rows in (inward, outward) if rows.size]
        # as a drag and a guide that rubs do, it turns with the direction
        turns = abs(sides[-1] - sides[0]) > _TURNS * float(np.ptp(own[both]))
        if not (back and turns):
            return Slope(line, sds, back, 0.0, contact)
    return None


def _least_squares(design: Array, values: Array) -> tuple[Array, Array, float]:
    """Return coefficients, their sds given the residual's correlation, and its sd."""
    size = np.linalg.lstsq(design, values, rcond=None)[0]
    residual = values - design @ size
    left = float(np.sqrt(residual @ residual / max(values.size - size.size, 1)))
    power = max(float(residual @ residual), np.finfo(float).tiny)
    alike = float(np.clip(residual[1:] @ residual[:-1] / power, 0.0, 0.95))
    inverse = np.linalg.pinv(design.T @ design, hermitian=True)
    sds = left * np.sqrt((1.0 + alike) / (1.0 - alike) * np.diag(inverse))
    return np.asarray(size), np.asarray(sds), left


def _notice(pad: str, test: Test, slope: Slope, units: UnitSystem) -> str:
    way, contact = units.displacement, slope.contact
    kinds = zip(slope.line[1:], slope.sds[1:], (way, "s"), strict=True)
    parts = [f"{plain(x)} +- {plain(sd, 2)} {units.force}/{per}" for x, sd, per in kinds if x]
    where = "on the way in and on the way back" if slope.seen_back else "on the way in"
    return (
        f"pad {pad}, test {test.name}: off the specimen the {units.force_name} changes by "
        f"{' and '.join(parts)} ({100.0 * abs(slope.change):.2g} % of the largest before contact), "
        f"{where}, as a tilt, a cable or a drift makes it; it is taken off all readings, and the "
        f"contact then lies {plain(contact.position)} +- {plain(contact.sd, 2)} {way} from the "
        "zero as it was read"
    )
