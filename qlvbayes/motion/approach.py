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
from numpy.typing import NDArray

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
    """Force off the specimen, in a test's units: F_0 + ``along`` d + ``drift`` t."""

    level: float
    along: float
    along_sd: float
    drift: float
    drift_sd: float
    change: float  # of the force from the first reading to contact, over the largest force
    seen_back: bool  # whether the way back shows it as well
    contact: FirstContact  # found without it

    def taken_off(self, test: Test) -> Array:
        """Return the force (n,) without it."""
        return test.force - self.level - self.along * test.displacement - self.drift * test.time


def without_slopes(pad: Pad) -> tuple[Pad, tuple[str, ...]]:
    """Return a pad without slopes of the force before contact, and a sentence on each."""
    if pad.units.dimensionless:
        return pad, ()
    slopes = [_slope_of(test) for test in pad.tests]
    if not any(slopes) or not _alike(slopes):
        return pad, ()
    zeros = _zeros(pad.tests, slopes)
    tests = [
        test if slope is None else _levelled(test, slope, zero)
        for test, slope, zero in zip(pad.tests, slopes, zeros, strict=True)
    ]
    notices = [
        _notice(pad.name, test, slope, pad.units)
        for test, slope in zip(pad.tests, slopes, strict=True)
        if slope
    ]
    return replace(pad, tests=tuple(tests)), tuple(notices)


def _levelled(test: Test, slope: Slope, zero: tuple[float, float] | None) -> Test:
    force = slope.taken_off(test)
    if zero is None:
        return replace(test, force=force)
    position, sd = zero
    return replace(test, force=force, displacement=test.displacement - position, contact_sd=sd)


def _zeros(
    tests: Sequence[Test], slopes: Sequence[Slope | None]
) -> list[tuple[float, float] | None]:
    """Return the new zero of displacement and its sd, where the old one was the contact found."""
    zeros: list[tuple[float, float] | None] = [None] * len(tests)
    for k, (test, slope) in enumerate(zip(tests, slopes, strict=True)):
        if slope is None or test.contact_sd is None:
            continue
        stage = test.contact_stage
        every = [
            (other.contact.position, other.contact.sd)
            for one, other in zip(tests, slopes, strict=True)
            if other is not None and (one is test or (stage and one.contact_stage == stage))
        ]
        positions, sds = np.array(every).T
        weights = sds**-2.0 / np.sum(sds**-2.0)
        zeros[k] = float(weights @ positions), float(np.sum(sds**-2.0) ** -0.5)
    return zeros


def _alike(slopes: Sequence[Slope | None]) -> bool:
    """Return whether the tests have one slope, whatever their speed."""
    known = [slope for slope in slopes if slope is not None]
    if len(known) < _MOST * len(slopes):
        return False
    return _agree([(slope.along, slope.along_sd) for slope in known]) and _agree(
        [(slope.drift, slope.drift_sd) for slope in known]
    )


def _agree(found: Sequence[tuple[float, float]]) -> bool:
    """Return whether values with their sds are one, 0 where neither was needed."""
    values, sds = np.array(found).T
    if not sds.any():
        return True
    sds = np.where(sds > 0.0, sds, sds.max())
    mean = float(np.average(values, weights=sds**-2.0))
    return bool(np.all(np.abs(values - mean) <= _AGREES * np.hypot(sds, 0.1 * np.abs(mean))))


def _slope_of(test: Test) -> Slope | None:
    """Return the slope of a test's force off the specimen; None where there is none."""
    if test.control == Control.FORCE or test.changes or test.time.size < 2 * _FEWEST:
        return None
    fresh = np.ones(test.time.size, dtype=bool) if test.used is None else test.used
    time, way, force = test.time[fresh], test.displacement[fresh], test.force[fresh]
    # where the file's own zero is the contact, all beyond it is the specimen's
    beyond = 0.0 if test.contact_sd is None else np.inf
    if not way[0] < beyond:
        return None
    peak = int(np.argmax(force))
    contact, line = find_contact(way, force), None
    for _ in range(_ROUNDS):
        if contact is None:  # it begins in contact
            return None
        limit = min(_limit(float(way[0]), contact), beyond)
        line = _line(time, way, force, peak, limit)
        if line is None or not _is_sure(*line):
            return None
        constants, _, _ = line
        contact = find_contact(way, force - constants @ [np.ones_like(way), way, time])
    if contact is None or line is None:
        return None
    constants, sds, back = line
    reach = constants[1] * (contact.position - way[0])
    change = float(reach + constants[2] * (time[contact.rows] - time[0])) / float(force.max())
    span = abs(constants[1]) * np.ptp(way) + abs(constants[2]) * np.ptp(time)
    if span < _MATTERS * float(force.max()) or not _is_sure(*line):
        return None
    return Slope(
        float(constants[0]), float(constants[1]), float(sds[1]), float(constants[2]),
        float(sds[2]), change, back, contact,
    )  # fmt: skip


