"""Draw figures for papers: one function a figure, which returns its axes and opens no window.

Every function takes ``width`` in mm (85 for one column of a journal, 180 for two). ``save_figure``
writes PNG and PDF, ``figure_of`` returns the figure to show in a notebook, and ``using`` sets a
user's own look. Nothing here is imported before it is used, nor is Matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from qlvbayes.plots.benchmark import plot_benchmark
    from qlvbayes.plots.constants import plot_constants
    from qlvbayes.plots.contrasts import plot_contrasts
    from qlvbayes.plots.conversion import plot_conversion
    from qlvbayes.plots.error_staircase import plot_error_staircase
    from qlvbayes.plots.evidence import plot_evidence
    from qlvbayes.plots.files import figure_of, save_figure
    from qlvbayes.plots.forces import plot_forces
    from qlvbayes.plots.forces_at_rates import plot_forces_at_rates
    from qlvbayes.plots.forces_before_after import plot_forces_before_after
    from qlvbayes.plots.hysteresis import plot_hysteresis
    from qlvbayes.plots.look import plot_look
    from qlvbayes.plots.pairs import plot_pairs
    from qlvbayes.plots.prediction import plot_prediction
    from qlvbayes.plots.programme import plot_programme
    from qlvbayes.plots.residual_map import plot_residual_map
    from qlvbayes.plots.residuals_before_after import plot_residuals_before_after
    from qlvbayes.plots.style import using

__all__ = [
    "figure_of",
    "plot_benchmark",
    "plot_constants",
    "plot_contrasts",
    "plot_conversion",
    "plot_error_staircase",
    "plot_evidence",
    "plot_forces",
    "plot_forces_at_rates",
    "plot_forces_before_after",
    "plot_hysteresis",
    "plot_look",
    "plot_pairs",
    "plot_prediction",
    "plot_programme",
    "plot_residual_map",
    "plot_residuals_before_after",
    "save_figure",
    "using",
]

_MODULES = {"figure_of": "files", "save_figure": "files", "using": "style"}


def __getattr__(name: str) -> Any:
    """Import the name that is asked for; a figure's module is called like its function."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = _MODULES.get(name) or name.removeprefix("plot_")
    return getattr(import_module(f"{__name__}.{module}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
