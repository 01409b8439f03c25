"""Make tests of binary files: a workbook's sheets, and vectors with names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.apart import ApartError, Named, read_apart
from qlvbayes.io.formats.columns import NamedColumn, chosen, quantities, recording, split_header
from qlvbayes.io.formats.format import Channel, Recording, Sight, unsure_of_columns
from qlvbayes.io.formats.layouts import TABLE, TESTXPERT, Layout, columns_in
from qlvbayes.io.formats.naming import is_mean
from qlvbayes.io.formats.ros import recording_of_bag
from qlvbayes.io.formats.textfile import (
    Lines,
    decimal_mark,
    is_like_number,
    plain_number,
    with_point,
)
from qlvbayes.io.reading.csvtext import OLD_OFFICE

_LEAST = 10  # rows that a curve has at least; a smaller sheet holds results
_NANO = 1e9  # nm per m, nN per N
_MATLAB = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
_MCAP, _BAG_1, _SQLITE = b"\x89MCAP0\r\n", b"#ROSBAG V2.0", b"SQLite format 3\0"


@dataclass(frozen=True, eq=False)
class Binary:
    """Layout of binary files, as one row: its marks, the reader apart, and what makes the tests.

    ``package`` is what has to be installed to read them: the module, its name, and pip's words.
    """

    name: str
    machine: str
    marks: str
    reads: str
    reference: str
    shows: dict[str, Callable[[bytes], bool]]
    kind: str
    tests: Callable[[Named, Path], list[Recording]]
    package: tuple[str, str, str] | None = None
    general: bool = False

    def sniff(self, head: bytes) -> Sight:
        """Return which marks of the layout the first bytes of a file show."""
        return Sight.from_marks({mark: shown(head) for mark, shown in self.shows.items()})

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the tests of one file, in its order."""
        return tuple(self.tests(self._vectors(path), path))

    def tests_in(self, path: Path, own: Layout) -> list[Recording]:
        """Return the tests of a workbook whose columns the user states."""
        return _of_sheets(self._vectors(path), path, own)

    def _vectors(self, path: Path) -> Named:
        if self.package is not None:
            refuse_without(*self.package, path)
        try:
            with path.open("rb") as stream:
                newer = stream.read(len(_MATLAB[1])) == _MATLAB[1]
            return read_apart("hdf5" if newer else self.kind, path)
        except (OSError, ApartError) as error:
            raise _damaged(path, error, self.kind) from error


def refuse_without(module: str, package: str, install: str, file: Path) -> None:
    """Raise InputError where a package that only some files need is not installed."""
    if find_spec(module) is None:
        what = f"to read it the package {package} is needed"
        raise InputError(what, file=file, remedy=f"install it: pip install {install}")


def _damaged(path: Path, error: BaseException, kind: str) -> InputError:
    """Return the error for a binary file that its own library cannot read."""
    if isinstance(error, OSError) and error.strerror and not path.exists():
        return InputError("no such file", file=path, remedy="check the path")
    text = " ".join(str(error).split())[:120]
    if "spring constant" in text:
        what = "the file does not say the cantilever's spring constant"
        return InputError(what, file=path, remedy="calibrate it and export the curve again")
    if kind == "ros":
        return InputError(
            f"the bag is cut off, damaged or of a kind that rosbags cannot read ({text})",
            file=path,
            remedy="try 'ros2 bag reindex' or 'mcap recover', or record it again",
        )
    what = f"the file is cut off or damaged ({text})"
    return InputError(what, file=path, remedy="copy or export it again")


def _of_vectors(vectors: Named, path: Path) -> list[Recording]:
    """Return a test for each group of three vectors or more: its time, displacement and force."""
    groups: dict[str, list[tuple[str, str, np.ndarray]]] = {}
    for (group, name, unit), array in vectors:
        if (values := _as_column(array)) is not None:
            groups.setdefault(group, []).append((name, unit, values))
    full = {group: _with_clock(named) for group, named in groups.items() if len(named) > 2}
    if not full:
        raise InputError(
            "no group holds vectors of time, displacement and force",
            file=path,
            remedy="name them time_s, displacement_mm and force_N, in one group",
        )
    if len(full) > 1:
        full.pop("", None)  # of variables beside structs
    several = len(full) > 1 or "" not in full
    return [
        _of_arrays(named, path, group.rpartition("/")[2] if several and len(groups) > 1 else "")
        for group, named in full.items()
    ]


