"""``qlvbayes study``: every step from a CSV file to the report."""

from __future__ import annotations

from typing import Annotated

import typer

from qlvbayes.cli.console import command_line, out
from qlvbayes.cli.groups import with_groups
from qlvbayes.cli.options import (
    Files,
    ModelOptions,
    Out,
    Pads,
    References,
    Seed,
    Style,
    Tolerance,
    WorkOptions,
    thresholds,
)
from qlvbayes.parallel.faults import FailedError


@with_groups
def study_command(
    file: Files,
    output: Out,
    pads: Pads = "",
    *,
    model: ModelOptions,
    work: WorkOptions,
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
    OUT/<pad> holds the plain model. OUT/report.html has all results in one file.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal
    from qlvbayes.diagnosis.phrases import terminal_line
    from qlvbayes.fitting.ensemble import Settings
    from qlvbayes.pipeline.run import run_study
    from qlvbayes.report.page import REPORT

    judging = thresholds(tolerance)
    watcher = Terminal()
    source = watcher.reading(file, pads, work.part)
    model.choices_of(source)  # an unusable option is refused before the work
    failed = None
    with work.engine() as engine:
        try:
            verdicts = run_study(
                source,
                output,
                choices=model.choices,
                settings=Settings(max_steps=max_steps, seed=seed),
                thresholds=judging,
                watcher=watcher,
                command=command_line(),
                references=references,
                client=engine,
            )
        except FailedError as error:
            failed, verdicts = error, error.results
    for result in verdicts:
        out.print(terminal_line(result), soft_wrap=True)
    if source.shard.count > 1:
        out.print(f"results in {output}; all parts together: qlvbayes gather {output}")
    elif verdicts:
        out.print(f"results in {output}; open {output / REPORT} in a browser")
    if failed is not None:
        raise failed
