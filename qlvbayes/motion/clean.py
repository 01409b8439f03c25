"""Readings that are none: lost, spikes, stuck, clipped, or of a clock that slipped.

What its neighbours on both sides contradict and the other channel does not show is no reading of
the specimen. It is detected before the record is used, in medians and differences of
neighbours alone, O(n), and without a model of the material. Where the platen goes the force
follows, and the force changes where the platen went: what the other channel bears out is the
specimen's, however sudden.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Test
from qlvbayes.io.readings import slipped
from qlvbayes.io.table import LARGEST_SHARE
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import joined
from qlvbayes.motion.outliers import (
    FEWEST,
    ChangeScale,
    Rows,
    Run,
    distance,
    equal_runs,
    mask_of,
    outlying,
    outlying_runs,
    runs_at_ends,
    runs_of,
)

KEEP = "--keep-all-readings"
_STIFFER = 5.0  # than the record's secant a specimen may be at its stiffest,
_LEAVES = 2.0  # and of what it loses with contact: all that it bore
_FOLLOWED = 0.25  # of a change of force that would be seen: so much shows at the least
_BENDS = 8  # readings on either side in which a change of speed makes an inertial force
_IMPOSSIBLE = 5.0  # times the largest speed otherwise seen: no platen is so fast
_AROUND = 60  # readings on either side that say how often a value repeats by chance
_CHANCE = 1e-9  # probability of such a run anywhere in the record
_REPEATING = 0.3  # of the readings around: a channel that repeats more often is coarse or silent
_ALTERNATING = 0.4  # of the changes of slope: noise changes sign, a curve does not
_NEAR_ZERO = 0.02  # of the range: a force that says there is no contact, as a test's first one may
_CATCHES_UP = 3.5  # times the median change: the jump of a channel that was stuck
_NAMED = 3  # times of a group that are named
_DRAWN = 50  # readings of a run that a user leaves out, which may be any number
Reasons = NDArray[np.object_]
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six")


@dataclass(frozen=True, eq=False)
class UnusedReadings:
    """The readings of one test of n readings that are left out, bad ones and excluded ones."""

    mask: NDArray[np.bool_]  # (n,) True for them
    # time, displacement, force: (k,) of these, as they were read
    time: Array
    displacement: Array
    force: Array
    # (k,) why: kind and channel, as "lost displacement", or "excluded" and what says so
    reason: NDArray[np.str_]

    @classmethod
    def of(cls, test: Test, reasons: Reasons) -> UnusedReadings | None:
        """Return the readings of a test for which there is a reason (n,); None without any."""
        mask = reasons != ""
        if not mask.any():
            return None
        time, way, force = (x[mask] for x in (test.time, test.displacement, test.force))
        return cls(mask, time, way, force, reasons[mask].astype(np.str_))

    @property
    def count(self) -> int:
        """Number of readings."""
        return self.time.size

    @property
    def excluded(self) -> NDArray[np.bool_]:
        """Which of them (k,) the user leaves out."""
        return np.char.startswith(self.reason, "excluded")

    @property
    def drawn(self) -> Rows:
        """Indices of those that figures show: bad ones, and a few of each run of excluded ones."""
        excluded, rows = self.excluded, np.arange(self.count)
        runs = [run for reason in dict.fromkeys(self.reason) for run in self.runs(reason)]
        few = [x[:: -(-x.size // _DRAWN) if excluded[x[0]] else 1] for x in runs]
        return rows[np.isin(rows, np.concatenate(few))]

    def runs(self, reason: str) -> list[Rows]:
        """Return the indices of those of one reason, of each run between readings that count."""
        rows = np.flatnonzero(self.reason == reason)
        counted_before = np.flatnonzero(self.mask)[rows] - rows
        return np.split(rows, np.flatnonzero(np.diff(counted_before)) + 1)


def left_out_notice(
    pad: str, tests: Sequence[tuple[Test, UnusedReadings | None]], units: UnitSystem
) -> tuple[str, ...]:
    """Return one sentence on the bad readings beside the tests without them; none without any."""
    known = [(test, bad) for test, bad in tests if bad is not None and not bad.excluded.all()]
    if not known:
        return ()
    parts = [f"test {test.name}: {', '.join(_groups(test, bad, units))}" for test, bad in known]
    count = sum(int(np.count_nonzero(~bad.excluded)) for _, bad in known)
    return (
        f"pad {pad}: {'; '.join(parts)}; {_readings(count)} {'is' if count == 1 else 'are'} left "
        "out, as the neighbours on both sides contradict what the other channel does not show "
        f"({KEEP} keeps all)",
    )


def _groups(test: Test, bad: UnusedReadings, units: UnitSystem) -> Iterator[str]:
    """Yield number, times and first value of the bad readings of each channel and kind."""
    channels = {
        "displacement": (units.displacement_name, units.displacement),
        "force": (units.force_name, units.force),
    }
    reasons = {tuple(reason.split(" ")[::-1]) for reason in bad.reason[~bad.excluded].tolist()}
    for channel, kind in sorted(reasons):
        runs = bad.runs(f"{kind} {channel}")
        first, count = runs[0][0], sum(run.size for run in runs)
        own = [name for name in channels if channel in (name, "both")]
        of_first = [f"{getattr(bad, name)[first]:.3g} {channels[name][1]}" for name in own]
        what = " and ".join(of_first)
        if kind in ("clock", "stuck", "clipped"):
            what = f"{kind} at {what}" if own else "the clock slips"
        elif len(own) == 1:
            after = int(np.searchsorted(test.time, bad.time[first]))
            sides = getattr(test, channel)[max(after - 1, 0) : after + 1]
            level = dict.fromkeys(f"{x:.3g}" for x in sides)
            what += f" amid {' and '.join(level)} {channels[channel][1]}"
        name = " and ".join(channels[name][0] for name in own) or "time"
        times = [f"{bad.time[run[0]]:.6g}" for run in runs[:_NAMED]]
        more = len(runs) - _NAMED
        when = joined([*times, f"{more} other times (s)"]) if more > 0 else f"{joined(times)} s"
        yield f"{_readings(count)} of {name} at {when} ({what})"


def _readings(count: int) -> str:
    number = _NUMBERS[count] if count < len(_NUMBERS) else str(count)
    return f"{number} reading{'' if count == 1 else 's'}"


def sound_tests(
    tests: Sequence[Test], *, keep_all: bool = False, limited: bool = True
) -> list[tuple[Test, Reasons]]:
    """Return each test without its bad readings, and why each of all is bad, "" where it is not.

    Raises InputError where they are too many, and ``limited``, or where none is to be left out and
    a reading has no time.
    """
    clocks = [slipped(test.time) for test in tests]
    if keep_all:
        for test, slips in zip(tests, clocks, strict=True):
            if slips is not None and not slips.size:
                continue
            at = np.argmax(np.diff(test.time) <= 0.0) + 1 if slips is None else slips[0]
            raise InputError(
                f"the clock slips at {test.time[at]:.6g} s in test {test.name} of pad {test.pad}, "
                "and a reading without a time cannot be kept",
                remedy=f"delete its row, or leave out {KEEP}",
            )
        return [(test, np.full(test.time.size, "", dtype=object)) for test in tests]
    channels = [_Channels(test, slips) for test, slips in zip(tests, clocks, strict=True)]
    top = max((one.fastest for one in channels), default=0.0)
    cleaned = []
    for test, own in zip(tests, channels, strict=True):
        reasons = own.reasons(top)
        bad = reasons != ""
        if limited and np.count_nonzero(bad) > LARGEST_SHARE * bad.size:
            raise InputError(
                f"{np.count_nonzero(bad)} of {bad.size} readings of test {test.name} of pad "
                f"{test.pad} are bad ({', '.join(dict.fromkeys(reasons[bad]))}), the first at "
                f"{test.time[bad][0]:.6g} s: too many to leave out",
                remedy="mend the channel, delete the test, leave the time out with --leave-out, "
                f"or keep them with {KEEP}",
            )
        cleaned.append((without(test, bad) if bad.any() else test, reasons))
    return cleaned


def smooth_readings(test: Test) -> Test:
    """Return a test without readings that either channel marks as outlying."""
    return without(test, outlying(test.time, test.displacement) | outlying(test.time, test.force))


def without(test: Test, mask: NDArray[np.bool_]) -> Test:
    """Return a test without some of its readings; the times of the others do not change."""
    names = ("time", "displacement", "force", "force_sd", "used", "anew")
    every = ((name, getattr(test, name)) for name in names)
    sound: dict[str, Any] = {name: None if x is None else x[~mask] for name, x in every}
    late = max(float(sound["time"][0] - test.time[0]), 0.0)
    return replace(test, **sound, start_s=test.start_s + late)


class _Channels:
    """Both channels of a test, of the readings whose clock ticks; each is held against the other.

    Where the force of some readings is not used, it is interpolated between those that are.
    """

    def __init__(self, test: Test, slips: Rows | None) -> None:
        self.size = test.time.size
        self.slips = np.zeros(0, dtype=np.intp) if slips is None else slips
        self.ticking = np.delete(np.arange(self.size), self.slips)
        channels = test.time, test.displacement, test.force
        self.time, self.way, force = (x[self.ticking] for x in channels)
        every = np.arange(self.time.size)
        self.used = every if test.used is None else np.flatnonzero(test.used[self.ticking])
        self.fastest = 0.0
        if self.used.size < FEWEST:
            return
        self.read = force[self.used]
        self.force = np.interp(self.time, self.time[self.used], self.read)
        self.of_way = ChangeScale.of(self.time, self.way)
        self.of_read = ChangeScale.of(self.time[self.used], self.read)
        nearest = np.interp(every, self.used, np.arange(self.used.size)).round().astype(int)
        self.of_force = self.of_read.at(nearest)
        self.way_runs = outlying_runs(self.time, self.way, self.of_way)
        # of the readings used, as their neighbours are
        self.force_runs = outlying_runs(self.time[self.used], self.read, self.of_read)
        self.force_rows = mask_of(_in_all(self.used, self.force_runs), self.time.size)
        doubtful = mask_of(self.way_runs, self.time.size) | self.force_rows
        self.sound = np.flatnonzero(~doubtful)
        self.sound_used = self.used[~doubtful[self.used]]
        self.lost = np.zeros(self.time.size, dtype=bool)
        t, x = self.time[self.sound], self.way[self.sound]
        self.fastest = float(np.max(np.abs(np.diff(x)) / np.diff(t), initial=0.0))
        self.stiffness = self.of_force.span / self.of_way.span if self.of_way.span else 0.0

    def reasons(self, top: float) -> Reasons:
        """Return why each reading (n,) is bad, "" where it is not; top: the pad's largest speed."""
        reasons = np.full(self.size, "", dtype=object)
        if self.used.size >= FEWEST:
            own = np.full(self.time.size, "", dtype=object)
            for run, kind, channel in self._bad(top):
                if not (own[slice(*run)] != "").any():
                    own[slice(*run)] = f"{kind} {channel}"
            reasons[self.ticking] = own
        reasons[self.slips] = "clock time"
        return reasons

    def _bad(self, top: float) -> Iterator[tuple[Run, str, str]]:
        rows = [run for run in self.way_runs if self._is_lost_row(run)]
        alone = [*self.way_runs, *runs_at_ends(self.way, self.of_way)]
        for channel, runs in (("both", rows), ("displacement", alone)):
            for run in runs:
                if channel == "both" or self._way_contradicted(run, top):
                    self.lost[slice(*run)] = True
                    yield run, _kind(self.way[slice(*run)]), channel
        for run in filter(self._force_contradicted, self.force_runs):
            for part in _in_all(self.used, [run]):
                yield part, _kind(self.read[slice(*run)]), "force"
        present = np.flatnonzero(~self.lost)  # a lost reading is no jump that ends a dwell
        for part in _in_all(present, self._stuck_way(present)):
            yield part, "stuck", "displacement"
        for run, kind in self._stuck_force():
            for part in _in_all(self.used, [run]):
                yield part, kind, "force"

    def _sides(self, run: Run) -> list[int]:
        """Return the sound readings before and after a run; at the record's end one twice."""
        return _around(self.sound[(self.sound < run[0]) | (self.sound >= run[1])], run[0])

    def _is_lost_row(self, run: Run) -> bool:
        """Return whether both channels read 0 although the platen cannot have moved that far."""
        nothing = self.force_rows & (self.way == 0.0) & (self.force == 0.0)
        return bool(nothing[slice(*run)].all()) and self._speed(run) > _IMPOSSIBLE * self.fastest

    def _speed(self, run: Run) -> float:
        """Return the lowest speed with which the platen could have made the excursion."""
        ends, sides = [run[0], run[1] - 1], self._sides(run)
        way, time = (x[ends] - x[sides] for x in (self.way, self.time))
        return float(np.min(np.abs(way / time)))

    def _way_contradicted(self, run: Run, top: float) -> bool:
        """Return whether the force shows no sign of the displacement readings of a run."""
        sides, inside = self._sides(run), slice(*run)
        one, other = self.way[sides].tolist()
        off = float(distance(self.way[inside], one, other).min())
        expected = self.stiffness * off
        if abs(float(self.way[run[0]])) < min(abs(one), abs(other)):  # back towards 0
            expected = min(expected, *np.abs(self.force[sides]).tolist())
        if expected > self.of_force.noise(run[0]):
            line = np.interp(self.time[inside], self.time[sides], self.force[sides])
            seen = np.abs(self.force[inside] - line)
            return bool(max(seen[0], seen[-1], np.median(seen)) < _FOLLOWED * expected)
        # it comes back so exactly as a channel does that never left
        return abs(other - one) < 0.1 * off and self._speed(run) > _IMPOSSIBLE * top

    def _force_contradicted(self, run: Run) -> bool:
        """Return whether no motion of the platen explains the force of a run of those used."""
        first = self.used[run[0]]
        lost = not self.read[slice(*run)].any()
        step = self.of_way.step if self.of_way.step < 0.02 * self.of_way.span else 0.0
        flicker = 1.01 * step + 4.0 * float(self.of_way.deviation[first])
        if not lost and self._deflection(self._near(run, _BENDS)) > max(
            2.5 * flicker, 4.0 * self._typical_deflection()
        ):
            return False
        near = self.way[self._near(run, 2)]
        travel = float(np.ptp(near)) if near.size else 0.0
        moved = travel if travel > flicker else 0.0
        off = distance(self.read[slice(*run)], *self.force[_around(self.sound_used, first)])
        return float(off.min()) > (_LEAVES if lost else _STIFFER) * self.stiffness * moved

    def _near(self, run: Run, reach: int) -> Rows:
        """Return the readings in and around a run of those used whose displacement counts."""
        rows = self.used[max(run[0] - reach, 0) : run[1] + reach]
        return rows[~self.lost[rows]]

    def _typical_deflection(self) -> float:
        """Return the median deviation from a straight line, over all stretches of this length."""
        sound, width = self.sound_used, 2 * _BENDS + 1
        if sound.size < 2 * width:
            return 0.0
        starts = np.unique(np.linspace(0, sound.size - width, 60).astype(int))
        return float(np.median([self._deflection(sound[k : k + width]) for k in starts]))

    def _deflection(self, rows: Rows) -> float:
        """Return the largest deviation of displacements from the line between their ends."""
        if rows.size < 3:
            return 0.0
        ends = rows[[0, -1]]
        line = np.interp(self.time[rows], self.time[ends], self.way[ends])
        return float(np.max(np.abs(self.way[rows] - line)))

    def _stuck_way(self, rows: Rows) -> Iterator[Run]:
        """Yield runs in which the displacement stays, while the force goes on, and then jumps."""
        time, way, force = self.time[rows], self.way[rows], self.force[rows]
        changes = np.abs(np.diff(way))
        for first, stop in equal_runs(way, 3):
            if stop == way.size or first < 2:
                continue
            near = np.append(changes[max(first - 10, 0) : first], changes[stop : stop + 10])
            typical = float(np.median(near[near > 0.0])) if near.any() else np.inf
            jump = way[stop] - way[stop - 1]
            if abs(jump) <= _CATCHES_UP * max(typical, self.of_way.step):
                continue
            # as far as the motion goes at the speed before or after the run
            ends = (max(first - 5, 0), first), (stop, min(stop + 5, way.size - 1))
            ways = [
                (time[stop] - time[first]) * (way[b] - way[a]) / (time[b] - time[a])
                for a, b in ends
                if b > a
            ]
            if not any(go != 0.0 and 0.4 < jump / go < 2.5 for go in ways):
                continue
            whole, last = abs(force[stop] - force[first]), abs(force[stop] - force[stop - 1])
            if whole > self.of_force.noise(int(rows[first])) and last < 0.5 * whole:
                yield first + 1, stop

    def _stuck_force(self) -> Iterator[tuple[Run, str]]:
        """Yield runs of the force read that noise as around them would change, stuck or clipped."""
        force, scale = self.read, self.of_read
        away = np.minimum(np.abs(force), np.abs(force - force[0])) > _NEAR_ZERO * scale.span
        rarest = np.log(_CHANCE / force.size) / np.log(0.5 / _AROUND)
        ends, clips = {float(force.min()), float(force.max())}, set[float]()
        for run in equal_runs(force, max(4, int(np.ceil(rarest)))):
            if not (away[run[0]] and scale.deviation[run[0]] >= scale.step):
                continue
            if _against_noise(force, run):
                level = float(force[run[0]])
                if level not in ends:
                    yield (run[0] + 1, run[1]), "stuck"
                elif level not in clips:
                    clips.add(level)
                    for clipped in runs_of(force == level):
                        yield clipped, "clipped"


