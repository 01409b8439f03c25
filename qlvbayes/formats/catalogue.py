"""All formats, in the order in which they are listed."""

from __future__ import annotations

from qlvbayes.formats.afm import Afm
from qlvbayes.formats.bluehill_3 import BluehillThree
from qlvbayes.formats.bluehill_universal import BluehillUniversal
from qlvbayes.formats.cellscale import CellScale
from qlvbayes.formats.chiaro import Chiaro
from qlvbayes.formats.format import AbstractFormat
from qlvbayes.formats.hdf5 import Hdf5
from qlvbayes.formats.mach_1 import MachOne
from qlvbayes.formats.matlab import Matlab
from qlvbayes.formats.tdms import Tdms
from qlvbayes.formats.testsuite import TestSuite
from qlvbayes.formats.testxpert import TestXpert
from qlvbayes.formats.testxpert_excel import TestXpertExcel
from qlvbayes.formats.two_clocks import TwoClocks
from qlvbayes.formats.wintest import WinTest

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
