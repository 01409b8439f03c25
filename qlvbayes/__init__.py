"""Constants of soft pads from force-displacement tests, and which physical effect is missing.

Importing it switches JAX to float64.
"""

from qlvbayes.checks import InputError
from qlvbayes.choices import Choices
from qlvbayes.data import Pad, Study, Test, read_study
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.diagnosis.words import paragraphs
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.conformance import check_effect
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.elastic import Exponential, HertzPower, Linear
from qlvbayes.experiment import Experiment, prepare
from qlvbayes.fit import Fit, fit_pad
from qlvbayes.inference.ensemble import Settings
from qlvbayes.law import Law
from qlvbayes.model import Model
from qlvbayes.motion import Motion
from qlvbayes.noise import Correlated, StudentT, White
from qlvbayes.predict import Prediction, predict
from qlvbayes.priors import (
    Dirichlet,
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    Ordered,
    Uniform,
)
from qlvbayes.relaxation import Prony
from qlvbayes.residuals import Check, check
from qlvbayes.results import to_arviz
from qlvbayes.runtime import configure
from qlvbayes.scales import Scales
from qlvbayes.summary import Summary, summarise

__version__ = "0.1.0"

configure()
