"""MATLAB: variables, or the fields of a struct a test, told apart by their names."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, ClassVar

from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.hdf5 import read_groups
from qlvbayes.io.formats.namedarrays import Array, as_column, damaged, from_arrays

_BEGINS = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")


class Matlab(AbstractFormat):
    """``time_s``, ``displacement_mm``, ``force_N``, as variables or in structs, one a test."""

    name: ClassVar[str] = "matlab"
    machine: ClassVar[str] = "MATLAB .mat, versions 5 to 7.3"
    marks: ClassVar[str] = "the first bytes 'MATLAB 5.0 MAT-file' or 'MATLAB 7.3 MAT-file'"
    reads: ClassVar[str] = "vectors named after time, displacement (or strain), force (or stress)"
    reference: ClassVar[str] = "MathWorks, MAT-File Format"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """What MATLAB writes first."""
        return Sight.of({"the first bytes of a MAT-file": head.startswith(_BEGINS)})

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """One test of the variables, or one a struct."""
        try:
            data = path.read_bytes()
            if data.startswith(_BEGINS[1]):
                return read_groups(path)
            from scipy.io import loadmat

            found = loadmat(io.BytesIO(data), squeeze_me=True, struct_as_record=False)
        except (OSError, ValueError, TypeError, KeyError, IndexError, NotImplementedError) as error:
            raise damaged(path, error) from error
        except Exception as error:  # its reader has errors of its own
            raise damaged(path, error) from error
        named = {key: value for key, value in found.items() if not key.startswith("__")}
        structs = {key: value for key, value in named.items() if hasattr(value, "_fieldnames")}
        tests = {
            key: _arrays({n: getattr(s, n) for n in s._fieldnames}) for key, s in structs.items()
        }
        full = {key: arrays for key, arrays in tests.items() if len(arrays) > 2}
        if full:
            return tuple(from_arrays(arrays, path, key) for key, arrays in full.items())
        return (from_arrays(_arrays(named), path),)


def _arrays(named: dict[str, Any]) -> list[Array]:
    columns = {name: as_column(value) for name, value in named.items()}
    return [Array(name, column) for name, column in columns.items() if column is not None]
