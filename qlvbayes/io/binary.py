"""Make tests of binary files: a workbook's sheets, vectors with names, and topics of a robot."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from qlvbayes.io.apart import ApartError, Named, read_apart
from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import (
    NamedColumn,
    chosen,
    is_mean,
    quantities,
    recording,
    split_header,
    unsure_of_columns,
)
from qlvbayes.io.header import columns_in, stated_above
from qlvbayes.io.layouts import TABLE, TESTXPERT, Layout
from qlvbayes.io.recording import Channel, Recording, Sight, Stated
from qlvbayes.io.splitting import LEAST
from qlvbayes.io.table import decimal_mark, plain_number, with_point
from qlvbayes.io.text import Lines, is_like_number

_MATLAB = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
_HDF5, _ZIP = b"\x89HDF\r\n\x1a\n", b"PK\x03\x04"
_MCAP, _BAG_1, _SQLITE = b"\x89MCAP0\r\n", b"#ROSBAG V2.0", b"SQLite format 3\0"
_OLD_OFFICE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"  # begins all Office files before 2007
_ALIKE = 0.5  # of the largest swing: with another channel of as much, nobody knows which is meant
_ROS = {
    r"(?:.*[./])?force[./_][xyz]": ("force", "N", 0),
    r"(?:.*[./])?(?:position|translation)[./_][xyz]": ("displacement", "m", 0),  # REP 103
    r"(?:.*[./])?position(?:\[[^\]]*\]|[._]\d+)|.*/position": ("displacement", "", 1),
}
"""Paths of fields of ROS: quantity, unit, and order of preference (points before joints)."""
_DATED = 1e8  # s since 1970, below which a stamp is of a simulated clock, or since power-on


@dataclass(frozen=True, eq=False)
class Binary:
    """Layout of binary files, as one row: its mark, the reader apart, and what makes the tests.

    ``install`` is what pip installs to read them, where a package is needed, and ``module`` its
    module.
    """

    name: str
    machine: str
    reference: str
    shows: Callable[[bytes], bool]
    kind: str
    tests: Callable[[Named, Path], list[Recording]]
    module: str = ""
    package: str = ""
    install: str = ""
    general: bool = False

    def sniff(self, head: bytes) -> Sight:
        """Return which marks of the layout the first bytes of a file show."""
        return Sight.from_marks({f"the first bytes of {self.name}": self.shows(head)})

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the tests of one file, in its order."""
        return tuple(self.tests(self.vectors(path), path))

    def vectors(self, path: Path) -> Named:
        """Return the vectors of a file."""
        if self.module and find_spec(self.module) is None:
            what = f"to read it the package {self.package} is needed"
            raise InputError(what, file=path, remedy=f"install it: pip install {self.install}")
        head = b""
        try:
            with path.open("rb") as stream:
                head = stream.read(len(_MATLAB[1]))
                newer = head.startswith(_MATLAB[1])
            return read_apart("hdf5" if newer else self.kind, path)
        except (OSError, ApartError) as error:
            if "spring constant" in str(error):
                what = "the file does not say the cantilever's spring constant"
                remedy = "calibrate it and export the curve again"
                raise InputError(what, file=path, remedy=remedy) from error
            what = f"the file is cut off or damaged ({' '.join(str(error).split())[:120]})"
            remedy = "try 'ros2 bag reindex' or 'mcap recover', or record it again"
            remedy = remedy if self.kind == "ros" else "copy or export it again"
            if head.startswith(_OLD_OFFICE):
                what = f"this is an Excel workbook of before 2007, and {what}"
                remedy = "copy it again, or open it in Excel and save it as .xlsx"
            raise InputError(what, file=path, remedy=remedy) from error


