"""Read robots' logs: bags, and the wide tables made of them with a column for each field.

Of all forces and of all positions the one that changes most is used, each with its own stamps.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import NamedColumn, quantities, split_header
from qlvbayes.io.formats.format import AbstractFormat, Channel, Recording, Sight
from qlvbayes.io.formats.sampling import ClockError, on_one_clock, rising
from qlvbayes.io.formats.textfile import Lines, cells_of, content, decoded, separator_of
from qlvbayes.io.formats.textrows import read_rows

_FORCE = re.compile(r"(?:.*[./])?force[./_][xyz]")
_POINT = re.compile(r"(?:.*[./])?(?:position|translation)[./_][xyz]")
_JOINT = re.compile(r"(?:.*[./])?position(?:\[[^\]]*\]|[._]\d+)|.*/position")
_DATA = re.compile(r"[./]data")
_ALIKE = 0.5  # of the largest swing: with another channel of as much, nobody knows which is meant
_MM = 1e3  # mm per m, in which positions are (REP 103)
_DATED = 1e8  # s since 1970, below which a stamp is of a simulated clock, or since power-on
_STAMP = re.compile(r"(?P<topic>(.*[./])?)header[./]stamp([./_](sec|secs|nanosec|nsec|nsecs))?")
_FINE = re.compile(r".*[./_](nanosec|nsec|nsecs)")  # its part below a second
_CLOCK = re.compile(
    r"_{0,2}time|%time|(ros(bag)?_?)?(time_?stamp|time)|\.?rosbagtimestamp", re.IGNORECASE
)
_NS = 1e-9  # s
_UNITS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))  # stamps from the first on are in ns, us, ms
_HEADER = 40  # lines among which the names are


@dataclass(frozen=True, eq=False)
class RosChannel:
    """A field of a topic: its path as written, stamps (s) and values, both (n,)."""

    name: str
    time: Floats
    values: Floats

    @property
    def swing(self) -> float:
        """Return the range of the values."""
        return float(np.ptp(self.values)) if self.values.size else 0.0

    @property
    def sorted(self) -> RosChannel:
        """Return the channel in the order of its stamps: messages may be received in another."""
        order = np.argsort(self.time, kind="stable")
        return RosChannel(self.name, self.time[order], self.values[order])


@dataclass(frozen=True)
class RosField:
    """Meaning of a path: the quantity, its unit, and the factor to that unit.

    ``rank`` is the order of preference: points before joints, both before plain numbers.
    """

    quantity: str
    unit: str
    factor: float = 1.0
    rank: int = field(default=0, compare=False)


def meaning(name: str) -> RosField | None:
    """Return what the path of a field means, or None if it is neither force nor displacement."""
    if _FORCE.fullmatch(name):
        return RosField("force", "N")
    if _POINT.fullmatch(name):
        return RosField("displacement", "mm", _MM)
    if _JOINT.fullmatch(name):
        return RosField("displacement", "", rank=1)
    own = _DATA.sub("", name).rpartition("/")[2]
    by_quantity = quantities([NamedColumn(0, *split_header(own))])
    for quantity in ("force", "displacement"):
        if quantity in by_quantity:
            return RosField(quantity, by_quantity[quantity].unit, rank=2)
    return None


def recording_of(
    channels: Sequence[RosChannel], path: Path, origin: float, dropped: dict[str, int] | None = None
) -> Recording:
    """Return the test of a log: its force, and the displacement at the force's stamps."""
    load, of_load = _chosen(channels, "force", path)
    way, of_way = _chosen(channels, "displacement", path)
    dropped = dict(dropped or {})
    try:
        load_time, (force,) = rising(load.time, [load.values], dropped)
        way_time, (depth,) = rising(way.time, [way.values], {})
        depth, kept = on_one_clock(way_time, depth, load_time, dropped)
    except ClockError as error:
        raise InputError(str(error), file=path, remedy="look at the topics' stamps") from error
    time = load_time[kept]
    began = origin + float(time[0])
    taken = (load.name, way.name)
    return Recording(
        Channel("time", time - time[0], "s", "stamp"),
        Channel("displacement", depth * of_way.factor, of_way.unit, way.name),
        Channel("force", force[kept] * of_load.factor, of_load.unit, load.name),
        began=began if began > _DATED else None,
        dropped=dropped,
        unused=tuple(one.name for one in channels if one.name not in taken),
    )


def _chosen(
    channels: Sequence[RosChannel], quantity: str, path: Path
) -> tuple[RosChannel, RosField]:
    """Return the channel of a quantity that changes most, of the kind that is preferred."""
    meant = [(one.sorted, what) for one in channels if (what := meaning(one.name))]
    changing = [(c, w) for c, w in meant if w.quantity == quantity and c.swing > 0.0]
    if not changing:
        names = ", ".join(one.name for one in channels)[:200]
        raise InputError(
            f"no {quantity} that changes (the file has: {names or 'no force and no position'})",
            file=path,
            remedy="record the topics of the force (WrenchStamped) and of the platen (PoseStamped "
            "or JointState) in one bag",
        )
    least = min(what.rank for _, what in changing)
    changing = [(c, w) for c, w in changing if w.rank == least]
    changing.sort(key=lambda pair: pair[0].swing, reverse=True)
    alike = [c for c, _ in changing if c.swing > _ALIKE * changing[0][0].swing]
    if len(alike) > 1:
        names = " and ".join(f"{c.name} ({c.swing:.3g})" for c in alike[:4])
        raise InputError(
            f"several channels may be the {quantity}, as they change about as much: {names}",
            file=path,
            remedy="keep one of them (ros2 bag convert), or write time_s, displacement_mm and "
            "force_N as CSV",
        )
    return changing[0]


def recording_of_bag(
    parts: Sequence[tuple[Sequence[str], np.ndarray]], path: Path
) -> list[Recording]:
    """Return the one test of a bag, of which each topic has its stamps (ns) and its numbers."""
    clocks = {topic: values for (topic, name), values in parts if not name}
    origin = min((int(stamps.min()) for stamps in clocks.values() if stamps.size), default=0)
    channels = []
    for (topic, name), values in parts:
        if name and (there := np.isfinite(values)).any():
            time = (clocks[topic] - origin)[there] * _NS
            channels.append(RosChannel(f"{topic}.{name}", time, values[there]))
    return [recording_of(channels, path, origin * _NS)]


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
        data = content(path)
        lines = Lines.from_bytes(data)
        if (number := _header(lines)) is None:
            what = "no row of names with stamps"
            raise InputError(what, file=path, remedy="export it again")
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
