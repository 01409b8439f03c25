"""List what users choose by name, each with the path of its class, and limits that are stated.

Paths instead of classes, so that the help of a command does not wait for JAX. A name on the left
is the ``name`` of the class on the right. The limits are those that a help or a first look states.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

ELASTIC = {
    "exponential": "laws.elastic.exponential.Exponential",
    "linear": "laws.elastic.polynomial.Linear",
    "hertz": "laws.elastic.hertz.HertzPower",
    "polynomial:2": "laws.elastic.polynomial.Quadratic",
    "polynomial:3": "laws.elastic.polynomial.Cubic",
    "toe": "laws.elastic.exponential.ToeExponential",
    "spline": "laws.elastic.spline.Spline",
}
"""Elastic laws. Constants alone show `model.elsewhere` which law they are of: the first whose
constants are all there. So a law comes before those whose constants are all among its own."""
RELAXATION = {
    "prony": "laws.relaxation.prony.Prony",
    "fung": "laws.relaxation.continuous.Fung",
    "power-law": "laws.relaxation.continuous.PowerLaw",
    "stretched": "laws.relaxation.stretched.StretchedExponential",
    "log-normal": "laws.relaxation.continuous.LogNormalSpectrum",
}
"""Relaxations, ordered likewise."""
NOISES = {
    "floor": "model.noise.Floor",
    "white": "model.noise.White",
}
"""Noise models, ordered likewise; the first is the default."""
SAMPLERS = {"emcee": "fitting.ensemble.sample"}
"""Functions that sample the posterior of constants."""
METHODS = (*SAMPLERS, "least-squares", "two-step")
"""Ways to the constants."""
TARGETS = {
    "c": "use.exports.c_header.CHeader",
    "fmu": "use.exports.fmu.Fmu",
    "mujoco": "use.exports.mujoco.MuJoCo",
    "drake": "use.exports.drake.Drake",
    "matlab": "use.exports.matlab.MatlabFunction",
    "abaqus": "use.exports.abaqus.Abaqus",
    "febio": "use.exports.febio.FEBio",
    "prony": "use.exports.prony.PronyTable",
    "curves": "use.exports.curves.ViscoelasticCurves",
    "json": "use.exports.json_file.JsonFile",
}
"""Targets of an export, in the order in which they are shown."""

MOST_MODES = 6  # of a Prony series; no test resolves more
MOST_TESTS = 5  # in a series of proposed tests
SLOWEST_HZ = 2.0  # of a frame that rings: that of a soft testing machine
READINGS_A_PERIOD = 4.0  # which show a frequency
EXPORT_DRAWS = 64  # of the posterior: a 90 % interval from them is off by a few per cent of them


def loaded(paths: Mapping[str, str]) -> dict[str, Any]:
    """Import what the paths lead to, by name."""
    return {name: at(path) for name, path in paths.items()}


def at(path: str) -> Any:
    """Import one class or function by its path within the package, as ``io.data.Pad``."""
    module, _, name = path.rpartition(".")
    return getattr(import_module(f"qlvbayes.{module}"), name)
