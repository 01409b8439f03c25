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
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np

TIME_S = 10.0  # processor time for an empty file: imports take 1 s, and 100 MB another
_PER_MB_S = {"ros": 4.0, "workbook": 2.0}  # for 1 MB: 16 000 messages, one by one, take 2 s
_WAITING = 6.0  # factor by which the wall time may exceed that on a busy machine
MEMORY = 4 * 2**30  # bytes of address space: the libraries alone take 1 GiB
_BAGS = {b"\x89MCAP0": ".mcap", b"SQLite": ".db3", b"#ROSBA": ".bag"}  # by their first bytes
_VECTORS = ("force", "position", "translation")  # of messages, with x, y and z
_DEEPEST = 6  # levels of a message; those of wrenches and poses have four
_OUT_OF_TIME = int(getattr(signal, "SIGXCPU", 0))

Named = list[tuple[Any, np.ndarray]]
"""Vectors, each with its group, its name and its unit; of a workbook, with the sheet's name."""


class ApartError(Exception):
    """Exception for a file that could not be read; the text says why."""


def read_apart(kind: str, path: Path, limit: float | None = None) -> Named:
    """Return the vectors of a file, each with what its reader says of it."""
    if limit is None:
        limit = TIME_S + _PER_MB_S.get(kind, 0.1) * path.stat().st_size / 2**20
    # threads of the libraries take address space each
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
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
        return [(name, arrays[f"a{k}"]) for k, name in enumerate(json.loads(str(arrays["names"])))]


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
    keys = ("unit_string", "NI_UnitDescription", "unit", "units", "Unit", "Units")
    value = next((attributes[key] for key in keys if key in attributes), "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _tdms(path: str) -> Named:
    """Return the channels of each group with their units, and the clock of its waveforms."""
    import nptdms

    vectors: Named = []
    for group in nptdms.TdmsFile.read(path).groups():
        for channel in group.channels():
            values = np.asarray(channel[:])
            if values.dtype.kind in "fiu":
                vectors.append(([group.name, channel.name, _unit(channel.properties)], values))
                step = channel.properties.get("wf_increment")
        if group.channels() and step:
            clock = np.arange(len(values)) * float(step)
            vectors.append(([group.name, "wf_increment", "s"], clock))
    return vectors


def _matlab(path: str) -> Named:
    """Return vectors of numbers, each with its struct (empty for a variable) and its name."""
    from scipy.io import loadmat

    vectors: Named = []
    for key, value in loadmat(path, squeeze_me=True, struct_as_record=False).items():
        names = getattr(value, "_fieldnames", None)
        parts = {name: getattr(value, name) for name in names} if names else {key: value}
        for name, part in parts.items():
            array = part if isinstance(part, np.ndarray) else np.array(0)
            if array.dtype.kind in "fiu" and not key.startswith("__"):
                vectors.append(([key if names else "", name, ""], array))
    return vectors


def _afm(path: str) -> Named:
    """Return time (s), depth (nm) of the tip and force (nN) of each curve.

    The depth is -height - force/k, without the bending of the cantilever.
    """
    import afmformats

    vectors: Named = []
    for number, curve in enumerate(afmformats.load_data(path), 1):
        height = "height (measured)" if "height (measured)" in curve else "height (piezo)"
        force = np.asarray(curve["force"], dtype=np.float64)
        depth = -np.asarray(curve[height]) - force / float(curve.metadata["spring constant"])
        time = np.asarray(curve["time"], dtype=np.float64)
        named = (("time", "s", time), (f"-{height} - force/k", "nm", 1e9 * depth))
        for name, unit, values in (*named, ("force", "nN", 1e9 * force)):
            vectors.append(([f"curve {number}", name, unit], values))
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
    return " ".join(str(cell).split())


def _ros(path: str) -> Named:
    """Return stamps (ns) and values of the forces and positions in a ROS bag, topic by topic."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    vectors: Named = []
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / f"bag{_BAGS[Path(path).read_bytes()[:6]]}"  # its name tells its kind
        bag.symlink_to(Path(path).resolve())
        with AnyReader([bag], default_typestore=get_typestore(Stores.LATEST)) as reader:
            for connection in reader.connections:
                rows, stamps, received = [], [], []
                for _, time_ns, raw in reader.messages(connections=[connection]):
                    message = reader.deserialize(raw, connection.msgtype)
                    rows.append(_ros_values(message))
                    if not rows[0]:
                        break
                    stamp = getattr(getattr(message, "header", None), "stamp", None)
                    stamps.append(0 if stamp is None else 10**9 * stamp.sec + stamp.nanosec)
                    received.append(time_ns)
                clock = np.array(stamps if all(stamps) else received, dtype=np.int64)
                vectors.append(([connection.topic, "", "ns"], clock))
                for field in sorted({field for row in rows for field in row}):
                    values = np.array([row.get(field, math.nan) for row in rows])
                    vectors.append(([connection.topic, field, ""], values))
    return vectors


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


def main(kind: str, path: str, seconds: str) -> int:
    """Write the vectors to standard output; return 1 and print a line where that is impossible."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
    except (ImportError, OSError, ValueError):  # not on every system
        pass
    try:
        vectors = _READERS[kind](path)
        arrays: dict[str, Any] = {f"a{k}": array for k, (_, array) in enumerate(vectors)}
        arrays["names"] = np.array(json.dumps([name for name, _ in vectors]))
        found = io.BytesIO()
        np.savez(found, **arrays)
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # some libraries' own are not under Exception
        print(" ".join(f"{type(error).__name__}: {error}".split()), file=sys.stderr)
        return 1
    sys.stdout.buffer.write(found.getbuffer())
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
