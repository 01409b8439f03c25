"""Read MATLAB files: variables, or the fields of a struct for each test, by their names."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.hdf5 import read_groups
from qlvbayes.io.formats.isolation import ApartError, read_apart
from qlvbayes.io.formats.namedarrays import NamedArray, as_column, damaged, from_arrays

_BEGINS = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")


class Matlab(AbstractFormat):
    """Arrays ``time_s``, ``displacement_mm`` and ``force_N`` of a MATLAB file.

    They are variables, or fields of structs, one struct for each test.
    """

    name: ClassVar[str] = "matlab"
    machine: ClassVar[str] = "MATLAB .mat, versions 5 to 7.3"
    marks: ClassVar[str] = "the first bytes 'MATLAB 5.0 MAT-file' or 'MATLAB 7.3 MAT-file'"
    reads: ClassVar[str] = "vectors named after time, displacement (or strain), force (or stress)"
    reference: ClassVar[str] = "MathWorks, MAT-File Format"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for MATLAB's first bytes."""
        return Sight.from_marks({"the first bytes of a MAT-file": head.startswith(_BEGINS)})

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return one test of the variables, or one for each struct."""
        try:
            with path.open("rb") as stream:
                begin = stream.read(len(_BEGINS[1]))
            if begin == _BEGINS[1]:
                return read_groups(path)
            vectors = read_apart("matlab", path)
        except (OSError, ApartError) as error:
            raise damaged(path, error) from error
        tests: dict[str | None, list[NamedArray]] = {}
        for (struct, name), array in vectors:
            if (values := as_column(array)) is not None:
                tests.setdefault(struct, []).append(NamedArray(name, values))
        full = {key: arrays for key, arrays in tests.items() if key and len(arrays) > 2}
        if full:
            return tuple(from_arrays(arrays, path, key) for key, arrays in full.items())
        return (from_arrays(tests.get(None, []), path),)