def _is_sure(constants: Array, sds: Array, back: bool) -> bool:
    """Return whether a slope or a drift is there."""
    return bool(np.any(np.abs(constants[1:]) > (_SURE if back else _SURER) * sds[1:]))


def _limit(start: float, contact: FirstContact) -> float:
    """Return the displacement below which the platen is surely off the specimen."""
    way_in = contact.position - start
    return contact.position - max(_CLEAR * way_in, min(2.0 * contact.sd, 0.5 * way_in))


def _line(
    time: Array, way: Array, force: Array, peak: int, limit: float
) -> tuple[Array, Array, bool] | None:
    """Return level, slope and drift (3,) with their sds, and whether the way back shows them.

    None where the force off the specimen is no line, or hardly any reading shows it.
    """
    rows = np.arange(way.size)
    inward = np.flatnonzero((rows < peak) & (way < limit))
    outward = np.flatnonzero((rows > peak) & (way < limit))
    moving = inward.size >= _FEWEST and np.ptp(way[inward]) > 0.0
    if not moving:
        return None
    scatter = _scatter(force[inward])
    if outward.size < _BACK:
        return _fitted(time, way, force, inward, (1,), scatter, back=False)
    both = np.concatenate([inward, outward])
    for columns in ((1,), (2,), (1, 2)):
        found = _fitted(time, way, force, both, columns, scatter, back=True)
        if found is not None and not _turns(time, way, force, inward, outward, found[0]):
            return found
    return None


def _turns(
    time: Array,
    way: Array,
    force: Array,
    inward: NDArray[np.intp],
    outward: NDArray[np.intp],
    constants: Array,
) -> bool:
    """Return whether the force turns with the direction, as a drag and a guide that rubs do."""
    line = constants @ [np.ones_like(way), way, time]
    sides = [float(np.mean((force - line)[rows])) for rows in (inward, outward)]
    return abs(sides[1] - sides[0]) > _TURNS * float(np.ptp(line[np.append(inward, outward)]))


def _fitted(
    time: Array,
    way: Array,
    force: Array,
    rows: NDArray[np.intp],
    columns: tuple[int, ...],
    scatter: float,
    *,
    back: bool,
) -> tuple[Array, Array, bool] | None:
    """Return the line along displacement (1), time (2) or both; None where it does not fit."""
    every = np.stack([np.ones_like(way), way, time], axis=1)[rows]
    design = every[:, [0, *columns]]
    bent = np.column_stack([design, (way[rows] - np.mean(way[rows])) ** 2])
    size, sds, left = _least_squares(design, force[rows])
    bend, bend_sds, _ = _least_squares(bent, force[rows])
    if left > _AGREE * scatter or abs(bend[-1]) > _STRAIGHT * bend_sds[-1]:
        return None
    constants, errors = np.zeros(3), np.zeros(3)
    constants[[0, *columns]], errors[[0, *columns]] = size, sds
    return constants, errors, back


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


def _scatter(force: Array) -> float:
    """Return the sd of single readings, from their second differences."""
    return float(np.sqrt(np.mean(np.diff(force, 2) ** 2) / 6.0))


def _notice(pad: str, test: Test, slope: Slope, units: UnitSystem) -> str:
    unit, way = units.force, units.displacement
    parts = []
    if slope.along:
        parts.append(f"{plain(slope.along)} +- {plain(slope.along_sd, 2)} {unit}/{way}")
    if slope.drift:
        parts.append(f"{plain(slope.drift)} +- {plain(slope.drift_sd, 2)} {unit}/s")
    where = "on the way in and on the way back" if slope.seen_back else "on the way in"
    contact = slope.contact
    return (
        f"pad {pad}, test {test.name}: off the specimen the {units.force_name} changes by "
        f"{' and '.join(parts)} ({100.0 * abs(slope.change):.2g} % of the largest before contact), "
        f"{where}, as a tilt, a cable or a drift makes it; it is taken off all readings, and the "
        f"contact then lies {plain(contact.position)} +- {plain(contact.sd, 2)} {way} from the "
        "zero as it was read"
    )