def _of_vectors(vectors: Named, path: Path) -> list[Recording]:
    """Return a test for each group of three vectors or more: its time, displacement and force.

    They are recognised by their names, of which a unit may be part.
    """
    groups: dict[str, list[tuple[str, str, np.ndarray]]] = {}
    for (group, name, unit), array in vectors:
        values = np.squeeze(array)
        if values.ndim == 1 and len(values) > 1 and values.dtype.kind in "fiu":
            groups.setdefault(group, []).append((name, unit, values.astype(np.float64)))
    full = {group: named for group, named in groups.items() if len(named) > 2}
    if not full:
        raise InputError(
            "no group holds vectors of time, displacement and force",
            file=path,
            remedy="name them time_s, displacement_mm and force_N, in one group",
        )
    if len(full) > 1:
        full.pop("", None)  # of variables beside structs
    several = len(full) > 1 or ("" not in full and len(groups) > 1)
    tests = []
    for group, named in full.items():
        columns = [
            NamedColumn(index, *((own, unit) if unit else split_header(own)))
            for index, (own, unit, _) in enumerate(named)
        ]
        if "time" not in quantities(columns):  # the clock of a waveform
            columns = [replace(c, name="time") if c.name == "wf_increment" else c for c in columns]
        picked = chosen(columns, path)
        counts = {column.name: len(named[column.index][2]) for column in picked.values()}
        if len(set(counts.values())) > 1:
            shown = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise InputError(
                f"the channels differ in length ({shown})",
                file=path,
                remedy="export them at one rate, or as text with a clock each",
            )
        vectors_of = [named[column.index][2] for column in picked.values()]
        others = [column for column in columns if column.name != "wf_increment"]
        own_name = group.rpartition("/")[2] if several else ""
        tests.append(recording(others, picked, vectors_of, {}, own_name))
    return tests


def _of_curves(vectors: Named, path: Path) -> list[Recording]:
    """Return a test for each curve of an AFM, in nm and nN."""
    tests = []
    for k in range(0, len(vectors), 3):
        kinds = ("time", "displacement", "force")
        curve = zip(kinds, vectors[k : k + 3], strict=True)
        time, way, load = (
            Channel(kind, values, unit, own) for kind, ((_, own, unit), values) in curve
        )
        name = vectors[k][0][0] if len(vectors) > 3 else ""
        # a repelled tip bends away: afmformats' own sign of the force
        tests.append(Recording(time, way, load, name=name, pressing=True))
    return tests


def of_sheets(sheets: Named, path: Path, stated: Layout | None = None) -> list[Recording]:
    """Return the tests of a workbook: each sheet is read as a table of text is.

    What a sheet of keys and values alone states is stated of the tests of all others.
    """
    tests: list[Recording] = []
    forms: list[str] = []
    texts = {title: _with_points(array.tobytes(), path) for (title,), array in sheets}
    for title, data in texts.items():
        lines = Lines.from_bytes(data)
        header = stated or TABLE.header(lines, False) or TESTXPERT.header(lines, False)
        first = getattr(header, "line", 0)
        if header is None or data.count(b"\n") - first < LEAST:
            cells = [text.strip("\t").count("\t") for text in lines.texts]
            forms += lines.texts if max(cells, default=0) == 1 else []
            continue
        rows = ({cell.strip() for cell in text.split("\t")} - {""} for text in lines.texts[:first])
        alone = [cell for row in rows if len(row) == 1 for cell in row]
        name = next(filter(is_mean, [title, *alone]), title)  # a mean specimen's, to be left out
        tests += (stated or TESTXPERT).tests_in(data, path, name)
    if not tests:
        named = [names for data in texts.values() if (names := columns_in(Lines.from_bytes(data)))]
        if named and stated is None:
            raise unsure_of_columns(named[0], path)
        raise InputError(
            f"no sheet has time, displacement and force ({', '.join(texts)[:80]})",
            file=path,
            remedy="export the curves of every sample, or state --columns and --units",
        )
    about = stated_above(forms)
    return [replace(test, stated=test.stated.completed_by(about)) for test in tests]


def _with_points(data: bytes, path: Path) -> bytes:
    """Return a sheet in which numbers that were text have a decimal point, as the others have."""
    if b"," not in data:
        return data
    rows = [line.split("\t") for line in data.decode().split("\n")]
    numbers = {
        cell: plain
        for row in rows
        for cell in row
        if "," in cell and is_like_number(plain := plain_number(cell))
    }
    decimal = decimal_mark(numbers.values(), path)
    pointed = {cell: with_point(plain, decimal) for cell, plain in numbers.items()}
    return "\n".join("\t".join(pointed.get(cell, cell) for cell in row) for row in rows).encode()


# Robots


def meaning(path: str) -> tuple[str, str, int] | None:
    """Return quantity, unit and rank of a field of a ROS message; None of any other field."""
    for pattern, meant in _ROS.items():
        if re.fullmatch(pattern, path):
            return meant
    own = re.sub(r"[./]data", "", path).rpartition("/")[2]
    by_quantity = quantities([NamedColumn(0, *split_header(own))])
    for quantity in ("force", "displacement"):
        if quantity in by_quantity:
            return quantity, by_quantity[quantity].unit, 2
    return None


