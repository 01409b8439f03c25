"""Judge readings: their units, clocks that slip, codes in place of numbers, wrong signs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.arrays import Mask
from qlvbayes.io.checks import InputError
from qlvbayes.io.recording import Channel, Recording, UnsureError
from qlvbayes.io.table import LARGEST_SHARE
from qlvbayes.io.units import QUANTITIES, STRAIN, Unit, UnitSystem, unit_of, unit_system

LEAST_SAMPLES = 10
"""Rows that a test has at least."""
LARGEST = 1e20
"""Largest number that is a reading of any channel, in any unit; beyond it is a code or an error."""
SMALLEST = 1e-30
"""Smallest share of a channel's largest reading: squares of smaller readings underflow."""
SHORTEST = 1e-9
"""Shortest duration (s) of a whole test: no channel is sampled as fast as that."""
_AROUND = 8  # steps on either side of a slip, from which the clock's step is taken
_EVEN = 0.2  # deviation from the median step, over it, up to which a step counts as even
_MOST_UNEVEN = 0.3  # share of these steps that may be uneven: the slip's own, and jitter
_LEFT = 2.5  # largest gap, in median steps, between the neighbours of a reading left out
_REPEATED = 0.2  # share of rows with the time of the row above, beyond which a clock is too coarse
_UNEVEN = 1.5  # ratio of the 95th to the 5th percentile of steps, beyond which they are uneven
_DIGITS = 1e-3  # of the largest value, in which readings may differ that are the same
_JUMP = 5.0  # times the record's largest step and speed, beyond which it does not move so
_ANSWER = 0.1  # share of the record's own stiffness, below which the force ignores the jump
_CODE = re.compile(r"-?(99+(\.9+)?|999\.25|32768|2147483648)")
"""Nines alone (-999, 9999.9), the code of well logs, and the last numbers of two and four bytes."""
_MOST_KINDS = 20  # different numbers checked, the farthest away first: a code is one number


# Clocks


def slipped(time: Floats) -> NDArray[np.intp] | None:
    """Return which stamps (k,) must go so that time increases, or None."""
    falls = np.flatnonzero(np.diff(time) <= 0.0) + 1
    if falls.size > LARGEST_SHARE * time.size:
        return None
    indices = [_slip(time, fall) for fall in falls.tolist()]
    known = [index for index in indices if index is not None]
    slips = np.unique(np.array(known, dtype=np.intp))
    risen = len(known) == len(indices) and np.all(np.diff(np.delete(time, slips)) > 0.0)
    return slips if risen else None


def _slip(time: Floats, fall: int) -> int | None:
    """Return the stamp at a fall, or the one before it, without which time goes on evenly."""
    around = np.diff(time[max(fall - 1 - _AROUND, 0) : fall + 1 + _AROUND])
    step = float(np.median(around))
    uneven = np.abs(around - step) > _EVEN * step
    if step <= 0.0 or np.mean(uneven) > _MOST_UNEVEN:
        return None
    for at in (fall, fall - 1):
        if at in (0, time.size - 1) or 0.0 < time[at + 1] - time[at - 1] <= _LEFT * step:
            return at
    return None


def rising(
    time: Floats, columns: list[Floats], dropped: dict[str, int], file: Path
) -> tuple[Floats, list[Floats]]:
    """Return the rows without repeated and slipped times, which are counted in ``dropped``.

    An InputError is raised where a clock cannot be put in order. Rows must not be sorted by a time
    that falls: those of two tests would be mixed.
    """
    steps = np.diff(time)
    slips = slipped(time) if (steps < 0).any() else None
    if slips is not None:
        dropped["rows whose time slipped"] = slips.size
        time, columns = np.delete(time, slips), [np.delete(column, slips) for column in columns]
        steps = np.diff(time)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0)) + 1
        raise InputError(
            f"time falls from {time[row - 1]:.6g} to {time[row]:.6g} s at row {row + 1}",
            file=file,
            remedy="if another test begins there, export each to a file of its own; if not, mend "
            "its clock",
        )
    same = np.append(False, steps == 0)
    count = int(np.count_nonzero(same))
    if count > _REPEATED * len(time):
        what = f"{count} of {len(time)} rows have the time of the row above"
        raise InputError(what, file=file, remedy="export with more decimals of time")
    if not count:
        return time, columns
    dropped["rows with the time of the row above"] = count
    return time[~same], [column[~same] for column in columns]


def starts_on_one_clock(times: Sequence[Floats]) -> list[float] | None:
    """Return when each test begins (s) where times run on from test to test, or None."""
    if len(times) < 2 or any(old[-1] >= new[0] for old, new in pairwise(times)):
        return None
    return [float(time[0] - times[0][0]) for time in times]


