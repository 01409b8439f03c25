"""``qlvbayes diagnose``: which physical effect is missing, if any."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from qlvbayes.cli.console import command_line, out
from qlvbayes.cli.options import (
    AsJson,
    File,
    ModelOptions,
    Out,
    Pads,
    Seed,
    Style,
    Tolerance,
    chosen_pads,
    thresholds,
    with_groups,
)
from qlvbayes.cli.terminal import Terminal
from qlvbayes.diagnosis.diagnose import EVIDENCES
from qlvbayes.fitting.runs import record_run
from qlvbayes.io.checks import InputError
from qlvbayes.pipeline.diagnosing import diagnose_into

Evidence = Annotated[str, typer.Option(help=f"One of {', '.join(EVIDENCES)}.")]


@with_groups
def diagnose_command(
    file: File,
    output: Out,
    pads: Pads = "",
    *,
    model: ModelOptions,
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
    watcher = Terminal(quiet=as_json)
    study = watcher.reading(file)
    choices = model.choices(study)
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
        out.print(f"results in {output}")
