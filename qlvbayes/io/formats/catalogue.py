"""List all formats, in the order in which they are tried, and read a user's own."""

from __future__ import annotations

from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.afm import Afm
from qlvbayes.io.formats.bluehill_3 import BluehillThree
from qlvbayes.io.formats.bluehill_universal import BluehillUniversal
from qlvbayes.io.formats.cellscale import CellScale
from qlvbayes.io.formats.chiaro import Chiaro
from qlvbayes.io.formats.format import AbstractFormat
from qlvbayes.io.formats.hdf5 import Hdf5
from qlvbayes.io.formats.mach_1 import MachOne
from qlvbayes.io.formats.matlab import Matlab
from qlvbayes.io.formats.named_table import NamedTable
from qlvbayes.io.formats.ros_table import RosTable
from qlvbayes.io.formats.rosbag import RosBag
from qlvbayes.io.formats.tdms import Tdms
from qlvbayes.io.formats.testsuite import TestSuite
from qlvbayes.io.formats.testxpert import TestXpert
from qlvbayes.io.formats.testxpert_excel import TestXpertExcel
from qlvbayes.io.formats.two_clocks import TwoClocks
from qlvbayes.io.formats.wintest import WinTest
from qlvbayes.io.usermodule import check_own, own_classes

FORMATS: tuple[type[AbstractFormat], ...] = (
    BluehillThree,
    BluehillUniversal,
    WinTest,
    TestSuite,
    TestXpert,
    TestXpertExcel,
    CellScale,
    MachOne,
    Chiaro,
    Afm,
    Tdms,
    Matlab,
    Hdf5,
    RosBag,
    RosTable,
    TwoClocks,
    NamedTable,
)
"""Every known layout, in the order in which they are tried."""


def own_formats(path: Path) -> tuple[type[AbstractFormat], ...]:
    """Return the formats that a Python file defines, in its order; imported ones do not count."""
    kinds = own_classes(path, AbstractFormat, "formats")  # type: ignore[type-abstract]
    if not kinds:
        raise InputError(
            "defines no format", file=path, remedy="write a class that extends AbstractFormat"
        )
    check_own(path, kinds, AbstractFormat, "format", [kind.name for kind in FORMATS])
    return kinds