def on_one_clock(
    time: Floats, way: Floats, load_time: Floats, dropped: dict[str, int], file: Path
) -> tuple[Floats, slice]:
    """Return displacement at the force's times, and the rows of the force that it covers."""
    inside = np.flatnonzero((load_time >= time[0]) & (load_time <= time[-1]))
    if 2 * len(inside) < len(load_time):
        raise InputError(
            f"the two clocks do not overlap ({time[0]:.6g} to {time[-1]:.6g} s, "
            f"{load_time[0]:.6g} to {load_time[-1]:.6g} s)",
            file=file,
            remedy="export both with one clock",
        )
    kept = slice(int(inside[0]), int(inside[-1]) + 1)
    if lost := len(load_time) - len(inside):
        dropped["rows of the force outside the displacement's clock"] = lost
    return np.interp(load_time[kept], time, way), kept


@dataclass(frozen=True)
class Sampling:
    """Sampling of one test: number of rows, time step and missing samples.

    ``step``, ``low`` and ``high`` are the median step and its 5th and 95th percentile (s).
    ``lag`` is the delay of the force's clock behind the displacement's in the same row (s), where
    there are two.
    """

    rows: int
    step: float
    low: float
    high: float
    missing: int
    lag: float | None = None

    def describe(self) -> str:
        """Return the sampling as one line of text."""
        steps = f"{self.step:.4g} s a row" if self.high < _UNEVEN * self.low else (
            f"uneven, {self.low:.3g} to {self.high:.3g} s a row"
        )  # fmt: skip
        missing = f", {self.missing} samples missing in gaps" if self.missing else ""
        return f"{self.rows} rows, {steps}{missing}"


def sampling_of(time: Floats, lag: float | None = None) -> Sampling:
    """Return the sampling of a clock that rises."""
    steps = np.diff(time)
    step = float(np.median(steps))
    low, high = (float(x) for x in np.percentile(steps, (5, 95)))
    gaps = steps[steps > _UNEVEN * step] if high < _UNEVEN * low else steps[:0]
    return Sampling(len(time), step, low, high, int(np.sum(np.round(gaps / step) - 1.0)), lag)


# Numbers that are no readings


def no_readings(values: Floats, *, coded: bool = True) -> tuple[Mask, str]:
    """Return the rows (n,) whose number is not finite, too large to be measured, or a code.

    The codes are text for a message, as '-999 and -9999'; empty where no number stands there.
    """
    lost = ~(np.abs(values) < LARGEST)  # true of what is not finite too
    codes = set(values[lost & np.isfinite(values)].tolist())
    for code in _far_away(values[~lost]) if coded else ():
        here = values == code
        held = 2 * np.count_nonzero(here) > len(values)  # a step of 99 um, held
        if _CODE.fullmatch(f"{code:.12g}") and not held:  # rounding of a unit's factor is beyond
            codes.add(code)
            lost |= here
    return lost, " and ".join(f"{code:.12g}" for code in sorted(codes, key=abs)[:3])


def _far_away(values: Floats) -> list[float]:
    """Return numbers that lie off all others by more than these span, the farthest first."""
    distant: list[float] = []
    different = np.unique(values)
    while len(different) > 2 and len(distant) < _MOST_KINDS:
        low, high = float(different[1] - different[0]), float(different[-1] - different[-2])
        first = low > high
        rest = different[1:] if first else different[:-1]
        if max(low, high) <= float(rest[-1] - rest[0]):
            break
        distant.append(float(different[0] if first else different[-1]))
        different = rest
    return distant


def out_of_range(time: Floats, channels: dict[str, Floats]) -> str | None:
    """Return what no rig measures, as text; None where all numbers can be used."""
    if not SHORTEST <= float(time[-1] - time[0]) <= LARGEST:
        return f"the test lasts {float(time[-1] - time[0]):.3g} s"
    for name, values in channels.items():
        if (largest := float(np.abs(values).max())) < SMALLEST:
            return f"{name} is {largest:.3g} at most"
    return None


def same_readings(one: Floats, other: Floats) -> bool:
    """Return whether values are equal but for the digits in which their units were written."""
    size = max(float(np.abs(one).max()), float(np.abs(other).max()))
    return bool(np.abs(one - other).max() <= _DIGITS * size)


def unread_rows(time: Floats, way: Floats, load: Floats) -> int:
    """Return how many rows at the beginning a logger wrote before it read: both are exactly 0."""
    zero = (way == 0.0) & (load == 0.0)
    first = int(np.argmin(zero))
    moved = way[first:]
    if not zero[0] or len(moved) < LEAST_SAMPLES:
        return 0
    steps, spent = np.abs(np.diff(moved)), np.diff(time[first:])
    passed = float(time[first] - time[first - 1])
    jump, span = abs(float(moved[0])), float(np.ptp(moved))
    if passed <= 0.0 or not (rising := spent > 0.0).any():
        return 0
    speed = float((steps[rising] / spent[rising]).max())
    # the rest must be a motion in steps, of which the jump is none, and the force ignores it
    gradual = span > 3.0 * float(steps.max())
    sudden = jump > _JUMP * float(steps.max()) and jump / passed > _JUMP * speed
    ignored = abs(float(load[first])) * span < _ANSWER * float(np.ptp(load[first:])) * jump
    return first if gradual and sudden and ignored else 0


