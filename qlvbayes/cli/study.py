"""``qlvbayes study``: every step from measurements to the report."""

from __future__ import annotations

from qlvbayes.cli.command import with_groups
from qlvbayes.cli.console import command_line, out
from qlvbayes.cli.options import InputOptions, Out, SettingsSeed, WorkOptions
from qlvbayes.parallel.running import FailedError


@with_groups
def study_command(
    inputs: InputOptions,
    output: Out,
    *,
    work: WorkOptions,
    seed: SettingsSeed = None,
) -> None:
    """Do everything: fit, check, diagnose, add what is missing, refit, check, compare, report.

    First it shows what is in the tests, as 'look' does (OUT/look.json, OUT/look_<pad>.png).
    The plain model's fit and check are kept in OUT/<pad>/plain; OUT/<pad> holds the diagnosis and,
    with the effects that it names, the fit to all tests and its check. Where nothing is named,
    OUT/<pad> holds the plain model. OUT/report.html has all results in one file, and OUT/study.toml
    all that was chosen: 'study --settings OUT/study.toml' repeats it.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal
    from qlvbayes.diagnosis.phrases import terminal_line
    from qlvbayes.pipeline.run import run_study
    from qlvbayes.report.page import REPORT

    chosen = inputs.chosen
    seed = chosen.seed(seed)
    sampler, thresholds = chosen.sampler(seed), chosen.thresholds()
    watcher = Terminal()
    source = watcher.reading(inputs, work.part)
    chosen.choices_of(source)  # an unusable setting is refused before the work
    failed = None
    with work.engine() as engine:
        try:
            verdicts = run_study(
                source,
                output,
                choices=chosen.choices,
                settings=sampler,
                thresholds=thresholds,
                watcher=watcher,
                command=command_line(),
                references=chosen["references"],
                client=engine,
            )
        except FailedError as error:
            failed, verdicts = error, error.results
    for result in verdicts:
        out.print(terminal_line(result), soft_wrap=True)
    if verdicts:
        chosen.write(output, inputs.paths, inputs.pad_words, seed)
    if source.shard.count > 1:
        out.print(f"results in {output}; all parts together: qlvbayes report {output} --gather")
    elif verdicts:
        out.print(f"results in {output}; open {output / REPORT} in a browser")
    watcher.took()
    if failed is not None:
        raise failed
