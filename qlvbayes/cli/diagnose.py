"""``qlvbayes diagnose``: which physical effect is missing, if any."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.cli.console import command_line, out, waiting
from qlvbayes.cli.options import (
    Add,
    AsJson,
    Bonded,
    EffectsFile,
    Elastic,
    Fix,
    LawsFile,
    Modes,
    Noise,
    Out,
    Pads,
    Prior,
    Relaxation,
    Rested,
    Seed,
    Style,
    Tolerance,
    chosen_pads,
    model_choices,
    thresholds,
)
from qlvbayes.cli.terminal import Terminal
from qlvbayes.diagnosis.diagnose import EVIDENCES
from qlvbayes.fitting.runs import record_run
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.pipeline.diagnosing import diagnose_into

Evidence = Annotated[str, typer.Option(help=f"One of {', '.join(EVIDENCES)}.")]


def diagnose_command(
    file: Annotated[Path, typer.Argument(help="Measurements: a tidy .csv or .csv.gz file.")],
    output: Out,
    pads: Pads = "",
    elastic: Elastic = "exponential",
    relaxation: Relaxation = None,
    modes: Modes = None,
    noise: Noise = "floor",
    bonded: Bonded = None,
    rested: Rested = False,
    prior: Prior = None,
    fix: Fix = None,
    add: Add = None,
    effects_file: EffectsFile = None,
    laws_file: LawsFile = None,
    evidence: Evidence = "laplace",
    tolerance: Tolerance = "1%",
    style: Style = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Say which physical effect the model lacks, with a probability, or that none can be named.

    Looks at all tests of each pad together. Leaves OUT/<pad>/diagnosis.json, diagnosis.txt and the
    figures residuals_before_after, forces_before_after, evidence and error_staircase.
    """
    if evidence not in EVIDENCES:
        raise InputError(f"no evidence {evidence!r}", remedy=f"use one of {', '.join(EVIDENCES)}")
    settings = thresholds(tolerance)
    with waiting("reading"):
        study = read_measurements(file)
    watcher = Terminal(quiet=as_json)
    for notice in study.notices:
        watcher.notice(notice)
    choices = model_choices(
        study,
        elastic,
        relaxation,
        modes,
        noise,
        bonded,
        prior,
        fix,
        add,
        effects_file,
        laws_file,
        rested=rested,
    )
    found = [
        diagnose_into(
            output / pad.name,
            pad,
            choices,
            evidence=evidence,
            thresholds=settings,
            seed=seed,
            watcher=watcher,
        )
        for pad in chosen_pads(study, pads)
    ]
    told = {"evidence": evidence, "thresholds": settings}
    record_run(output, "diagnose", command_line(), study, choices, seed, told)
    if as_json:
        print(json.dumps([diagnosis.result.as_dict() for diagnosis in found], allow_nan=False))
    else:
        out.print(f"results in {output}", markup=False)
