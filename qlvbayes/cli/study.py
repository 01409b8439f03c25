"""``qlvbayes study``: fit, check, diagnose, add what is missing, refit, check again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.choices import Choices
from qlvbayes.cli.check import check_one
from qlvbayes.cli.console import err, out, waiting
from qlvbayes.cli.diagnose import diagnose_one
from qlvbayes.cli.fit import fit_one
from qlvbayes.cli.options import (
    Add,
    Bonded,
    EffectsFile,
    Elastic,
    Fix,
    Modes,
    Noise,
    Out,
    Pads,
    Prior,
    Seed,
    chosen_pads,
    model_choices,
)
from qlvbayes.data import Pad, Study, read_study
from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.inference.ensemble import Settings
from qlvbayes.results import load


def study_command(
    file: Annotated[Path, typer.Argument(help="Measurements: a tidy .csv or .csv.gz file.")],
    output: Out,
    pads: Pads = "",
    elastic: Elastic = "exponential",
    modes: Modes = 2,
    noise: Noise = "correlated",
    bonded: Bonded = None,
    prior: Prior = None,
    fix: Fix = None,
    add: Add = None,
    effects_file: EffectsFile = None,
    max_steps: Annotated[int, typer.Option(min=10, help="Steps of the sampler at most.")] = 100_000,
    seed: Seed = 0,
) -> None:
    """Do everything: fit, check, diagnose, add the effects that the verdict names, refit, check.

    The plain model's fit and check are kept in OUT/<pad>/plain; OUT/<pad> holds the diagnosis and,
    with the effects that it names, the fit to all tests and its check. Where nothing is named,
    OUT/<pad> holds the plain model.
    """
    with waiting("reading"):
        study = read_study(file)
    for notice in study.notices:
        err.print(f"notice: {notice}", markup=False)
    choices = model_choices(study, elastic, modes, noise, bonded, prior, fix, add, effects_file)
    settings = Settings(max_steps=max_steps, seed=seed)
    verdicts = [
        _study_one(pad, study, choices, settings, output / pad.name)
        for pad in chosen_pads(study, pads)
    ]
    for found in verdicts:
        named = ", ".join(found.group or found.effects)
        out.print(f"pad {found.pad}: {found.verdict}{': ' + named if named else ''}", markup=False)
    out.print(f"results in {output}", markup=False)


def _study_one(
    pad: Pad, study: Study, choices: Choices, settings: Settings, folder: Path
) -> Diagnosis:
    _fit_and_check(pad, study, choices, settings, folder / "plain", all_tests=False)
    found = diagnose_one(pad, choices, folder, "laplace", settings.seed, quiet=False)
    effects = (*choices.effects, *(e for e in found.effects if e not in choices.effects))
    fuller = replace(choices, effects=effects)
    _fit_and_check(pad, study, fuller, settings, folder, all_tests=bool(found.effects))
    return found


def _fit_and_check(
    pad: Pad, study: Study, choices: Choices, settings: Settings, folder: Path, *, all_tests: bool
) -> None:
    fit_one(pad, study, choices, "emcee", all_tests, settings, folder, False)
    check_one(load(folder / "posterior.nc"), study, folder, settings.seed, False)
