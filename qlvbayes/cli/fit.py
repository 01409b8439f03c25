"""``qlvbayes fit``: from a CSV file to the constants of each pad."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.checks import InputError
from qlvbayes.choices import Choices
from qlvbayes.cli.console import err, out, sampling, waiting
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
from qlvbayes.cli.tables import constants_table
from qlvbayes.data import Pad, Study, read_study
from qlvbayes.experiment import Experiment, prepare, pulls
from qlvbayes.files import results_folder, write_json
from qlvbayes.fit import METHODS, fit_pad
from qlvbayes.inference.chainstore import remove_chain
from qlvbayes.inference.ensemble import Settings
from qlvbayes.parameters import fields_of
from qlvbayes.posterior import is_prior
from qlvbayes.results import save, to_arviz
from qlvbayes.summary import Summary, summarise


def fit(
    file: Annotated[Path, typer.Argument(help="Measurements: a tidy .csv or .csv.gz file.")],
    output: Out,
    pads: Pads = "",
    method: Annotated[str, typer.Option(help=f"One of {', '.join(METHODS)}.")] = "emcee",
    all_tests: Annotated[bool, typer.Option("--all-tests", help="Fit every test.")] = False,
    elastic: Elastic = "exponential",
    modes: Modes = 2,
    noise: Noise = "correlated",
    bonded: Bonded = None,
    prior: Prior = None,
    fix: Fix = None,
    add: Add = None,
    effects_file: EffectsFile = None,
    walkers: Annotated[int, typer.Option(min=4, help="Walkers of the ensemble.")] = 32,
    max_steps: Annotated[int, typer.Option(min=10, help="Steps at most.")] = 100_000,
    seed: Seed = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print summaries as JSON.")] = False,
) -> None:
    """Fit the QLV model to each pad's tests whose role is 'fit'; sample its posterior.

    Leaves OUT/<pad>/posterior.nc (ArviZ) and summary.json. An interrupted run resumes when the
    same command is given again.
    """
    with waiting("reading"):
        study = read_study(file)
    choices = model_choices(study, elastic, modes, noise, bonded, prior, fix, add, effects_file)
    settings = Settings(walkers=walkers, max_steps=max_steps, seed=seed)
    if method not in METHODS:
        raise InputError(f"no method {method!r}", remedy=f"use one of {', '.join(METHODS)}")
    wanted = chosen_pads(study, pads)
    for notice in study.notices:
        err.print(f"notice: {notice}", markup=False)
    summaries = [
        fit_one(pad, study, choices, method, all_tests, settings, output / pad.name, as_json)
        for pad in wanted
    ]
    if as_json:
        print(json.dumps([summary.as_dict() for summary in summaries], allow_nan=False))
    else:
        out.print(f"results in {output}", markup=False)


def fit_one(
    pad: Pad,
    study: Study,
    choices: Choices,
    method: str,
    all_tests: bool,
    settings: Settings,
    folder: Path,
    quiet: bool,
) -> Summary:
    """Fit one pad, write its results, show its constants."""
    with waiting(f"pad {pad.name}: motion, phases and noise floor"):
        experiment = prepare(pad, all_tests=all_tests)
    choices.build(experiment.scales)  # a setting that cannot be used leaves nothing behind
    results_folder(folder)
    if pulls(experiment) and not choices.bonded:
        err.print(
            f"notice: pad {pad.name}: the measured force turns negative, but a loose specimen "
            "cannot pull; if it is glued to the platen, add --bonded",
            markup=False,
        )
    if not quiet:
        _show_start(experiment, choices)
    chain = folder / "chain"
    with sampling(f"pad {pad.name}: {method}") as progress:
        found = fit_pad(
            experiment, choices, method=method, settings=settings, folder=chain, progress=progress
        )
    summary = summarise(found)
    with waiting(f"pad {pad.name}: writing"):
        tree = to_arviz(
            found,
            summary,
            source=str(Path(study.source).resolve()),
            sha256=study.sha256,
            all_tests=all_tests,
            seed=settings.seed,
        )
        save(tree, folder / "posterior.nc")
        write_json(folder / "summary.json", summary.as_dict())
    remove_chain(chain)
    if not quiet:
        out.print(constants_table(summary))
    for trouble in summary.troubles:
        err.print(f"NOT CONVERGED, pad {pad.name}: {trouble}", style="bold red", markup=False)
    return summary


def _show_start(experiment: Experiment, choices: Choices) -> None:
    """What is fitted, the noise floor, and the priors."""
    tests = ", ".join(
        f"{trial.name} ({trial.rate:.3g} {experiment.units.speed})"
        for trial in experiment.with_role("fit")
    )
    floor, unit = experiment.floor, experiment.units.force
    lines = [
        f"pad {experiment.pad}: fitting {tests}",
        f"  noise floor {floor.total:.3g} {unit}: white {floor.white:.3g}, "
        f"correlated {floor.ou:.3g} over {floor.tau:.2g} s",
    ]
    for part in choices.build(experiment.scales):
        for field in fields_of(part):
            text = field.value.describe() if is_prior(field.value) else f"fixed at {field.value}"
            lines.append(f"  {field.name} ~ {text}")
    out.print("\n".join(lines), markup=False)
