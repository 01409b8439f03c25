"""Put the rows of a recording in order on one clock, and describe its sampling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.io.formats.format import Floats
from qlvbayes.io.reading.clock import slipped

_REPEATED = 0.2  # share of rows with the time of the row above, beyond which a clock is too coarse
_UNEVEN = 1.5  # ratio of the 95th to the 5th percentile of steps, beyond which they are uneven
_GAP = 1.5  # steps beyond which samples are missing in an even record


@dataclass(frozen=True)
class Sampling:
    """Sampling of one test: number of rows, time step and missing samples.

    ``rows`` counts the rows; ``step``, ``low`` and ``high`` are the median step and its 5th and
    95th percentile (s); ``missing`` counts missing samples. ``lag`` is the delay of the force's
    clock behind the displacement's in the same row (s), where there are two.
    """

    rows: int
    step: float
    low: float
    high: float
    missing: int
    lag: float | None = None

    @property
    def even(self) -> bool:
        """Return whether all steps are about the same."""
        return self.high < _UNEVEN * self.low

    def describe(self) -> str:
        """Return the sampling as one line of text."""
        steps = f"{self.step:.4g} s a row" if self.even else (
            f"uneven, {self.low:.3g} to {self.high:.3g} s a row"
        )  # fmt: skip
        missing = f", {self.missing} samples missing in gaps" if self.missing else ""
        return f"{self.rows} rows, {steps}{missing}"


def sampling_of(time: Floats, lag: float | None = None) -> Sampling:
    """Return the sampling of a clock that rises."""
    steps = np.diff(time)
    step = float(np.median(steps))
    low, high = (float(x) for x in np.percentile(steps, (5, 95)))
    gaps = steps[steps > _GAP * step] if high < _UNEVEN * low else steps[:0]
    missing = int(np.sum(np.round(gaps / step) - 1.0))
    return Sampling(len(time), step, low, high, missing, lag)


_SEVERAL = "if another test begins there, export each to a file of its own; if not, mend its clock"


class ClockError(ValueError):
    """Exception for a clock that cannot be put in order; the text says why, ``remedy`` what to do.

    Rows must not be sorted by a time that falls: those of two tests would be mixed.
    """

    def __init__(self, message: str, remedy: str = _SEVERAL) -> None:
        super().__init__(message)
        self.remedy = remedy


def rising(
    time: Floats, columns: list[Floats], dropped: dict[str, int]
) -> tuple[Floats, list[Floats]]:
    """Return the rows without repeated and slipped times, which are counted in ``dropped``."""
    steps = np.diff(time)
    slips = slipped(time) if (steps < 0).any() else None
    if slips is not None:
        dropped["rows whose time slipped"] = slips.size
        time, columns = np.delete(time, slips), [np.delete(column, slips) for column in columns]
        steps = np.diff(time)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0)) + 1
        raise ClockError(
            f"time falls from {time[row - 1]:.6g} to {time[row]:.6g} s at row {row + 1}"
        )
    same = np.append(False, steps == 0)
    count = int(np.count_nonzero(same))
    if count > _REPEATED * len(time):
        what = f"{count} of {len(time)} rows have the time of the row above"
        raise ClockError(what, "export with more decimals of time")
    if not count:
        return time, columns
    dropped["rows with the time of the row above"] = count
    return time[~same], [column[~same] for column in columns]


def on_one_clock(
    time: Floats, way: Floats, load_time: Floats, dropped: dict[str, int]
) -> tuple[Floats, slice]:
    """Return displacement at the force's times, and the rows of the force that it covers."""
    if (np.diff(time) <= 0).any() or (np.diff(load_time) <= 0).any():
        raise ClockError("one of the two clocks does not rise")
    inside = np.flatnonzero((load_time >= time[0]) & (load_time <= time[-1]))
    if 2 * len(inside) < len(load_time):
        raise ClockError(
            f"the two clocks do not overlap ({time[0]:.6g} to {time[-1]:.6g} s, "
            f"{load_time[0]:.6g} to {load_time[-1]:.6g} s)",
            "export both with one clock",
        )
    kept = slice(int(inside[0]), int(inside[-1]) + 1)
    lost = len(load_time) - len(inside)
    if lost:
        dropped["rows of the force outside the displacement's clock"] = lost
    return np.interp(load_time[kept], time, way), kept
