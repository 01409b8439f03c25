"""``qlvbayes diagnose``: which physical effect is missing, if any."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qlvbayes.cli.command import with_groups
from qlvbayes.cli.console import command_line
from qlvbayes.cli.options import AsJson, InputOptions, Out, SettingsSeed, WorkOptions

if TYPE_CHECKING:
    from qlvbayes.io.data import Measurements
    from qlvbayes.pipeline.steps import DiagnoseStep


@with_groups
def diagnose_command(
    inputs: InputOptions,
    output: Out,
    *,
    work: WorkOptions,
    seed: SettingsSeed = None,
    as_json: AsJson = False,
) -> None:
    """Say which physical effect the model lacks, with a probability, or that none can be named.

    Looks at all tests of each pad together. Leaves OUT/<pad>/diagnosis.json, diagnosis.txt and the
    figures FIGURES.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal, show_done
    from qlvbayes.fitting.results import record_run
    from qlvbayes.pipeline.many import raise_failed, run_steps
    from qlvbayes.pipeline.steps import DiagnoseStep

    chosen = inputs.chosen
    seed, settings = chosen.seed(seed), chosen.thresholds()
    watcher = Terminal(quiet=as_json)
    source = watcher.reading(inputs, work.part)
    choices = chosen.choices_of(source)
    source = source.kept(output)

    def steps(study: Measurements) -> tuple[DiagnoseStep]:
        return (DiagnoseStep(chosen.choices(study), seed, settings),)

    with work.engine() as engine:
        done = run_steps(output, source, steps, engine=engine, watcher=watcher)
    if done.pads:
        run_settings = {"thresholds": settings}
        record_run(output, "diagnose", command_line(), source.whole, choices, seed, run_settings)
    show_done(output, done, "diagnosis.json", as_json=as_json)
    watcher.took()
    raise_failed(done)
