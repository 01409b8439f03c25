"""``qlvbayes study``: every step from a CSV file to the report."""

from __future__ import annotations

from typing import Annotated

import typer

from qlvbayes.cli.console import command_line, out
from qlvbayes.cli.options import (
    File,
    ModelOptions,
    Out,
    Pads,
    References,
    Seed,
    Style,
    Tolerance,
    chosen_pads,
    thresholds,
    with_groups,
)
from qlvbayes.cli.terminal import Terminal
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.pipeline.run import run_study
from qlvbayes.report.page import REPORT


@with_groups
def study_command(
    file: File,
    output: Out,
    pads: Pads = "",
    *,
    model: ModelOptions,
    max_steps: Annotated[int, typer.Option(min=10, help="Steps of the sampler at most.")] = 100_000,
    tolerance: Tolerance = "1%",
    references: References = None,
    style: Style = None,
    seed: Seed = 0,
) -> None:
    """Do everything: fit, check, diagnose, add what is missing, refit, check, compare, report.

    First it shows what is in the tests, as 'look' does (OUT/look.json, OUT/look_<pad>.png).
    The plain model's fit and check are kept in OUT/<pad>/plain; OUT/<pad> holds the diagnosis and,
    with the effects that it names, the fit to all tests and its check. Where nothing is named,
    OUT/<pad> holds the plain model. OUT/report.html tells the whole story in one file.
    """
    judging = thresholds(tolerance)
    watcher = Terminal()
    study = watcher.reading(file)
    choices = model.choices(study)
    settings = Settings(max_steps=max_steps, seed=seed)
    verdicts = run_study(
        study,
        output,
        pads=[pad.name for pad in chosen_pads(study, pads)],
        choices=choices,
        settings=settings,
        thresholds=judging,
        watcher=watcher,
        command=command_line(),
        references=references,
    )
    for found in (one.result for one in verdicts):
        named = ", ".join(found.group or found.effects)
        verdict = found.verdict.replace("_", " ")
        out.print(f"pad {found.pad}: {verdict}{': ' + named if named else ''}")
    out.print(f"results in {output}; open {output / REPORT} in a browser")
