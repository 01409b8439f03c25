"""Make tests of named arrays, for files without a table, and import the packages they need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import NamedColumn, chosen, recording, split_header
from qlvbayes.io.formats.format import Floats, Recording


@dataclass(frozen=True, eq=False)
class NamedArray:
    """One-dimensional values with their name and unit; the unit may be part of the name."""

    name: str
    values: Floats
    unit: str = ""


def as_column(value: Any) -> Floats | None:
    """Return numbers (n,) as float64 from a row, a column or a vector; None from anything else."""
    try:
        values = np.squeeze(np.asarray(value))
    except ValueError:  # ragged
        return None
    if values.ndim != 1 or len(values) < 2 or values.dtype.kind not in "fiu":
        return None
    return values.astype(np.float64)


def from_arrays(arrays: Sequence[NamedArray], file: Path, name: str = "") -> Recording:
    """Return the test that arrays hold, recognised by their names."""
    columns = []
    for index, array in enumerate(arrays):
        plain, unit = (array.name, array.unit) if array.unit else split_header(array.name)
        columns.append(NamedColumn(index, plain, unit))
    picked = chosen(columns, file)
    values = [arrays[named.index].values for named in picked.values()]
    lengths = [len(column) for column in values]
    if len(set(lengths)) > 1:
        counts = ", ".join(
            f"{named.name} {n}" for named, n in zip(picked.values(), lengths, strict=True)
        )
        raise InputError(
            f"the channels differ in length ({counts})",
            file=file,
            remedy="export them at one rate, or as text with a clock each",
        )
    good = np.logical_and.reduce([np.isfinite(column) for column in values])
    lost = int(np.count_nonzero(~good))
    kept = [column[good] for column in values] if lost else values
    return recording(
        columns, picked, kept, {"rows that are not finite": lost} if lost else {}, name
    )


def needed(module: str, package: str, file: Path, install: str = "") -> Any:
    """Return a package that only some files need; an InputError says how to install it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"to read it the package {package} is needed",
            file=file,
            remedy=f"install it: pip install {install or package}",
        ) from error


def damaged(path: Path, error: BaseException) -> InputError:
    """Return the error for a binary file that its own library cannot read."""
    if isinstance(error, OSError) and error.strerror and not path.exists():
        return InputError("no such file", file=path, remedy="check the path")
    text = " ".join(str(error).split())[:120]
    return InputError(
        f"the file is cut off or damaged ({text})", file=path, remedy="copy or export it again"
    )
