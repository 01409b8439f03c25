"""Read a binary file in a process of its own, as a damaged one may hang or crash its library.

The process runs this file by itself; it imports the file's library alone, and its time and memory
are limited. It is spawned, not forked, as JAX has threads. What it finds are named vectors; of a
workbook they are the bytes of each sheet as text.
"""

from __future__ import annotations

import dataclasses
import io
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from datetime import datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np

TIME_S = 10.0  # processor time for an empty file: imports take 1 s, and 100 MB another
PER_MB_S = {"ros": 4.0, "workbook": 2.0}  # for 1 MB: 16 000 messages, one by one, take 2 s
_PER_MB_S = 0.1
_WAITING = 6.0  # factor by which the wall time may exceed that on a busy machine
MEMORY = 4 * 2**30  # bytes of address space: the libraries alone take 1 GiB
_NAMES = "names"
_HDF5 = b"\x89HDF\r\n\x1a\n"
_HDF5_BEGINS = (0, 512)  # offsets of its first block; MATLAB writes a text before it
_END = {0: 40, 1: 44, 2: 28, 3: 28}  # offset of the file's end in that block, by version
_BAGS = {b"\x89MCAP0": ".mcap", b"SQLite": ".db3", b"#ROSBA": ".bag"}  # by their first bytes
_VECTORS = ("force", "position", "translation")  # of messages, with x, y and z
_DEEPEST = 6  # levels of a message; those of wrenches and poses have four
_OUT_OF_TIME = int(getattr(signal, "SIGXCPU", 0))
_LIBRARIES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")  # threads take address space each
_UNITS = ("unit_string", "NI_UnitDescription", "unit", "units", "Unit", "Units")

Named = list[tuple[Any, np.ndarray]]
"""Vectors, each with what its reader says of it."""


class ApartError(Exception):
    """Exception for a file that could not be read; the text says why."""


def read_apart(kind: str, path: Path, limit: float | None = None) -> Named:
    """Return the vectors of a file, each with what its reader says of it."""
    if _is_cut(path):
        raise ApartError("it ends before what it says it holds")
    if limit is None:
        limit = TIME_S + PER_MB_S.get(kind, _PER_MB_S) * path.stat().st_size / 2**20
    environment = os.environ | dict.fromkeys(_LIBRARIES, "1")
    command = [sys.executable, "-P", __file__, kind, str(path), str(math.ceil(limit))]
    endless = ApartError(f"reading it did not end within {limit:.0f} s")
    try:
        most = _WAITING * limit
        done = subprocess.run(command, capture_output=True, timeout=most, env=environment)
    except subprocess.TimeoutExpired:
        raise endless from None
    if _OUT_OF_TIME and done.returncode == -_OUT_OF_TIME:
        raise endless
    if done.returncode != 0:
        lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
        crashed = done.returncode < 0 or not lines
        raise ApartError("it crashes its reader" if crashed else lines[-1])
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as arrays:
        names = json.loads(str(arrays[_NAMES]))
        return [(name, arrays[f"a{k}"]) for k, name in enumerate(names)]