def _against_noise(force: Array, run: Run) -> bool:
    """Return whether a run of one value is improbable, by how often values repeat around it."""
    sides = force[max(run[0] - _AROUND, 0) : run[0]], force[run[1] : run[1] + _AROUND]
    changes = np.concatenate([np.diff(side) for side in sides])
    if changes.size < _AROUND // 2:
        return False
    bends = [np.sign(np.diff(side, n=2)) for side in sides]
    turns = np.concatenate([bend[1:] * bend[:-1] < 0.0 for bend in bends])
    repeating = float(np.mean(changes == 0.0))
    if repeating > _REPEATING or np.mean(turns) < _ALTERNATING:
        return False
    chance = max(repeating, 1.0 / changes.size)
    return bool(force.size * chance ** (run[1] - run[0] - 1) < _CHANCE)


def _kind(values: Array) -> str:
    """Return the kind of a run: lost readings are zeros or repeat a value, spikes differ."""
    return "lost" if not values.any() or (values.size > 2 and np.ptp(values) == 0.0) else "spike"


def _in_all(rows: Rows, runs: Iterable[Run]) -> list[Run]:
    """Return runs of some of the readings, in order, as runs of all."""
    parts = []
    for some in (rows[slice(*run)] for run in runs):
        parts += np.split(some, np.flatnonzero(np.diff(some) > 1) + 1)
    return [(int(part[0]), int(part[-1]) + 1) for part in parts]


def _around(sound: Rows, first: int) -> list[int]:
    """Return the sound readings before and after a run that begins at ``first``."""
    after = int(np.searchsorted(sound, first))
    return [int(sound[max(after - 1, 0)]), int(sound[min(after, sound.size - 1)])]
