"""What was left out, told in one sentence a pad."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from qlvbayes.io.units import UnitSystem
from qlvbayes.preprocess.badreadings.result import Bad, BadReadings

_NAMED = 3  # times of a group that are named
_NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}
_CHANNELS = {"time": "time", "both": "displacement and force"}


def left_out_notice(
    pad: str, found: Sequence[tuple[str, BadReadings | None]], units: UnitSystem
) -> tuple[str, ...]:
    """One sentence on all of a pad, by test name; none where nothing was left out."""
    parts = [
        f"test {name}: {', '.join(_groups(bad, units))}"
        for name, bad in found
        if bad is not None and bad.count
    ]
    if not parts:
        return ()
    count = sum(bad.count for _, bad in found if bad is not None)
    are = "is" if count == 1 else "are"
    return (
        f"pad {pad}: {'; '.join(parts)}; {_number(count)} {_readings(count)} {are} left out, as "
        "the neighbours on both sides contradict what the other channel does not show "
        "(--keep-all-readings keeps all)",
    )


def _groups(bad: BadReadings, units: UnitSystem) -> list[str]:
    """Of each channel and kind: how many, when, and what was read amid what."""
    starts = np.cumsum([0, *(run.stop - run.first for run in bad.runs)])
    items = list(zip(bad.runs, starts[:-1].tolist(), bad.around, strict=True))
    items.sort(key=lambda item: (item[0].channel, item[0].kind))
    told = []
    for (channel, _), group in groupby(items, key=lambda item: (item[0].channel, item[0].kind)):
        runs = list(group)
        count = sum(run.stop - run.first for run, _, _ in runs)
        name = _channel(channel, units)
        when = _times([float(bad.time[start]) for _, start, _ in runs])
        run, start, around = runs[0]
        told.append(
            f"{_number(count)} {_readings(count)} of {name} at {when}"
            f"{_what(bad, run, start, around, units)}"
        )
    return told


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
