"""The readings of a test that are left out: which, why, and a sentence on the bad ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.io.units import UnitSystem

Channel = Literal["time", "displacement", "force", "both"]
Kind = Literal["lost", "spike", "stuck", "clipped", "clock", "excluded"]

_NAMED = 3  # times of a group that are named
_DRAWN = 50  # readings of a run that the user excludes, which may be any number
_NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}
_CHANNELS = {"time": "time", "both": "displacement and force"}


@dataclass(frozen=True)
class Bad:
    """Readings [first, stop) of a test that are left out together, in one channel or in both."""

    first: int
    stop: int
    channel: Channel
    kind: Kind
    stated_by: str = ""  # option or column by which the user excludes them


@dataclass(frozen=True, eq=False)
class BadReadings:
    """The readings of one test of n readings that are left out: bad ones, and excluded ones."""

    # time, displacement, force: (k,) of these, as they were read
    time: Array
    displacement: Array
    force: Array
    runs: tuple[Bad, ...]  # which they are and why
    mask: NDArray[np.bool_]  # (n,) True for them
    # of each run the displacement and the force of the sound readings before and after it (NaN
    # where there is none)
    around: tuple[tuple[Array, Array], ...]

    @classmethod
    def from_runs(
        cls, time: Array, displacement: Array, force: Array, runs: list[Bad]
    ) -> BadReadings:
        """Collect the readings of some runs."""
        runs = sorted(runs, key=lambda run: (run.first, run.stop))
        mask = np.zeros(time.size, dtype=bool)
        for run in runs:
            mask[run.first : run.stop] = True
        around = []
        for run in runs:
            sides = neighbours(mask, run.first, run.stop)
            around.append(
                tuple(
                    np.array([np.nan if k is None else values[k] for k in sides])
                    for values in (displacement, force)
                )
            )
        return cls(
            time[mask], displacement[mask], force[mask], tuple(runs), mask,
            tuple((d, f) for d, f in around),
        )  # fmt: skip

    @property
    def count(self) -> int:
        """Number of readings."""
        return int(np.count_nonzero(self.mask))

    @property
    def bad(self) -> int:
        """Number of readings that are bad, and not excluded by the user."""
        return sum(run.stop - run.first for run in self.runs if run.kind != "excluded")

    @property
    def drawn(self) -> list[tuple[int, Bad]]:
        """Index in ``time`` of each reading that figures show, with its run."""
        shown, begin = [], 0
        for run in self.runs:
            size = run.stop - run.first
            every = max(-(-size // _DRAWN), 1) if run.kind == "excluded" else 1
            shown += [(begin + k, run) for k in range(0, size, every)]
            begin += size
        return shown

    @property
    def channels(self) -> tuple[str, ...]:
        """Channel of each run."""
        return tuple(run.channel for run in self.runs)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each run."""
        return tuple(run.kind for run in self.runs)


def neighbours(mask: NDArray[np.bool_], first: int, stop: int) -> tuple[int | None, int | None]:
    """Return the nearest readings before and after a run that are not masked."""
    before, after = first - 1, stop
    while before >= 0 and mask[before]:
        before -= 1
    while after < mask.size and mask[after]:
        after += 1
    return (before if before >= 0 else None), (after if after < mask.size else None)


def left_out_notice(
    pad: str, tests: Sequence[tuple[str, BadReadings | None]], units: UnitSystem
) -> tuple[str, ...]:
    """Return one sentence on the bad readings of a pad; none if there are none."""
    parts = [
        f"test {name}: {', '.join(_groups(bad, units))}"
        for name, bad in tests
        if bad is not None and bad.bad
    ]
    if not parts:
        return ()
    count = sum(bad.bad for _, bad in tests if bad is not None)
    are = "is" if count == 1 else "are"
    return (
        f"pad {pad}: {'; '.join(parts)}; {_number(count)} {_readings(count)} {are} left out, as "
        "the neighbours on both sides contradict what the other channel does not show "
        "(--keep-all-readings keeps all)",
    )


def _groups(bad: BadReadings, units: UnitSystem) -> list[str]:
    """Describe the runs of each channel and kind: number, times and values."""
    starts = np.cumsum([0, *(run.stop - run.first for run in bad.runs)])
    every = zip(bad.runs, starts[:-1].tolist(), bad.around, strict=True)
    items = [item for item in every if item[0].kind != "excluded"]
    items.sort(key=lambda item: (item[0].channel, item[0].kind))
    phrases = []
    for (channel, _), group in groupby(items, key=lambda item: (item[0].channel, item[0].kind)):
        runs = list(group)
        count = sum(run.stop - run.first for run, _, _ in runs)
        name = _channel(channel, units)
        when = _times([float(bad.time[start]) for _, start, _ in runs])
        run, start, around = runs[0]
        phrases.append(
            f"{_number(count)} {_readings(count)} of {name} at {when}"
            f"{_what(bad, run, start, around, units)}"
        )
    return phrases


def _what(
    bad: BadReadings, run: Bad, start: int, around: tuple[np.ndarray, np.ndarray], units: UnitSystem
) -> str:
    if run.kind == "clock":
        return " (the clock slips)"
    if run.channel == "both":
        value = f"{bad.displacement[start]:.3g} {units.displacement} and "
        return f" ({value}{bad.force[start]:.3g} {units.force})"
    depth = run.channel == "displacement"
    values, unit = (bad.displacement, units.displacement) if depth else (bad.force, units.force)
    level = around[0] if depth else around[1]
    value = f"{values[start]:.3g} {unit}"
    if run.kind in ("stuck", "clipped"):
        return f" ({run.kind} at {value})"
    sides = list(dict.fromkeys(f"{x:.3g}" for x in level[np.isfinite(level)]))
    return f" ({value} amid {' and '.join(sides)} {unit})"


def _channel(channel: str, units: UnitSystem) -> str:
    if channel == "displacement":
        return units.displacement_name
    return units.force_name if channel == "force" else _CHANNELS[channel]


def _times(times: list[float]) -> str:
    named = [f"{t:.6g}" for t in times[:_NAMED]]
    left = len(times) - len(named)
    if left:
        return f"{', '.join(named)} and {left} other times (s)"
    return f"{named[0]} s" if len(named) == 1 else f"{', '.join(named[:-1])} and {named[-1]} s"


def _number(count: int) -> str:
    return _NUMBERS.get(count, str(count))


def _readings(count: int) -> str:
    return "reading" if count == 1 else "readings"
