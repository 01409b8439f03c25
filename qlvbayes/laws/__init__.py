"""Define laws of the material, one class a file: elastic laws and relaxation laws."""

from qlvbayes.laws.catalogue import LAWS, Laws
from qlvbayes.laws.conformance import check_law, law_checks
from qlvbayes.laws.elastic.cubic import Cubic
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.elastic.hertz import HertzPower
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.linear import Linear
from qlvbayes.laws.elastic.quadratic import Quadratic
from qlvbayes.laws.elastic.spline import Spline
from qlvbayes.laws.elastic.toe_exponential import ToeExponential
from qlvbayes.laws.relaxation.fung import Fung
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.relaxation.log_normal import LogNormalSpectrum
from qlvbayes.laws.relaxation.power_law import PowerLaw
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.relaxation.stretched import StretchedExponential

__all__ = [
    "LAWS",
    "AbstractElastic",
    "AbstractRelaxation",
    "Cubic",
    "Exponential",
    "Fung",
    "HertzPower",
    "Laws",
    "Linear",
    "LogNormalSpectrum",
    "PowerLaw",
    "Prony",
    "Quadratic",
    "Spline",
    "StretchedExponential",
    "ToeExponential",
    "check_law",
    "law_checks",
]
