"""Constants of soft pads from force-displacement tests, and which physical effect is missing.

Importing it switches JAX to float64.
"""

from qlvbayes import plots
from qlvbayes.bench.bench import Bench
from qlvbayes.bench.model import ByHand
from qlvbayes.checks import InputError
from qlvbayes.choices import Choices
from qlvbayes.comparison.compare import compare
from qlvbayes.comparison.contrast import Comparison, Contrast, Interval
from qlvbayes.data import Pad, Study, Test, read_study
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.standing import Enough, Standing
from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.diagnosis.words import paragraphs
from qlvbayes.dual import displacement_from_force
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.conformance import check_effect
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.experiment import Experiment, prepare
from qlvbayes.exports.write import export
from qlvbayes.fit import Fit, fit_pad
from qlvbayes.formats.conformance import check_format
from qlvbayes.inference.ensemble import Settings
from qlvbayes.law import Law
from qlvbayes.laws.catalogue import LAWS, Laws
from qlvbayes.laws.conformance import check_law
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
from qlvbayes.model import Model
from qlvbayes.motion import Motion
from qlvbayes.noise import Correlated, StudentT, White
from qlvbayes.prediction import Prediction, predict
from qlvbayes.prescribed.forecast import predict_program
from qlvbayes.prescribed.hypotheses import Hypotheses
from qlvbayes.priors import (
    Dirichlet,
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    Ordered,
    Uniform,
)
from qlvbayes.recovery.rate import Recovery, recovery_rate
from qlvbayes.report.write import write_report
from qlvbayes.residuals import CheckResult, check
from qlvbayes.results import Saved, to_arviz
from qlvbayes.results import load as load_results
from qlvbayes.results import save as save_results
from qlvbayes.runtime import configure
from qlvbayes.scales import Scales
from qlvbayes.stepper import Stepper
from qlvbayes.study import Watcher, run_study
from qlvbayes.summary import FitSummary, summarise

__version__ = "0.1.0"

configure()
