"""Detection of the bad readings of a pad's tests, and the tests without them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Test
from qlvbayes.io.readings import slipped
from qlvbayes.io.table import LARGEST_SHARE
from qlvbayes.motion.badreadings.channels import Channels, fastest
from qlvbayes.motion.badreadings.outliers import (
    FEWEST,
    Run,
    outlying,
    outlying_runs,
    runs_at_ends,
    scale_of,
)
from qlvbayes.motion.badreadings.result import Bad, BadReadings, Kind
from qlvbayes.motion.badreadings.stuck import clipped_force, stuck_displacement, stuck_force

KEEP = "--keep-all-readings"


def sound_tests(
    tests: Sequence[Test], *, keep_all: bool = False, limited: bool = True
) -> list[tuple[Test, BadReadings | None]]:
    """Return each test without its bad readings, and the bad readings (None if there are none)."""
    clocks = [slipped(test.time) for test in tests]
    ticking = [
        np.delete(np.arange(test.time.size), [] if slips is None else slips)
        for test, slips in zip(tests, clocks, strict=True)
    ]
    if keep_all:
        for test, slips in zip(tests, clocks, strict=True):
            if slips is None or slips.size:
                _refuse_clock(test, slips)
        return [(test, None) for test in tests]
    cleaned: list[tuple[Test, BadReadings | None]] = []
    candidates = [
        _OutlyingReadings(test, indices) for test, indices in zip(tests, ticking, strict=True)
    ]
    top = max((one.fastest for one in candidates), default=0.0)
    for test, slips, candidate in zip(tests, clocks, candidates, strict=True):
        runs = [] if slips is None else [Bad(k, k + 1, "time", "clock") for k in slips.tolist()]
        bad = BadReadings.from_runs(
            test.time, test.displacement, test.force, [*runs, *candidate.settled(top)]
        )
        if limited and bad.count > LARGEST_SHARE * test.time.size:
            _refuse(test, bad)
        cleaned.append((without(test, bad.mask), bad) if bad.count else (test, None))
    return cleaned


def smooth_readings(test: Test) -> Test:
    """Return a test without readings that either channel marks as outlying."""
    return without(test, outlying(test.time, test.displacement) | outlying(test.time, test.force))


def without(test: Test, mask: NDArray[np.bool_]) -> Test:
    """Return a test without some of its readings; the times of the others do not change."""
    sound = ~mask
    time = test.time[sound]
    return replace(
        test,
        time=time,
        displacement=test.displacement[sound],
        force=test.force[sound],
        force_sd=None if test.force_sd is None else test.force_sd[sound],
        used=None if test.used is None else test.used[sound],
        anew=None if test.anew is None else test.anew[sound],
        start_s=test.start_s + max(float(time[0] - test.time[0]), 0.0),
    )


class _OutlyingReadings:
    """The readings of each channel of a test that are outlying within that channel alone."""

    def __init__(self, test: Test, ticking: NDArray[np.intp]) -> None:
        self.ticking = ticking  # of the readings whose clock ticks
        self.time, self.displacement = (x[ticking] for x in (test.time, test.displacement))
        used = np.ones(ticking.size, dtype=bool) if test.used is None else test.used[ticking]
        self.used = np.flatnonzero(used)  # of these, the ones whose force counts
        self.few = self.used.size < FEWEST
        self.runs: dict[str, list[Run]] = {"displacement": [], "force": []}
        self.fastest = 0.0
        if self.few:
            return
        times, forces = self.time[used], test.force[ticking][used]
        self.of_displacement = scale_of(self.time, self.displacement)
        self.force, self.of_force = forces, (of_used := scale_of(times, forces))
        self.all_used = bool(used.all())
        if not self.all_used:
            self.force = np.interp(self.time, times, forces)
            self.of_force = of_used.at(_nearest(self.used, ticking.size))
        self.runs = {
            "displacement": outlying_runs(self.time, self.displacement, self.of_displacement),
            "force": outlying_runs(times, forces, of_used),  # counted among those used
        }
        self.doubtful = np.zeros(self.time.size, dtype=bool)
        for run in self.runs["displacement"]:
            self.doubtful[slice(*run)] = True
        for run in self.runs["force"]:
            self.doubtful[self.used[slice(*run)]] = True
        self.fastest = fastest(self.time, self.displacement, ~self.doubtful)

    def settled(self, top: float) -> list[Bad]:
        """Return the bad readings by their index in the test; top: the pad's largest speed."""
        if self.few:
            return []
        own = Channels(
            self.time, self.displacement, self.force, self.of_displacement, self.of_force,
            self.doubtful, top, np.zeros(self.time.size, dtype=bool),
        )  # fmt: skip
        proven = self._rows(own)
        proven += [
            Bad(*run, "displacement", _kind(self.displacement[slice(*run)]))
            for run in self.runs["displacement"]
            if own.displacement_contradicted(run)
        ]
        proven += [
            Bad(*run, "displacement", _kind(self.displacement[slice(*run)]))
            for run in runs_at_ends(self.displacement, self.of_displacement)
            if own.displacement_contradicted(run)
        ]
        for bad in proven:
            own.lost[bad.first : bad.stop] = True
        read = own if self.all_used else own.at(self.used)
        forces = [
            Bad(*run, "force", _kind(read.force[slice(*run)]))
            for run in self.runs["force"]
            if read.force_contradicted(run)
        ]
        proven += _among_all(forces, self.used)
        present = np.flatnonzero(~own.lost)  # a lost reading is no jump that ends a dwell
        proven += _among_all(stuck_displacement(own.at(present)), present)
        proven += _among_all([*stuck_force(read), *clipped_force(read)], self.used)
        return [self._located(bad) for bad in _separate(proven)]

    def _rows(self, own: Channels) -> list[Bad]:
        """Return rows in which both channels are outlying and that the platen could not reach."""
        both = [set(range(*run)) for run in self.runs["displacement"]]
        forces = {k for run in self.runs["force"] for k in self.used[slice(*run)].tolist()}
        bad = []
        for rows in both:
            shared = rows & forces
            if shared != rows:
                continue
            run = (min(rows), max(rows) + 1)
            if own.row_contradicted(run, self.fastest):
                kind = _kind(self.displacement[slice(*run)])
                bad.append(Bad(*run, "both", kind))
        return bad

    def _located(self, bad: Bad) -> Bad:
        ticking = self.ticking
        return replace(bad, first=int(ticking[bad.first]), stop=int(ticking[bad.stop - 1]) + 1)


