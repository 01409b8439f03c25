"""``qlvbayes fit``: from a CSV file to the constants of each pad."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from qlvbayes.cli.console import command_line, out, waiting
from qlvbayes.cli.options import (
    File,
    ModelOptions,
    Out,
    Pads,
    References,
    Seed,
    Style,
    chosen_pads,
    with_groups,
)
from qlvbayes.cli.terminal import Terminal
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.fit import METHODS
from qlvbayes.fitting.runs import record_run
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.pipeline.drawing import draw_constants, references_of
from qlvbayes.pipeline.fitting import fit_into


@with_groups
def fit(
    file: File,
    output: Out,
    pads: Pads = "",
    method: Annotated[str, typer.Option(help=f"One of {', '.join(METHODS)}.")] = "emcee",
    all_tests: Annotated[bool, typer.Option("--all-tests", help="Fit every test.")] = False,
    *,
    model: ModelOptions,
    walkers: Annotated[int, typer.Option(min=4, help="Walkers of the ensemble.")] = 32,
    max_steps: Annotated[int, typer.Option(min=10, help="Steps at most.")] = 100_000,
    references: References = None,
    style: Style = None,
    seed: Seed = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print summaries as JSON.")] = False,
) -> None:
    """Fit the QLV model to each pad's tests whose role is 'fit'; sample its posterior.

    Leaves OUT/<pad>/posterior.nc (ArviZ), summary.json and the figures pairs and programme; of all
    pads in OUT the figure constants, constants.csv and constants.tex. Figures are PNG and PDF.
    An interrupted run resumes when the same command is given again.
    """
    with waiting("reading"):
        study = read_measurements(file)
    choices = model.choices(study)
    settings = Settings(walkers=walkers, max_steps=max_steps, seed=seed)
    if method not in METHODS:
        raise InputError(f"no method {method!r}", remedy=f"use one of {', '.join(METHODS)}")
    wanted = chosen_pads(study, pads)
    known = references_of(study, references)
    watcher = Terminal(quiet=as_json)
    for notice in study.notices:
        watcher.notice(notice)
    summaries = [
        fit_into(
            output / pad.name,
            pad,
            study,
            choices,
            method=method,
            all_tests=all_tests,
            settings=settings,
            watcher=watcher,
        )
        for pad in wanted
    ]
    with waiting("figures of all pads"):
        draw_constants(output, known)
    told = {"method": method, "all_tests": all_tests, "sampler": settings}
    record_run(output, "fit", command_line(), study, choices, seed, told)
    if as_json:
        print(json.dumps([summary.as_dict() for summary in summaries], allow_nan=False))
    else:
        out.print(f"results in {output}")
