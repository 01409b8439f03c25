"""HDF5: one-dimensional datasets, those of one group a test."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.namedarrays import Array, as_column, damaged, from_arrays

_BEGIN = b"\x89HDF\r\n\x1a\n"
_UNITS = ("unit", "units", "Unit", "Units")


class Hdf5(AbstractFormat):
    """Datasets named after what they hold; the unit in the name or in an attribute ``units``."""

    name: ClassVar[str] = "hdf5"
    machine: ClassVar[str] = "HDF5 of any origin"
    marks: ClassVar[str] = "the first bytes of HDF5"
    reads: ClassVar[str] = "datasets named after time, displacement (or strain), force (or stress)"
    reference: ClassVar[str] = "The HDF Group, HDF5 File Format Specification"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Its signature."""
        return Sight.of({"the first bytes of HDF5": head.startswith(_BEGIN)})

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """One test a group that has the three."""
        return read_groups(path)


def read_groups(path: Path) -> tuple[Recording, ...]:
    """The tests of an HDF5 file: its groups with three or more vectors of numbers.

    Raises
    ------
    InputError
        The file is damaged, or no group holds time, displacement and force.
    """
    import h5py

    groups: dict[str, list[Array]] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.ndim in (1, 2):
            values = as_column(item[()])
            if values is not None:
                group, _, own = name.rpartition("/")
                groups.setdefault(group, []).append(Array(own, values, _unit(item)))

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        raise damaged(path, error) from error
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


def _unit(item: Any) -> str:
    for key in _UNITS:
        if key in item.attrs:
            value = item.attrs[key]
            return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return ""
