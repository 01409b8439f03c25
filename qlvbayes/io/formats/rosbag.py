"""Read robots' logs: MCAP files and the bags of ROS 2 and ROS 1, by rosbags."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.isolation import TIME_S, ApartError, read_apart
from qlvbayes.io.formats.namedarrays import needed
from qlvbayes.io.formats.roschannels import RosChannel, recording_of

_MCAP, _BAG_1, _SQLITE = b"\x89MCAP0\r\n", b"#ROSBAG V2.0", b"SQLite format 3\0"
_PER_MB_S = 4.0  # processor time for 1 MB: 16 000 messages of a wrench take 2 s, one by one
_NS = 1e-9  # s


class RosBag(AbstractFormat):
    """Force and position of a bag that change most, each with the stamps of its messages."""

    name: ClassVar[str] = "rosbag"
    machine: ClassVar[str] = "robots: MCAP, ROS 2 bags (.mcap, .db3), ROS 1 bags (needs rosbags)"
    marks: ClassVar[str] = "the first bytes of MCAP or of a ROS 1 bag, or SQLite with topics"
    reads: ClassVar[str] = "WrenchStamped; PoseStamped, JointState and others; one test a file"
    reference: ClassVar[str] = "MCAP specification; ROS REP 103; rosbags documentation"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for the first bytes of a bag."""
        ros_2 = head.startswith(_SQLITE) and b"topics" in head and b"messages" in head
        there = head.startswith((_MCAP, _BAG_1)) or ros_2
        return Sight.from_marks({"the first bytes of MCAP, of a ROS 2 or of a ROS 1 bag": there})

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the one test of a bag."""
        needed("rosbags.interfaces", "rosbags", path, "'qlvbayes[ros]'")
        try:
            limit = TIME_S + _PER_MB_S * path.stat().st_size / 2**20
            parts = read_apart("ros", path, limit)
        except (OSError, ApartError) as error:
            raise InputError(
                f"the bag is cut off, damaged or of a kind that rosbags cannot read ({error})",
                file=path,
                remedy="try 'ros2 bag reindex' or 'mcap recover', or record it again",
            ) from error
        clocks = {topic: values for (topic, name), values in parts if not name}
        origin = min((int(stamps.min()) for stamps in clocks.values() if stamps.size), default=0)
        seconds = {topic: (stamps - origin) * _NS for topic, stamps in clocks.items()}
        channels = []
        for (topic, name), values in parts:
            if name and (there := np.isfinite(values)).any():
                time = seconds[topic][there]
                channels.append(RosChannel(f"{topic}.{name}", time, values[there]))
        return (recording_of(channels, path, origin * _NS),)
