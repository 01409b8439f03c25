"""All formats, in the order in which they are listed."""

from __future__ import annotations

from qlvbayes.io.formats.afm import Afm
from qlvbayes.io.formats.bluehill_3 import BluehillThree
from qlvbayes.io.formats.bluehill_universal import BluehillUniversal
from qlvbayes.io.formats.cellscale import CellScale
from qlvbayes.io.formats.chiaro import Chiaro
from qlvbayes.io.formats.format import AbstractFormat
from qlvbayes.io.formats.hdf5 import Hdf5
from qlvbayes.io.formats.mach_1 import MachOne
from qlvbayes.io.formats.matlab import Matlab
from qlvbayes.io.formats.tdms import Tdms
from qlvbayes.io.formats.testsuite import TestSuite
from qlvbayes.io.formats.testxpert import TestXpert
from qlvbayes.io.formats.testxpert_excel import TestXpertExcel
from qlvbayes.io.formats.two_clocks import TwoClocks
from qlvbayes.io.formats.wintest import WinTest

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
    TwoClocks,
)
"""Every layout that is known, in the order in which they are tried."""
