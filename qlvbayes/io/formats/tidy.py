"""Write a conversion as one tidy CSV file."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.escaping import visible
from qlvbayes.io.files import write_whole
from qlvbayes.io.formats.conversion import Conversion
from qlvbayes.io.formats.format import Floats
from qlvbayes.io.units import UnitSystem, column_name

_FINEST = 1e-10  # last digit written over the largest value, far below any sensor's resolution


def write_tidy(conversion: Conversion, path: Path) -> None:
    """Write all tests, with the findings as comments above them; whole or not at all."""
    if not path.name.lower().endswith((".csv", ".csv.gz")):
        remedy = "give a name that ends in .csv or .csv.gz"
        raise InputError("this is no name of a CSV file", file=path, remedy=remedy)
    text = tidy_text(conversion)
    write_whole(path, gzip.compress(text, mtime=0) if path.suffix.lower() == ".gz" else text)


def tidy_text(conversion: Conversion) -> bytes:
    """Return the bytes of the file."""
    units = conversion.units
    way = column_name(units.displacement_name, "" if units.dimensionless else units.displacement)
    clocked = any(test.start_s is not None for test in conversion.tests)
    measured = any(test.zero_sd is not None for test in conversion.tests)
    errors = [_error_of(units), "contact_stage"] if measured else []
    extra = [*(["start_s"] if clocked else []), *errors]
    creep = any(test.prescribed_force for test in conversion.tests)
    extra += ["control"] if creep else []
    names = ["pad", "test", *extra, "time_s", way]
    names.append(column_name(units.force_name, units.force))
    out = io.BytesIO()
    for line in conversion.notices:
        out.write(f"# {visible(line)}\n".encode())
    out.write((",".join(names) + "\n").encode())
    for test in conversion.tests:
        start = "" if test.start_s is None else f"{test.start_s:.9g}"
        sd = "" if test.zero_sd is None else f"{test.zero_sd:.3g}"
        more = [*([start] if clocked else []), *([sd, test.contact_stage] if measured else [])]
        more += ["force" if test.prescribed_force else ""] if creep else []
        labels = ",".join([test.pad, test.test, *more])
        out.write(_rows(labels, [test.time, test.displacement, test.force]))
    return out.getvalue()


def _error_of(units: UnitSystem) -> str:
    return column_name("contact_sd", units.displacement)


def _rows(labels: str, columns: list[Floats]) -> bytes:
    """Return the lines of a test; numbers have nine decimals or so, as their size requires."""
    decimals = [_decimals(column) for column in columns]
    line = ",".join([labels.replace("%", "%%"), *(f"%.{d}f" for d in decimals)]) + "\n"
    table = np.stack(columns, axis=1)
    size = 4096
    parts = []
    for start in range(0, len(table), size):
        block = table[start : start + size]
        parts.append((line * len(block)) % tuple(block.ravel().tolist()))
    return "".join(parts).encode()


def _decimals(column: Floats) -> int:
    largest = float(np.abs(column).max())
    return int(np.clip(-np.floor(np.log10(largest * _FINEST)), 0, 15)) if largest > 0.0 else 1