def of_topics(parts: Named, path: Path) -> list[Recording]:
    """Return the one test of a bag: of all forces and positions the one that changes most.

    Each has the stamps of its own topic.
    """
    clocks = {topic: stamps for (topic, name, _), stamps in parts if not name}
    origin = min((int(stamps.min()) for stamps in clocks.values() if stamps.size), default=0)
    fields: list[tuple[str, np.ndarray, np.ndarray]] = []
    for (topic, name, _), values in parts:
        if name and (there := np.isfinite(values)).any():
            time = (clocks[topic] - origin)[there] * 1e-9
            order = np.argsort(time, kind="stable")  # messages may be received in another order
            fields.append((f"{topic}.{name}", time[order], values[there][order]))
    way_time, way = _most_changing(fields, "displacement", path)
    load_time, load = _most_changing(fields, "force", path)
    unused = tuple(name for name, *_ in fields if name not in (way.name, load.name))
    began = origin * 1e-9
    dated = began if began > _DATED else None
    stated = Stated(began=dated)
    return [Recording(way_time, way, load, stated=stated, load_time=load_time, unused=unused)]


def _most_changing(
    fields: Sequence[tuple[str, np.ndarray, np.ndarray]], quantity: str, path: Path
) -> tuple[Channel, Channel]:
    """Return clock and values of a quantity's field that changes most, of the preferred kind."""
    changing = [
        (what[2], -float(np.ptp(values)), name, time, values, what[1])
        for name, time, values in fields
        if (what := meaning(name)) and what[0] == quantity and np.ptp(values) > 0.0
    ]
    if not changing:
        names = ", ".join(name for name, *_ in fields)[:200]
        raise InputError(
            f"no {quantity} that changes (the file has: {names or 'no force and no position'})",
            file=path,
            remedy="record the topics of the force (WrenchStamped) and of the platen (PoseStamped "
            "or JointState) in one bag",
        )
    rank, swing, name, time, values, unit = min(changing, key=lambda one: one[:3])
    alike = [f"{o[2]} ({-o[1]:.3g})" for o in changing if o[0] == rank and o[1] < _ALIKE * swing]
    if len(alike) > 1:
        raise InputError(
            f"several channels may be the {quantity}, as they change about as much: "
            f"{' and '.join(alike[:4])}",
            file=path,
            remedy="keep one of them (ros2 bag convert), or write time_s, displacement_mm and "
            "force_N as CSV",
        )
    if unit == "m":
        values, unit = 1e3 * values, "mm"
    return Channel("time", time, "s", "stamp"), Channel(quantity, values, unit, name)


WORKBOOK = Binary(
    "testxpert-excel",
    "ZwickRoell testXpert, or another Excel workbook (needs python-calamine)",
    "testXpert, export to Excel; ECMA-376",
    lambda head: head.startswith(_OLD_OFFICE) or (
        head.startswith(_ZIP) and (b"[Content_Types].xml" in head or b"xl/work" in head)
    ),
    "workbook", of_sheets, "python_calamine", "python-calamine", "python-calamine",
)  # fmt: skip
BINARY = (
    WORKBOOK,
    Binary(
        "afm",
        "JPK (.jpk-force, -map, -qi-data), other AFM as afmformats' .tab",
        "afmformats documentation; JPK Instruments, data format",
        lambda head: (head.startswith(b"# afmformats") and b"# BEGIN METADATA" in head)
        or (head.startswith(_ZIP) and b"header.properties" in head),
        "afm", _of_curves, "afmformats", "afmformats", "afmformats",
    ),
    Binary(
        "tdms",
        "National Instruments LabVIEW, TDMS (needs npTDMS)",
        "National Instruments, TDMS File Format Internal Structure",
        lambda head: head.startswith(b"TDSm"), "tdms", _of_vectors, "nptdms", "npTDMS", "npTDMS",
    ),
    Binary(
        "matlab",
        "MATLAB .mat, versions 5 to 7.3",
        "MathWorks, MAT-File Format",
        lambda head: head.startswith(_MATLAB), "matlab", _of_vectors,
    ),
    Binary(
        "hdf5",
        "HDF5 of any origin",
        "The HDF Group, HDF5 File Format Specification",
        lambda head: head.startswith(_HDF5), "hdf5", _of_vectors,
    ),
    Binary(
        "rosbag",
        "robots: MCAP, ROS 2 bags (.mcap, .db3), ROS 1 bags (needs rosbags)",
        "MCAP specification; ROS REP 103; rosbags documentation",
        lambda head: head.startswith((_MCAP, _BAG_1))
        or (head.startswith(_SQLITE) and b"topics" in head and b"messages" in head),
        "ros", of_topics, "rosbags", "rosbags", "'qlvbayes[ros]'",
    ),
)  # fmt: skip
"""Every known binary layout, in the order in which they are tried."""