def _with_clock(named: list[tuple[str, str, np.ndarray]]) -> list[tuple[str, str, np.ndarray]]:
    """Return the vectors with the clock of their waveforms where none of them is a time."""
    others = [one for one in named if one[0] != "wf_increment"]
    columns = [NamedColumn(k, *split_header(name)) for k, (name, _, _) in enumerate(others)]
    if "time" in quantities(columns):
        return others
    clocks = [("time", unit, values) for name, unit, values in named if name == "wf_increment"]
    return [*others, *clocks]


def _as_column(value: Any) -> np.ndarray | None:
    """Return numbers (n,) as float64 from a row, a column or a vector; None from anything else."""
    values = np.squeeze(np.asarray(value))
    if values.ndim != 1 or len(values) < 2 or values.dtype.kind not in "fiu":
        return None
    return values.astype(np.float64)


def _of_arrays(
    named: Sequence[tuple[str, str, np.ndarray]], file: Path, name: str = ""
) -> Recording:
    """Return the test that vectors hold, recognised by their names; a unit may be part of one."""
    columns = [
        NamedColumn(index, *((own, unit) if unit else split_header(own)))
        for index, (own, unit, _) in enumerate(named)
    ]
    picked = chosen(columns, file)
    values = [named[column.index][2] for column in picked.values()]
    if len({len(column) for column in values}) > 1:
        pairs = zip(picked.values(), values, strict=True)
        counts = ", ".join(f"{column.name} {len(some)}" for column, some in pairs)
        raise InputError(
            f"the channels differ in length ({counts})",
            file=file,
            remedy="export them at one rate, or as text with a clock each",
        )
    good = np.logical_and.reduce([np.isfinite(column) for column in values])
    lost = int(np.count_nonzero(~good))
    kept = [column[good] for column in values] if lost else values
    dropped = {"rows that are not finite": lost} if lost else {}
    return recording(columns, picked, kept, dropped, name)


def _of_curves(vectors: Named, path: Path) -> list[Recording]:
    """Return a test for each curve of an AFM, in nm and nN."""
    curves = [vectors[k : k + 3] for k in range(0, len(vectors), 3)]
    tests = []
    for (_, time), ((title, height, _), depth), (_, force) in curves:
        tests.append(
            Recording(
                Channel("time", time, "s", "time"),
                Channel("displacement", depth * _NANO, "nm", height),
                Channel("force", force * _NANO, "nN", "force"),
                name=title if len(curves) > 1 else "",
                pressing=True,  # a repelled tip bends away: afmformats' own sign of the force
            )
        )
    return tests


def _of_sheets(sheets: Named, path: Path, stated: Layout | None = None) -> list[Recording]:
    """Return the tests of a workbook: each sheet is read as a table of text is."""
    tests: list[Recording] = []
    means: dict[str, int] = {}
    texts = {title: _with_points(array.tobytes(), path) for (title,), array in sheets}
    for title, data in texts.items():
        lines = Lines.from_bytes(data)
        header = None if stated else TABLE.header(lines, False) or TESTXPERT.header(lines, False)
        if stated is None and (header is None or data.count(b"\n") - header.line < _LEAST):
            continue
        if header and (is_mean(title) or any(map(_is_mean_title, lines.texts[: header.line]))):
            means[title] = data.count(b"\n") - header.line - 1
            continue
        if stated is None or data.count(b"\n") >= _LEAST:
            tests += (stated or TESTXPERT).tests_in(data, path, title)
    if not tests:
        named = [names for data in texts.values() if (names := columns_in(Lines.from_bytes(data)))]
        if named and stated is None:
            raise unsure_of_columns(named[0], path)
        raise InputError(
            f"no sheet has time, displacement and force ({', '.join(texts)[:80]})",
            file=path,
            remedy="export the curves of every sample, or state --columns and --units",
        )
    if means:
        lost = {f"rows of the mean specimen's sheet '{title}'": n for title, n in means.items()}
        tests[0] = replace(tests[0], dropped={**tests[0].dropped, **lost})
    return tests


