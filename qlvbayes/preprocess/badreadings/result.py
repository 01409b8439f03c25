"""What was found in one test: which readings, in which channel, and of what kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Channel = Literal["time", "displacement", "force", "both"]
Kind = Literal["lost", "spike", "stuck", "clipped", "clock"]


@dataclass(frozen=True)
class Bad:
    """Readings [first, stop) of a test that are bad together, in one channel or in both."""

    first: int
    stop: int
    channel: Channel
    kind: Kind


@dataclass(frozen=True, eq=False)
class BadReadings:
    """The bad readings of one test of n.

    time, displacement, force: (k,) of the bad ones, as they were read; runs: which they are and
    why; mask: (n,) True for the bad ones; around: of each run the displacement and the force of the
    sound readings before and after it (NaN where there is none).
    """

    time: Array
    displacement: Array
    force: Array
    runs: tuple[Bad, ...]
    mask: NDArray[np.bool_]
    around: tuple[tuple[Array, Array], ...]

    @classmethod
    def of(cls, time: Array, displacement: Array, force: Array, runs: list[Bad]) -> BadReadings:
        """Those of some runs."""
        runs = sorted(runs, key=lambda run: (run.first, run.stop))
        mask = np.zeros(time.size, dtype=bool)
        for run in runs:
            mask[run.first : run.stop] = True
        around = []
        for run in runs:
            places = neighbours(mask, run.first, run.stop)
            around.append(
                tuple(
                    np.array([np.nan if k is None else values[k] for k in places])
                    for values in (displacement, force)
                )
            )
        return cls(
            time[mask], displacement[mask], force[mask], tuple(runs), mask,
            tuple((d, f) for d, f in around),
        )  # fmt: skip

    @property
    def count(self) -> int:
        """How many there are."""
        return int(np.count_nonzero(self.mask))

    @property
    def channels(self) -> tuple[str, ...]:
        """Of each run its channel."""
        return tuple(run.channel for run in self.runs)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Of each run its kind."""
        return tuple(run.kind for run in self.runs)


def neighbours(mask: NDArray[np.bool_], first: int, stop: int) -> tuple[int | None, int | None]:
    """The nearest readings before and after some that are not masked."""
    before, after = first - 1, stop
    while before >= 0 and mask[before]:
        before -= 1
    while after < mask.size and mask[after]:
        after += 1
    return (before if before >= 0 else None), (after if after < mask.size else None)
