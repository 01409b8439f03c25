"""``qlvbayes diagnose``: which physical effect is missing, if any."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.checks import InputError
from qlvbayes.choices import Choices
from qlvbayes.cli.console import err, out, waiting
from qlvbayes.cli.diagnosis_tables import ranking_table, steps_table
from qlvbayes.cli.options import (
    Add,
    AsJson,
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
from qlvbayes.data import Pad, read_study
from qlvbayes.diagnosis.diagnose import EVIDENCES, diagnose
from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.diagnosis.words import paragraphs
from qlvbayes.experiment import prepare
from qlvbayes.files import results_folder, write_json, write_whole

Evidence = Annotated[str, typer.Option(help=f"One of {', '.join(EVIDENCES)}.")]


def diagnose_command(
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
    evidence: Evidence = "laplace",
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Say which physical effect the model lacks, with a probability, or that none can be named.

    Looks at all tests of each pad together. Leaves OUT/<pad>/diagnosis.json, diagnosis.txt and the
    figures residuals_before_after, forces_before_after, evidence and error_staircase.
    """
    if evidence not in EVIDENCES:
        raise InputError(f"no evidence {evidence!r}", remedy=f"use one of {', '.join(EVIDENCES)}")
    with waiting("reading"):
        study = read_study(file)
    for notice in study.notices:
        err.print(f"notice: {notice}", markup=False)
    choices = model_choices(study, elastic, modes, noise, bonded, prior, fix, add, effects_file)
    found = [
        diagnose_one(pad, choices, output / pad.name, evidence, seed, as_json)
        for pad in chosen_pads(study, pads)
    ]
    if as_json:
        print(json.dumps([diagnosis.as_dict() for diagnosis in found], allow_nan=False))
    else:
        out.print(f"results in {output}", markup=False)


def diagnose_one(
    pad: Pad, choices: Choices, folder: Path, evidence: str, seed: int, quiet: bool
) -> Diagnosis:
    """Diagnose one pad, write its results and figures, show the verdict."""
    with telling(f"pad {pad.name}") as tell:
        tell("motion, phases and noise floor")
        experiment = prepare(pad)
        choices.build(experiment.scales)  # a setting that cannot be used leaves nothing behind
        results_folder(folder)
        found = diagnose(
            experiment, choices, kinds=choices.kinds, evidence=evidence, seed=seed, tell=tell
        )
        if found.verdict == "unexplained":
            tell("a discrepancy for what is left")
            found = _with_discrepancy(found, folder)
        tell("writing")
        write_json(folder / "diagnosis.json", found.as_dict())
        text = "\n\n".join(paragraphs(found)) + "\n"
        write_whole(folder / "diagnosis.txt", text.encode())
        figures = _figures(found, folder)
    if not quiet:
        _show(found, figures)
    return found


def _with_discrepancy(found: Diagnosis, folder: Path) -> Diagnosis:
    """Fit the discrepancy of the last model and leave it sample by sample in discrepancy.csv."""
    # here, as only this verdict needs it
    from qlvbayes.diagnosis.discrepancy import fit_discrepancy

    fitted = fit_discrepancy(found.work, found.work.path.last.point)
    units, samples = found.work.experiment.units, found.work.samples
    lines = [f"test,time_s,discrepancy_mean_{units.force},discrepancy_sd_{units.force}"]
    for trial, rows, band in zip(samples.trials, samples.rows, fitted.predict(), strict=True):
        values = zip(trial.test.time[rows], band.mean, band.sd, strict=True)
        lines += [f"{trial.name},{t:.6g},{mean:.6g},{sd:.6g}" for t, mean, sd in values]
    write_whole(folder / "discrepancy.csv", ("\n".join(lines) + "\n").encode())
    return replace(found, discrepancy=fitted.sd)


@contextmanager
def telling(label: str) -> Iterator[Callable[[str], None]]:
    """A spinner that says what is being done; silent where stderr is no terminal."""
    if not err.is_terminal:
        yield lambda text: None
        return
    with err.status(label) as status:
        yield lambda text: status.update(f"{label}: {text}")


def _figures(found: Diagnosis, folder: Path) -> list[Path]:
    # here, so that the other commands do not wait for matplotlib
    from qlvbayes.plots.diagnosis_files import save_diagnosis_figures

    return save_diagnosis_figures(found, folder)


def _show(found: Diagnosis, figures: list[Path]) -> None:
    units = found.work.experiment.units
    out.print(steps_table(found, units.force))
    out.print(ranking_table(found, units.force))
    for paragraph in paragraphs(found):
        out.print(paragraph, markup=False, soft_wrap=not out.is_terminal)
        out.print()
    for warning in found.warnings:
        err.print(f"warning: {warning}", markup=False)
    out.print("figures:", *(f"  {path}" for path in figures), sep="\n", markup=False)