def _is_mean_title(line: str) -> bool:
    """Return whether a row has nothing but one name, that of the mean specimen."""
    filled = {cell.strip() for cell in line.split("\t") if cell.strip()}
    return len(filled) == 1 and is_mean(filled.pop())


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


def _is_workbook(head: bytes) -> bool:
    inside = b"[Content_Types].xml" in head or b"xl/work" in head
    return head.startswith(OLD_OFFICE) or (head.startswith(b"PK\x03\x04") and inside)


def _is_afm(head: bytes) -> bool:
    table = head.startswith(b"# afmformats") and b"# BEGIN METADATA" in head
    return table or (head.startswith(b"PK\x03\x04") and b"header.properties" in head)


def _is_bag(head: bytes) -> bool:
    ros_2 = head.startswith(_SQLITE) and b"topics" in head and b"messages" in head
    return head.startswith((_MCAP, _BAG_1)) or ros_2


WORKBOOK = Binary(
    "testxpert-excel",
    "ZwickRoell testXpert, or another Excel workbook (needs python-calamine)",
    "an Excel workbook (.xlsx, .xls); a sheet with time, displacement and force",
    "every specimen's sheet (a test each), without the mean specimen's",
    "testXpert, export to Excel; ECMA-376",
    {"an Excel workbook": _is_workbook},
    "workbook",
    _of_sheets,
    ("python_calamine", "python-calamine", "python-calamine"),
)
BINARY = (
    WORKBOOK,
    Binary(
        "afm",
        "JPK (.jpk-force, -map, -qi-data), other AFM as afmformats' .tab",
        "a zip archive with header.properties, or a table that afmformats wrote",
        "time, height (measured, else piezo), force, spring constant; nm and nN",
        "afmformats documentation; JPK Instruments, data format",
        {"a zip with header.properties, or afmformats' table": _is_afm},
        "afm",
        _of_curves,
        ("afmformats", "afmformats", "afmformats"),
    ),
    Binary(
        "tdms",
        "National Instruments LabVIEW, TDMS (needs npTDMS)",
        "the first bytes 'TDSm'",
        "channels named after time, displacement, force; or wf_increment",
        "National Instruments, TDMS File Format Internal Structure",
        {"the first bytes 'TDSm'": lambda head: head.startswith(b"TDSm")},
        "tdms",
        _of_vectors,
        ("nptdms", "npTDMS", "npTDMS"),
    ),
    Binary(
        "matlab",
        "MATLAB .mat, versions 5 to 7.3",
        "the first bytes 'MATLAB 5.0 MAT-file' or 'MATLAB 7.3 MAT-file'",
        "vectors named after time, displacement (or strain), force (or stress)",
        "MathWorks, MAT-File Format",
        {"the first bytes of a MAT-file": lambda head: head.startswith(_MATLAB)},
        "matlab",
        _of_vectors,
    ),
    Binary(
        "hdf5",
        "HDF5 of any origin",
        "the first bytes of HDF5",
        "datasets named after time, displacement (or strain), force (or stress)",
        "The HDF Group, HDF5 File Format Specification",
        {"the first bytes of HDF5": lambda head: head.startswith(b"\x89HDF\r\n\x1a\n")},
        "hdf5",
        _of_vectors,
    ),
    Binary(
        "rosbag",
        "robots: MCAP, ROS 2 bags (.mcap, .db3), ROS 1 bags (needs rosbags)",
        "the first bytes of MCAP or of a ROS 1 bag, or SQLite with topics",
        "WrenchStamped; PoseStamped, JointState and others; one test a file",
        "MCAP specification; ROS REP 103; rosbags documentation",
        {"the first bytes of MCAP, of a ROS 2 or of a ROS 1 bag": _is_bag},
        "ros",
        recording_of_bag,
        ("rosbags", "rosbags", "'qlvbayes[ros]'"),
    ),
)
"""Every known binary layout, in the order in which they are tried."""
