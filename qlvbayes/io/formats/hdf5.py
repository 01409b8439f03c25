"""Read HDF5: one-dimensional datasets; those of one group are a test."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.isolation import ApartError, read_apart
from qlvbayes.io.formats.namedarrays import NamedArray, as_column, damaged, from_arrays

_BEGIN = b"\x89HDF\r\n\x1a\n"


class Hdf5(AbstractFormat):
    """Datasets of an HDF5 file by name; the unit is in the name or in an attribute ``units``."""

    name: ClassVar[str] = "hdf5"
    machine: ClassVar[str] = "HDF5 of any origin"
    marks: ClassVar[str] = "the first bytes of HDF5"
    reads: ClassVar[str] = "datasets named after time, displacement (or strain), force (or stress)"
    reference: ClassVar[str] = "The HDF Group, HDF5 File Format Specification"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for its signature."""
        return Sight.from_marks({"the first bytes of HDF5": head.startswith(_BEGIN)})

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return one test for each group that has the three quantities."""
        return read_groups(path)


def read_groups(path: Path) -> tuple[Recording, ...]:
    """Return the tests of an HDF5 file: its groups with three or more vectors of numbers."""
    groups: dict[str, list[NamedArray]] = {}
    try:
        vectors = read_apart("hdf5", path)
    except (OSError, ApartError) as error:
        raise damaged(path, error) from error
    for (name, unit), array in vectors:
        if (values := as_column(array)) is not None:
            group, _, own = name.rpartition("/")
            groups.setdefault(group, []).append(NamedArray(own, values, unit))
    full = {group: arrays for group, arrays in groups.items() if len(arrays) > 2}
    if not full:
        raise InputError(
            "no group holds vectors of time, displacement and force",
            file=path,
            remedy="name them time_s, displacement_mm and force_N",
        )
    return tuple(
        from_arrays(arrays, path, group.rpartition("/")[2] if len(full) > 1 else "")
        for group, arrays in full.items()
    )