def wrong_signs(displacement: Floats, force: Floats) -> tuple[str, ...]:
    """Return which of displacement and force decrease in the first loading, if that is clear."""
    away = np.abs(displacement - displacement[0])
    end = int(np.argmax(away >= 0.95 * away.max())) + 1
    d, f = displacement[:end], force[:end]
    small = away.max() <= 0.05 * np.abs(displacement).max()
    if small or d.min() == d.max() or f.min() == f.max():
        return ()
    along = float(np.corrcoef(d, f)[0, 1])
    grows = bool(d[-1] > d[0])
    low, high = float(force.min()), float(force.max())
    pulled, pressed = high <= -0.2 * low, low >= -0.2 * high
    if grows and along < -0.8 and pulled:
        return ("force",)
    if not grows and along < -0.8 and pressed and abs(f[0]) < 0.2 * high:
        return ("displacement",)
    below = displacement.max() <= -0.05 * displacement.min()
    if not grows and along > 0.8 and pulled and below:
        return "displacement", "force"
    return ()


# Units


def in_tidy_units(
    file: Path, recording: Recording, stated: Sequence[str] | None, area: float | None
) -> tuple[UnitSystem, list[Floats], str]:
    """Return units, columns in them and a finding: time, way, load, and the load's own clock.

    ``stated`` are the units of time, displacement and force that the user states, and ``area`` the
    specimen's (mm2), which makes stress of a force that stands beside a strain.
    """
    given: Sequence[str | None] = stated or (None, None, None)
    said_of = dict(zip(recording.channels, (*given, given[0]), strict=False))
    units = [_unit(file, channel, said) for channel, said in said_of.items()]
    clock = {"ms": 1e-3, "min": 60.0}
    factors = [unit.factor * clock.get(unit.tidy, 1.0) for unit in units]
    columns = [
        channel.values * factor if factor != 1.0 else channel.values
        for channel, factor in zip(said_of, factors, strict=True)
    ]
    way, load, columns[2] = _with_area(file, units[1], units[2], columns[2], area)
    written = [
        f"{c.name} in {c.unit if _meant(c.unit, c) else f'{said} (as stated by the user)'}"
        for c, said in said_of.items()
    ]
    system = unit_system(way.tidy or STRAIN.displacement, load.tidy)
    return (
        system,
        columns,
        f"{', '.join(written[:3])}; written as {way.tidy or '1'} and {load.tidy}",
    )


def _meant(text: str | None, channel: Channel) -> Unit | None:
    """Return the unit that a text means for a channel: a strain may be called displacement."""
    either = next((both for both in QUANTITIES if channel.quantity == both[0]), (channel.quantity,))
    units = [unit_of(text, quantity) for quantity in either] if text else []
    return next((unit for unit in units if unit is not None), None)


def _unit(file: Path, channel: Channel, stated: str | None) -> Unit:
    """Return the unit of a channel, as the file or the user states it; both must agree."""
    own, said = _meant(channel.unit, channel), _meant(stated, channel)
    if own is None and channel.quantity != "time":
        others = (kind for both in QUANTITIES[1:] for kind in both)
        if of_other := next((kind for kind in others if unit_of(channel.unit, kind)), None):
            what = f"'{channel.name}' is taken as the {channel.quantity}, but {channel.unit} is a "
            remedy = "name the columns of --columns in the order time, displacement, force"
            raise InputError(f"{what}unit of {of_other}", file=file, remedy=remedy)
    if own is not None and stated is not None and own != said:
        what = f"'{channel.name}' is in {channel.unit}, and --units says {stated}"
        raise InputError(what, file=file, remedy="leave --units out")
    if (unit := own or said) is not None:
        return unit
    written = f"the unit '{channel.unit}'" if channel.unit else "no unit"
    raise UnsureError(
        f"the column '{channel.name}' ({channel.quantity}) has {written}",
        file=file,
        option="units",
        question="units of time, displacement and force, as s,mm,N",
        say="s,mm,N",
    )


def _with_area(
    file: Path, way: Unit, load: Unit, values: Floats, area: float | None
) -> tuple[Unit, Unit, Floats]:
    """Return stress with strain, or force with displacement."""
    strained, stressed = way.quantity == "strain", load.quantity == "stress"
    if strained == stressed:
        return way, load, values
    if area is None:
        wanted = "stress" if strained else "force"
        raise UnsureError(
            f"the file has {way.quantity} and {load.quantity}, and no area to make {wanted} of it",
            file=file,
            option="area",
            question="area of the specimen in mm2",
            say="MM2",
        )
    if strained:
        newtons = UnitSystem("mm", load.tidy).factor_to(UnitSystem("mm", "N"), "force")
        return way, Unit("stress", "kPa"), values * (1e3 * newtons / area)
    megapascals = UnitSystem("1", load.tidy).factor_to(UnitSystem("1", "MPa"), "force")
    return way, Unit("force", "N"), values * (megapascals * area)  # 1 MPa is 1 N/mm2
