"""The one list of figures: which command leaves each, what it shows, and what to see in it.

A figure is a function ``plot_NAME`` in the file ``NAME.py`` of this folder, or in that of a figure
that is drawn alike. Its entry here puts it
into the command and that command's help, and has the report's words for it. Its position in the
report is a line ``parts.figure(...)`` in a template of ``report/templates/``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Figure:
    """A figure, and the command that leaves it."""

    name: str  # name of its function after ``plot_``, and of its file unless it shares one
    command: str  # the command that leaves it
    # shows, see: what it shows, also for those who cannot see it, with ``{of}`` for the pad; and
    # what to look for. Both are empty where the report does not have it.
    shows: str = ""
    see: str = ""
    # the arguments of its function, from what the command has computed of one pad; None where the
    # command draws one figure for all pads, or from something else
    takes: Callable[..., tuple[Any, ...]] | None = None
    # whether there is anything to draw, from the same
    applies: Callable[..., bool] = lambda *computed: True
    file: str = ""  # name of the file that it shares

    def draw(self, *computed: Any) -> Any:
        """Draw a figure of one pad from what its command has computed of it; return its axes."""
        assert self.takes is not None
        # imported with Matplotlib only now
        module = import_module(f"qlvbayes.plots.{self.file or self.name}")
        return getattr(module, f"plot_{self.name}")(*self.takes(*computed))


FIGURES = (
    Figure(
        "forces",
        "check",
        "Force against time of every test of {of}, by phase, measured and predicted.",
        "Dots are measured, the line is the model, the band holds 90 % of predicted samples. "
        "Correlated noise may carry all dots of a short phase out of the band; where the error is "
        "more than noise and the fit's uncertainty can do, the map above has a cross.",
        lambda checked: (checked.predictions, checked.experiment.units),
    ),
    Figure(
        "hysteresis",
        "check",
        "Force against displacement of every test of {of}, measured and predicted.",
        "The area between loading and unloading is the energy lost. Where the loops of dots and "
        "line differ, the model loses too much or too little.",
        lambda checked: (checked.predictions, checked.experiment.units),
        file="forces",
    ),
    Figure(
        "residual_map", "check", takes=lambda checked: (checked.check, checked.experiment.units)
    ),
    Figure(
        "forces_at_rates",
        "check",
        "Force against time at slow, middle and fast loading, measured and predicted.",
        "Dots inside the band are predicted to within the noise.",
        file="timeline",
    ),
    Figure(
        "residuals_before_after",
        "diagnose",
        "Error over noise floor of {of} by test and phase, for the plain model and for the last.",
        "Both models are fitted to all tests. Cells near 1 are noise, in short ramps those of 2 or "
        "3 may be too. What is dark on the left and light on the right was explained by what was "
        "added.",
        lambda diagnosis: (diagnosis.result,),
        file="residual_map",
    ),
    Figure(
        "evidence",
        "diagnose",
        "Evidence for each hypothesis about what {of} lacks.",
        "A bar to the right: the tests are better explained with this effect in the model than "
        "without it; to the left: worse. The axis is logarithmic where bars differ much.",
        lambda diagnosis: (diagnosis.result,),
    ),
    Figure(
        "error_staircase",
        "diagnose",
        "Error of {of} after each step, fitted and on parts left out, against the noise floor.",
        "Each step down is an effect that was added; at the noise nothing is left to explain.",
        lambda diagnosis: (diagnosis.result,),
        file="evidence",
    ),
    Figure(
        "forces_before_after",
        "diagnose",
        "Residuals of {of} against time before and after the effects were added.",
        "Does the error stay in the hold or end with the motion? Does it grow with speed, with "
        "depth, with time?",
        lambda diagnosis: (diagnosis,),
        file="forces",
    ),
    Figure(
        "strengths",
        "diagnose",
        "Strength of each named effect of {of} in each test, over its mean.",
        "Dots on the line: one strength in all tests. Dots in the order of depth or speed: the "
        "effect grows with it. Dots on both sides of zero: something else looks like it.",
        lambda diagnosis: (diagnosis.result,),
        lambda diagnosis: bool(diagnosis.result.strengths),
        file="evidence",
    ),
    Figure(
        "pairs",
        "fit",
        "Joint posterior of the constants of {of}, two at a time.",
        "A slanted cloud: only a combination of the two constants is known well.",
        lambda fit, experiment: (fit,),
        file="constants",
    ),
    Figure(
        "programme",
        "fit",
        "Displacement against time of every test of {of}.",
        "How the pad was pressed: steeper is faster, level is held.",
        lambda fit, experiment: (experiment,),
        file="timeline",
    ),
    Figure(
        "constants",
        "fit",
        "Every constant of all pads with its 90 % interval.",
        "Where the intervals of two pads do not overlap, the constant differs, if only a little. "
        "Open diamonds are reference values, where some are known.",
    ),
    Figure(
        "contrasts",
        "compare",
        "Ratios of {of} with 90 and 95 % intervals against the region of practical equivalence.",
        "Equal: at least 95 % of the probability lies in the shaded region. Different: it does "
        "not, and the thin line, which holds 95 %, is clear of 1. Otherwise: cannot tell.",
    ),
    Figure(
        "prediction",
        "check --program",
        "What {of} is predicted to do in a programme of the user's own.",
        "Above what is prescribed, beneath the answer: the bands hold 50 and 90 % of the draws.",
        lambda forecast: (forecast,),
    ),
    Figure("next_tests", "design", file="prediction"),
    Figure("look", "look"),
    Figure("conversion", "look -o", file="look"),
)
"""All figures, those of one command together; the report keeps the first where it grows large."""


def figures_of(command: str) -> tuple[Figure, ...]:
    """Return the figures that a command leaves in the folder of each pad."""
    return tuple(one for one in FIGURES if one.command == command and one.takes is not None)


def pictures_of(command: str, folder: Path) -> list[Path]:
    """Return the paths of the PNG files that a command leaves in the folder of a pad."""
    return [folder / f"{one.name}.png" for one in figures_of(command)]


def save_figures(command: str, folder: Path, *computed: Any) -> list[Path]:
    """Draw and save what a command leaves in the folder of a pad; return the PNG files."""
    # imported here, so that what only lists the figures does not wait for Matplotlib
    from qlvbayes.plots.files import save_figure

    some = [one for one in figures_of(command) if one.applies(*computed)]
    return [save_figure(one.draw(*computed), folder / one.name) for one in some]
