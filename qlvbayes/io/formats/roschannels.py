"""Choose force and displacement among the channels of a robot's log, and make one test of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import NamedColumn, quantities, split_header
from qlvbayes.io.formats.format import Channel, Floats, Recording
from qlvbayes.io.formats.sampling import ClockError, on_one_clock, rising

_FORCE = re.compile(r"(?:.*[./])?force[./_][xyz]")
_POINT = re.compile(r"(?:.*[./])?(?:position|translation)[./_][xyz]")
_JOINT = re.compile(r"(?:.*[./])?position(?:\[[^\]]*\]|[._]\d+)|.*/position")
_DATA = re.compile(r"[./]data")
_ALIKE = 0.5  # of the largest swing: with another channel of as much, nobody knows which is meant
_MM = 1e3  # mm per m, in which positions are (REP 103)
_DATED = 1e8  # s since 1970, below which a stamp is of a simulated clock, or since power-on


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
