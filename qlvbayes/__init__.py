"""Constants of soft pads from force-displacement tests, and which physical effect is missing.

Importing it switches JAX to float64. What it offers by name is imported when it is first used.

>>> import qlvbayes as q
>>> study = q.read_study("data/pads.csv")
>>> fit = study["B"].fit()
>>> print(fit.summary())
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from qlvbayes.runtime import configure as _configure

if TYPE_CHECKING:
    from qlvbayes import effects, exports, formats, laws, noise, plots, priors
    from qlvbayes.bench.bench import Bench
    from qlvbayes.bench.model import ByHand
    from qlvbayes.checks import InputError
    from qlvbayes.choices import Choices
    from qlvbayes.comparison.compare import compare
    from qlvbayes.comparison.contrast import Comparison
    from qlvbayes.data import Pad, Test
    from qlvbayes.diagnosis.result import DiagnosisResult
    from qlvbayes.diagnosis.verdict import Diagnosis
    from qlvbayes.dual import displacement_from_force
    from qlvbayes.experiment import Experiment
    from qlvbayes.exports.write import export
    from qlvbayes.fit import Fit
    from qlvbayes.inference.ensemble import Settings
    from qlvbayes.model import Model
    from qlvbayes.motion import Motion
    from qlvbayes.prediction import Prediction
    from qlvbayes.prescribed.forecast import predict_program
    from qlvbayes.prescribed.hypotheses import Hypotheses
    from qlvbayes.report.write import write_report
    from qlvbayes.residuals import CheckResult
    from qlvbayes.results import load as load_results
    from qlvbayes.specimen import Specimen, Study, read_study
    from qlvbayes.stepper import Stepper
    from qlvbayes.study.run import run_study
    from qlvbayes.summary import FitSummary

__version__ = "0.1.0"

# where each name comes from; the imports above, for type checkers, say the same
_HOMES = {
    "Bench": "bench.bench.Bench",
    "ByHand": "bench.model.ByHand",
    "CheckResult": "residuals.CheckResult",
    "Choices": "choices.Choices",
    "Comparison": "comparison.contrast.Comparison",
    "Diagnosis": "diagnosis.verdict.Diagnosis",
    "DiagnosisResult": "diagnosis.result.DiagnosisResult",
    "Experiment": "experiment.Experiment",
    "Fit": "fit.Fit",
    "FitSummary": "summary.FitSummary",
    "Hypotheses": "prescribed.hypotheses.Hypotheses",
    "InputError": "checks.InputError",
    "Model": "model.Model",
    "Motion": "motion.Motion",
    "Pad": "data.Pad",
    "Prediction": "prediction.Prediction",
    "Settings": "inference.ensemble.Settings",
    "Specimen": "specimen.Specimen",
    "Stepper": "stepper.Stepper",
    "Study": "specimen.Study",
    "Test": "data.Test",
    "compare": "comparison.compare.compare",
    "displacement_from_force": "dual.displacement_from_force",
    "export": "exports.write.export",
    "load_results": "results.load",
    "predict_program": "prescribed.forecast.predict_program",
    "read_study": "specimen.read_study",
    "run_study": "study.run.run_study",
    "write_report": "report.write.write_report",
}
_PARTS = ("effects", "exports", "formats", "laws", "noise", "plots", "priors")

__all__ = [
    "Bench",
    "ByHand",
    "CheckResult",
    "Choices",
    "Comparison",
    "Diagnosis",
    "DiagnosisResult",
    "Experiment",
    "Fit",
    "FitSummary",
    "Hypotheses",
    "InputError",
    "Model",
    "Motion",
    "Pad",
    "Prediction",
    "Settings",
    "Specimen",
    "Stepper",
    "Study",
    "Test",
    "compare",
    "displacement_from_force",
    "effects",
    "export",
    "exports",
    "formats",
    "laws",
    "load_results",
    "noise",
    "plots",
    "predict_program",
    "priors",
    "read_study",
    "run_study",
    "write_report",
]

_configure()


def __getattr__(name: str) -> Any:
    """Import what is asked for, and keep it."""
    if name in _PARTS:
        return import_module(f"{__name__}.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, own = _HOMES[name].rpartition(".")
    value = globals()[name] = getattr(import_module(f"{__name__}.{module}"), own)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