def _among_all(runs: Iterable[Bad], some: NDArray[np.intp]) -> Iterator[Bad]:
    """Yield runs of some of the readings (k,), in order, as runs of all readings."""
    for bad in runs:
        indices = some[bad.first : bad.stop]
        for part in np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1):
            yield replace(bad, first=int(part[0]), stop=int(part[-1]) + 1)


def _nearest(some: NDArray[np.intp], size: int) -> NDArray[np.intp]:
    """Return for each of ``size`` readings which of some (k,), in order, is nearest."""
    every = np.arange(size)
    after = np.clip(np.searchsorted(some, every), 1, some.size - 1)
    return np.asarray(after - (every - some[after - 1] < some[after] - every))


def _kind(values: Array) -> Kind:
    """Return the kind of a run: lost readings are zeros or repeat a value, spikes differ."""
    return "lost" if not values.any() or (values.size > 2 and np.ptp(values) == 0.0) else "spike"


def _separate(runs: list[Bad]) -> list[Bad]:
    """Return the runs without those that overlap an earlier one."""
    kept: list[Bad] = []
    for bad in runs:
        if all(bad.stop <= one.first or bad.first >= one.stop for one in kept):
            kept.append(bad)
    return kept


def _refuse(test: Test, bad: BadReadings) -> None:
    kinds = ", ".join(dict.fromkeys(bad.kinds))
    channels = ", ".join(dict.fromkeys(bad.channels))
    raise InputError(
        f"{bad.count} of {bad.mask.size} readings of test {test.name} of pad {test.pad} are bad "
        f"({channels}: {kinds}), the first at {bad.time[0]:.6g} s: too many to leave out",
        remedy=f"mend the channel, delete the test, or keep them with {KEEP}",
    )


def _refuse_clock(test: Test, slips: NDArray[np.intp] | None) -> None:
    at = int(np.argmax(np.diff(test.time) <= 0.0)) + 1 if slips is None else int(slips[0])
    raise InputError(
        f"the clock slips at {test.time[at]:.6g} s in test {test.name} of pad {test.pad}, and a "
        "reading without a time cannot be kept",
        remedy=f"delete its row, or leave out {KEEP}",
    )
