"""``qlvbayes fit``: from measurements to the constants of each pad."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from qlvbayes.cli.command import with_groups
from qlvbayes.cli.console import command_line, waiting
from qlvbayes.cli.options import AsJson, InputOptions, Out, SettingsSeed, WorkOptions
from qlvbayes.io.catalogue import METHODS
from qlvbayes.io.checks import check_known

if TYPE_CHECKING:
    from qlvbayes.io.data import Measurements
    from qlvbayes.pipeline.steps import FitStep


@with_groups
def fit(
    inputs: InputOptions,
    output: Out,
    all_tests: Annotated[bool, typer.Option("--all-tests", help="Fit every test.")] = False,
    *,
    work: WorkOptions,
    seed: SettingsSeed = None,
    as_json: AsJson = False,
) -> None:
    """Fit the QLV model to each pad's tests whose role is 'fit'; sample its posterior.

    Leaves OUT/<pad>/posterior.nc (ArviZ), summary.json and the figures FIGURES; of
    all pads in OUT the figure constants, constants.csv and constants.tex. Figures are PNG and PDF.
    An interrupted run resumes when the same command is given again; pads that are finished are not
    fitted again.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal, show_done
    from qlvbayes.fitting.results import record_run
    from qlvbayes.pipeline.derived import draw_constants, find_references
    from qlvbayes.pipeline.many import raise_failed, run_steps
    from qlvbayes.pipeline.steps import FitStep

    chosen = inputs.chosen
    seed = chosen.seed(seed)
    settings, method = chosen.sampler(seed), chosen["method"] or METHODS[0]
    check_known("method", method, METHODS)
    watcher = Terminal(quiet=as_json)
    source = watcher.reading(inputs, work.part)
    choices = chosen.choices_of(source)
    reference_file = find_references(source.location, chosen["references"])
    source = source.kept(output)

    def steps(study: Measurements) -> tuple[FitStep]:
        return (FitStep(chosen.choices(study), method, all_tests, settings),)

    with work.engine() as engine:
        done = run_steps(output, source, steps, engine=engine, watcher=watcher)
    if done.pads:
        run_settings = {"method": method, "all_tests": all_tests, "sampler": settings}
        record_run(output, "fit", command_line(), source.whole, choices, seed, run_settings)
        if source.shard.count == 1:
            with waiting("figures of all pads"):
                draw_constants(output, reference_file)
    show_done(output, done, "summary.json", as_json=as_json)
    watcher.took()
    raise_failed(done)
