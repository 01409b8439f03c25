"""``qlvbayes fit``: from a CSV file to the constants of each pad."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from qlvbayes.cli.console import command_line, waiting
from qlvbayes.cli.groups import with_groups
from qlvbayes.cli.options import (
    Files,
    ModelOptions,
    Out,
    Pads,
    References,
    Seed,
    Style,
    WorkOptions,
)
from qlvbayes.io.catalogue import METHODS
from qlvbayes.io.checks import check_known

if TYPE_CHECKING:
    from qlvbayes.io.data import Measurements
    from qlvbayes.pipeline.fitting import FitStep


@with_groups
def fit(
    file: Files,
    output: Out,
    pads: Pads = "",
    method: Annotated[str, typer.Option(help=f"One of {', '.join(METHODS)}.")] = "emcee",
    all_tests: Annotated[bool, typer.Option("--all-tests", help="Fit every test.")] = False,
    *,
    model: ModelOptions,
    work: WorkOptions,
    walkers: Annotated[int, typer.Option(min=4, help="Walkers of the ensemble.")] = 32,
    max_steps: Annotated[int, typer.Option(min=10, help="Steps at most.")] = 100_000,
    references: References = None,
    style: Style = None,
    seed: Seed = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print summaries as JSON.")] = False,
) -> None:
    """Fit the QLV model to each pad's tests whose role is 'fit'; sample its posterior.

    Leaves OUT/<pad>/posterior.nc (ArviZ), summary.json and the figures FIGURES; of
    all pads in OUT the figure constants, constants.csv and constants.tex. Figures are PNG and PDF.
    An interrupted run resumes when the same command is given again; pads that are finished are not
    fitted again.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal, show_done
    from qlvbayes.fitting.ensemble import Settings
    from qlvbayes.fitting.runs import record_run
    from qlvbayes.pipeline.drawing import draw_constants, find_references
    from qlvbayes.pipeline.fitting import FitStep
    from qlvbayes.pipeline.many import raise_failed, run_step

    settings = Settings(walkers=walkers, max_steps=max_steps, seed=seed)
    check_known("method", method, METHODS)
    watcher = Terminal(quiet=as_json)
    source = watcher.reading(file, pads, work.part)
    choices = model.choices_of(source)
    reference_file = find_references(source.location, references)

    def step(study: Measurements) -> FitStep:
        return FitStep(model.choices(study), method, all_tests, settings)

    with work.engine() as engine:
        done = run_step(output, source, step, engine=engine, watcher=watcher)
    if done.pads:
        run_settings = {"method": method, "all_tests": all_tests, "sampler": settings}
        record_run(output, "fit", command_line(), source.whole, choices, seed, run_settings)
        if source.shard.count == 1:
            with waiting("figures of all pads"):
                draw_constants(output, reference_file)
    show_done(output, done, "summary.json", as_json=as_json)
    raise_failed([done])