def _is_cut(path: Path) -> bool:
    """Return whether HDF5's first block states an end beyond the file's, which needs no library."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        for begin in _HDF5_BEGINS:
            stream.seek(begin)
            block = stream.read(48)
            if block.startswith(_HDF5) and len(block) == 48:
                offset = _END.get(block[8])
                return offset is not None and int.from_bytes(block[offset:][:8], "little") > size
    return False


def _hdf5(path: str) -> Named:
    """Return vectors of numbers, with their path in the file and their unit."""
    import h5py

    vectors: Named = []

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.ndim in (1, 2) and item.dtype.kind in "fiu":
            group, _, own = name.rpartition("/")
            vectors.append(([group, own, _unit(item.attrs)], np.asarray(item[()])))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return vectors


def _unit(attributes: Any) -> str:
    value = next((attributes[key] for key in _UNITS if key in attributes), "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _tdms(path: str) -> Named:
    """Return the channels of each group with their units, and the clock of its waveforms."""
    import nptdms

    vectors: Named = []
    for group in nptdms.TdmsFile.read(path).groups():
        steps: dict[int, Any] = {}
        for channel in group.channels():
            values = np.asarray(channel[:])
            if values.dtype.kind in "fiu":
                vectors.append(([group.name, channel.name, _unit(channel.properties)], values))
                steps[len(values)] = channel.properties.get("wf_increment")
        vectors += [
            ([group.name, "wf_increment", "s"], np.arange(size) * float(step))
            for size, step in steps.items()
            if step
        ]
    return vectors


def _matlab(path: str) -> Named:
    """Return vectors of numbers, each with its struct (empty for a variable) and its name."""
    from scipy.io import loadmat

    vectors: Named = []
    named = loadmat(path, squeeze_me=True, struct_as_record=False)
    for key, value in named.items():
        if hasattr(value, "_fieldnames"):
            parts = {name: getattr(value, name) for name in value._fieldnames}
            vectors += [([key, name, ""], part) for name, part in _numeric(parts)]
        elif not key.startswith("__"):
            vectors += [(["", name, ""], part) for name, part in _numeric({key: value})]
    return vectors


def _numeric(named: dict[str, Any]) -> list[tuple[str, np.ndarray]]:
    arrays = {}
    for name, value in named.items():
        try:
            arrays[name] = np.asarray(value)
        except ValueError:  # ragged
            continue
    return [(name, array) for name, array in arrays.items() if array.dtype.kind in "fiu"]


def _afm(path: str) -> Named:
    """Return time (s), depth (m) of the tip and force (N) of each curve.

    The depth is -height - force/k, without the bending of the cantilever.
    """
    import afmformats

    vectors: Named = []
    for number, curve in enumerate(afmformats.load_data(path), 1):
        height = "height (measured)" if "height (measured)" in curve else "height (piezo)"
        force = np.asarray(curve["force"], dtype=np.float64)
        stiffness = float(curve.metadata["spring constant"])
        depth = -np.asarray(curve[height], dtype=np.float64) - force / stiffness
        time = np.asarray(curve["time"], dtype=np.float64)
        named = (("time", time), (f"-{height} - force/k", depth), ("force", force))
        vectors += [([f"curve {number}", name, ""], values) for name, values in named]
    return vectors


def _workbook(path: str) -> Named:
    """Return each sheet as text: its rows in lines, its cells between tabs."""
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_path(path)
    sheets = {name: book.get_sheet_by_name(name).to_python() for name in book.sheet_names}
    texts = {
        name: "".join("\t".join(map(_written, row)) + "\n" for row in rows)
        for name, rows in sheets.items()
    }
    return [([name], np.frombuffer(text.encode(), np.uint8)) for name, text in texts.items()]


def _written(cell: Any) -> str:
    """Return a cell as text; a duration as hours, minutes and seconds."""
    if isinstance(cell, float):
        return f"{int(cell)}" if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, timedelta):
        minutes, seconds = divmod(cell.total_seconds(), 60.0)
        return f"{int(minutes) // 60}:{int(minutes) % 60:02}:{seconds:09.6f}"
    if isinstance(cell, time | datetime):
        return str(cell)
    return " ".join(str(cell).split())


def _ros(path: str) -> Named:
    """Return stamps (ns) and values of the forces and positions in a ROS bag, topic by topic."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with Path(path).open("rb") as stream:
        suffix = _BAGS[stream.read(6)]
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / f"bag{suffix}"  # the library goes by the file's name
        bag.symlink_to(Path(path).resolve())
        with AnyReader([bag], default_typestore=get_typestore(Stores.LATEST)) as reader:
            return [part for topic in reader.connections for part in _ros_topic(reader, topic)]


def _ros_topic(reader: Any, connection: Any) -> Named:
    """Return a topic's stamps, then each of its numbers; nothing if its first message has none."""
    stamps, received, rows = [], [], []
    for time_ns, raw in ((t, r) for _, t, r in reader.messages(connections=[connection])):
        message = reader.deserialize(raw, connection.msgtype)
        rows.append(_ros_values(message))
        if not rows[0]:
            return []
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        stamps.append(0 if stamp is None else 10**9 * int(stamp.sec) + int(stamp.nanosec))
        received.append(time_ns)
    clock = np.array(stamps if all(stamps) else received, dtype=np.int64)
    fields = sorted({field for row in rows for field in row})
    columns = [np.array([row.get(field, math.nan) for row in rows]) for field in fields]
    named: Iterable[tuple[str, np.ndarray]] = zip(["", *fields], [clock, *columns], strict=True)
    return [([connection.topic, field], column) for field, column in named]


def _ros_values(message: Any, path: tuple[str, ...] = ()) -> dict[str, float]:
    """Return forces, positions (of joints by their names) and plain numbers, by their path."""
    fields = vars(message)
    if isinstance(fields.get("position"), np.ndarray) and "name" in fields:
        joints = zip(fields["name"], fields["position"], strict=False)
        return {".".join((*path, f"position[{name}]")): float(value) for name, value in joints}
    values: dict[str, float] = {}
    for key, value in fields.items():
        if dataclasses.is_dataclass(value) and len(path) < _DEEPEST:
            values |= _ros_values(value, (*path, key))
        elif isinstance(value, int | float) and (
            key == "data" or (path[-1:] and path[-1] in _VECTORS and key in ("x", "y", "z"))
        ):
            values[".".join((*path, key))] = float(value)
    return values


_READERS: dict[str, Callable[[str], Named]] = {
    "afm": _afm,
    "hdf5": _hdf5,
    "matlab": _matlab,
    "ros": _ros,
    "tdms": _tdms,
    "workbook": _workbook,
}


def _limit(seconds: int) -> None:
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    except (ImportError, OSError, ValueError):  # not on every system
        return


def main(kind: str, path: str, seconds: str) -> int:
    """Write the vectors to standard output; return 1 and print a line where that is impossible."""
    _limit(int(seconds))
    try:
        vectors = _READERS[kind](path)
        arrays: dict[str, Any] = {f"a{k}": array for k, (_, array) in enumerate(vectors)}
        names = np.array(json.dumps([name for name, _ in vectors]))
        content = io.BytesIO()
        np.savez(content, **arrays, names=names)
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # some libraries' own are not under Exception
        print(" ".join(f"{type(error).__name__}: {error}".split()), file=sys.stderr)
        return 1
    sys.stdout.buffer.write(content.getbuffer())
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
