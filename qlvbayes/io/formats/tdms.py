"""Read LabVIEW's TDMS by npTDMS: the channels of a group are a test."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import NamedColumn, quantities, split_header
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.namedarrays import NamedArray, as_column, damaged, from_arrays, needed

_UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit")


class Tdms(AbstractFormat):
    """Channels of a TDMS file, whose properties give the units.

    Time is a channel, or follows from the waveform's increment.
    """

    name: ClassVar[str] = "tdms"
    machine: ClassVar[str] = "National Instruments LabVIEW, TDMS (needs npTDMS)"
    marks: ClassVar[str] = "the first bytes 'TDSm'"
    reads: ClassVar[str] = "channels named after time, displacement, force; or wf_increment"
    reference: ClassVar[str] = "National Instruments, TDMS File Format Internal Structure"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for its lead-in."""
        return Sight.from_marks({"the first bytes 'TDSm'": head.startswith(b"TDSm")})

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return one test for each group of three channels, or of two with an increment."""
        nptdms = needed("nptdms", "npTDMS", path)
        logging.getLogger("nptdms").setLevel(logging.ERROR)  # it writes raw bytes to the terminal
        try:
            file = nptdms.TdmsFile.read(path)
            groups = {group.name: _arrays(group) for group in file.groups()}
        except Exception as error:  # a cut file ends in any error of its reader
            raise damaged(path, error) from error
        full = {name: arrays for name, arrays in groups.items() if len(arrays) > 2}
        if not full:
            raise InputError(
                "no group holds channels of time, displacement and force",
                file=path,
                remedy="save them in one group, with their units",
            )
        several = len(full) > 1
        return tuple(from_arrays(a, path, name if several else "") for name, a in full.items())


def _arrays(group: Any) -> list[NamedArray]:
    arrays = []
    steps = {}
    for channel in group.channels():
        values = as_column(channel[:])
        if values is None:
            continue
        unit = next((str(channel.properties[k]) for k in _UNITS if k in channel.properties), "")
        arrays.append(NamedArray(channel.name, values, unit))
        steps[len(values)] = channel.properties.get("wf_increment")
    named = [NamedColumn(k, *split_header(array.name)) for k, array in enumerate(arrays)]
    if "time" not in quantities(named):
        arrays += [
            NamedArray("time", np.arange(size, dtype=np.float64) * np.float64(step), "s")
            for size, step in steps.items()
            if step
        ]
    return arrays
