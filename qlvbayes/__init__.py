"""Constants of soft pads from force-displacement tests, and which physical effect is missing.

Importing it switches JAX to float64: at once where JAX is loaded, else as soon as it is, so that
what needs no JAX does not wait for it. What it offers by name is imported when it is first used.

>>> import qlvbayes as q
>>> study = q.read_study("data/pads.csv")
>>> fit = study["B"].fit()
>>> print(fit.summary())
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any

from qlvbayes.io.catalogue import at

if TYPE_CHECKING:
    from qlvbayes import effects, laws, plots, priors
    from qlvbayes.app.bench.bench import Bench
    from qlvbayes.app.bench.model import ByHand
    from qlvbayes.comparison.compare import compare
    from qlvbayes.comparison.contrast import Comparison
    from qlvbayes.diagnosis.diagnose import SearchProgress, StopSearch
    from qlvbayes.diagnosis.result import DiagnosisResult
    from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
    from qlvbayes.fitting.ensemble import Settings
    from qlvbayes.fitting.fit import Fit
    from qlvbayes.fitting.prediction import Prediction
    from qlvbayes.fitting.residuals import CheckResult
    from qlvbayes.fitting.results import load as load_results
    from qlvbayes.fitting.summary import FitSummary
    from qlvbayes.io import formats
    from qlvbayes.io.checks import InputError
    from qlvbayes.io.data import Pad, Test
    from qlvbayes.laws.motion import Motion
    from qlvbayes.model import noise
    from qlvbayes.model.choices import Choices
    from qlvbayes.model.model import Model
    from qlvbayes.model.stepping import displacement_from_force
    from qlvbayes.motion.experiment import Experiment
    from qlvbayes.pipeline.run import run_study
    from qlvbayes.pipeline.specimen import Specimen, Study, read_study
    from qlvbayes.report.firstlook.result import FirstLook
    from qlvbayes.report.page import write_report
    from qlvbayes.use import exports
    from qlvbayes.use.exports.target import export
    from qlvbayes.use.prescribed.forecast import predict_program
    from qlvbayes.use.prescribed.hypotheses import Hypotheses
    from qlvbayes.use.stepper import Stepper

__version__ = "0.2.0"

# where each name comes from; the imports above, for type checkers, say the same
_HOMES = {
    "Bench": "app.bench.bench.Bench",
    "ByHand": "app.bench.model.ByHand",
    "CheckResult": "fitting.residuals.CheckResult",
    "Choices": "model.choices.Choices",
    "Comparison": "comparison.contrast.Comparison",
    "Diagnosis": "diagnosis.summary.diagnosis.Diagnosis",
    "DiagnosisResult": "diagnosis.result.DiagnosisResult",
    "Experiment": "motion.experiment.Experiment",
    "FirstLook": "report.firstlook.result.FirstLook",
    "Fit": "fitting.fit.Fit",
    "FitSummary": "fitting.summary.FitSummary",
    "Hypotheses": "use.prescribed.hypotheses.Hypotheses",
    "InputError": "io.checks.InputError",
    "Model": "model.model.Model",
    "Motion": "laws.motion.Motion",
    "Pad": "io.data.Pad",
    "Prediction": "fitting.prediction.Prediction",
    "SearchProgress": "diagnosis.diagnose.SearchProgress",
    "Settings": "fitting.ensemble.Settings",
    "Specimen": "pipeline.specimen.Specimen",
    "Stepper": "use.stepper.Stepper",
    "StopSearch": "diagnosis.diagnose.StopSearch",
    "Study": "pipeline.specimen.Study",
    "Test": "io.data.Test",
    "compare": "comparison.compare.compare",
    "displacement_from_force": "model.stepping.displacement_from_force",
    "export": "use.exports.target.export",
    "load_results": "fitting.results.load",
    "predict_program": "use.prescribed.forecast.predict_program",
    "read_study": "pipeline.specimen.read_study",
    "run_study": "pipeline.run.run_study",
    "write_report": "report.page.write_report",
}
_PARTS = {
    "effects": "effects",
    "exports": "use.exports",
    "formats": "io.formats",
    "laws": "laws",
    "noise": "model.noise",
    "plots": "plots",
    "priors": "priors",
}

__all__ = [
    "Bench",
    "ByHand",
    "CheckResult",
    "Choices",
    "Comparison",
    "Diagnosis",
    "DiagnosisResult",
    "Experiment",
    "FirstLook",
    "Fit",
    "FitSummary",
    "Hypotheses",
    "InputError",
    "Model",
    "Motion",
    "Pad",
    "Prediction",
    "SearchProgress",
    "Settings",
    "Specimen",
    "Stepper",
    "StopSearch",
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


class _Configuring(MetaPathFinder):
    """Import finder that configures JAX once the finders after it have loaded it."""

    def find_spec(self, name: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """Return the spec of JAX, with a loader that then configures it; None for other names."""
        if name != "jax":
            return None
        specs = (one.find_spec(name, path, target) for one in sys.meta_path if one is not self)
        spec = next((spec for spec in specs if spec is not None), None)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_configure(module: ModuleType) -> None:
                load(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                _configure()

            spec.loader.exec_module = load_and_configure  # type: ignore[method-assign]
        return spec


def _configure() -> None:
    from qlvbayes.io.runtime import configure

    configure()


_configure() if "jax" in sys.modules else sys.meta_path.insert(0, _Configuring())


def __getattr__(name: str) -> Any:
    """Import what is asked for, and keep it."""
    if name in _PARTS:
        return import_module(f"{__name__}.{_PARTS[name]}")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = at(_HOMES[name])
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
