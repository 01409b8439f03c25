"""Read the wide tables that programs make of ROS bags: a column for each field of each topic."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import AbstractFormat, Floats, Recording, Sight
from qlvbayes.io.formats.roschannels import RosChannel, meaning, recording_of
from qlvbayes.io.formats.textfile import Lines, cells_of, decoded, separator_of, with_header
from qlvbayes.io.formats.textrows import read_rows

_STAMP = re.compile(r"(?P<topic>(.*[./])?)header[./]stamp([./_](sec|secs|nanosec|nsec|nsecs))?")
_FINE = re.compile(r".*[./_](nanosec|nsec|nsecs)")  # its part below a second
_CLOCK = re.compile(
    r"_{0,2}time|%time|(ros(bag)?_?)?(time_?stamp|time)|\.?rosbagtimestamp", re.IGNORECASE
)
_NS = 1e-9  # s
_UNITS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))  # stamps from the first on are in ns, us, ms
_HEADER = 40  # lines among which the names are


@dataclass(frozen=True)
class _Clock:
    """Clock of a topic ('' for all), with its columns of seconds and of nanoseconds."""

    topic: str
    columns: tuple[int, ...]


class RosTable(AbstractFormat):
    """Columns such as ``header.stamp.sec``, ``wrench.force.z``, ``.pose.position.z``.

    Where topics stand side by side, cells are empty in which a topic has no message.
    """

    name: ClassVar[str] = "ros-table"
    machine: ClassVar[str] = "wide tables made of ROS bags (rosbag to CSV, PlotJuggler)"
    marks: ClassVar[str] = "names such as wrench.force.z and pose.position.z, and a stamp"
    reads: ClassVar[str] = "the force and the position that change most, with their own stamps"
    reference: ClassVar[str] = "ROS geometry_msgs, sensor_msgs and std_msgs; REP 103 for the units"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for a row with paths of fields of ROS messages."""
        lines = Lines.from_bytes(decoded(head).encode())
        paths = {
            what.quantity
            for cells in _candidates(lines)
            for cell in cells
            if "." in cell or "/" in cell
            if (what := meaning(cell)) is not None
        }
        return Sight.from_marks(
            {
                "names of fields as wrench.force.z and pose.position.z": len(paths) == 2,
                "their stamps, as header.stamp.sec": _header(lines) is not None,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the one test of the table."""
        data, lines, number = with_header(
            path, _header, "no row of names with stamps", "export it again"
        )
        separator = separator_of(lines.texts[number])
        names = cells_of(lines.texts[number], separator)
        rows, _, cut = data[lines.starts[number + 1] :].rpartition(b"\n")  # a line without an end
        clocks = _clocks(names)
        channels, origins = [], []
        for index, name in enumerate(names):
            if index in {k for clock in clocks for k in clock.columns} or meaning(name) is None:
                continue
            wanted = [*_clock_of(index, name, clocks).columns, index]
            try:
                read = read_rows(rows + b"\n", separator, wanted, path, sparse=True)
                *stamps, values = read.columns
            except InputError:  # a column without numbers
                continue
            origin = float(stamps[0][0])
            channels.append((name, _seconds(stamps, origin), values, origin * _unit(origin)))
            origins.append(origin * _unit(origin))
        zero = min(origins, default=0.0)
        aligned = [RosChannel(n, t + (o - zero), v) for n, t, v, o in channels]
        return (recording_of(aligned, path, zero, {"cut last line": 1} if cut.strip() else {}),)


def _candidates(lines: Lines) -> list[list[str]]:
    return [cells for number, cells in lines.cells() if number < _HEADER and len(cells) > 2]


def _header(lines: Lines) -> int | None:
    """Return the line of the names: fields of force and of position, and a clock."""
    for number, cells in lines.cells():
        if number >= _HEADER:
            return None
        meant = {what.quantity for cell in cells if (what := meaning(cell)) is not None}
        if len(meant) == 2 and _clocks(cells):
            return number
    return None


def _clocks(names: Sequence[str]) -> list[_Clock]:
    """Return the stamps of topics, and the clocks of all rows."""
    clocks = []
    for index, name in enumerate(names):
        if (match := _STAMP.fullmatch(name)) and not _FINE.fullmatch(name):
            after = [k for k in range(index + 1, len(names)) if _FINE.fullmatch(names[k])]
            clocks.append(_Clock(match["topic"], (index, *after[:1])))
        elif _CLOCK.fullmatch(name):
            clocks.append(_Clock("", (index,)))
    return clocks


def _clock_of(index: int, name: str, clocks: Sequence[_Clock]) -> _Clock:
    """Return a column's clock: of its topic if there is one, the last before it of several."""
    fitting = [clock for clock in clocks if name.startswith(clock.topic)] or list(clocks)
    longest = max(len(clock.topic) for clock in fitting)
    fitting = [clock for clock in fitting if len(clock.topic) == longest]
    before = [clock for clock in fitting if clock.columns[0] < index]
    precise = [clock for clock in before if len(clock.columns) == 2]  # a header's own stamp
    return (precise or before or fitting)[-1]


def _seconds(stamps: Sequence[Floats], origin: float) -> Floats:
    """Return seconds since ``origin``, a stamp in the unit of the file."""
    whole = (stamps[0] - origin) * _unit(origin)
    return whole + stamps[1] * _NS if len(stamps) == 2 else np.asarray(whole)


def _unit(stamp: float) -> float:
    """Return the unit (s) of a stamp since 1970; small ones are in seconds."""
    return next((unit for least, unit in _UNITS if stamp > least), 1.0)
