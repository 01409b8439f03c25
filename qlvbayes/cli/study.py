"""``qlvbayes study``, and its steps as commands: ``fit``, ``check``, ``diagnose``, ``report``.

What the help does not need is imported in the functions.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qlvbayes.cli.console import command_line, out, waiting
from qlvbayes.cli.options import InputOptions, WorkOptions, known_names
from qlvbayes.io.catalogue import METHODS
from qlvbayes.io.checks import check_known
from qlvbayes.parallel.running import FailedError

if TYPE_CHECKING:
    from qlvbayes.model.choices import Choices
    from qlvbayes.pipeline.steps import Step


def study(
    inputs: InputOptions, output: Path, *, work: WorkOptions, seed: int | None = None
) -> None:
    """Do everything: fit, check, diagnose, add what is missing, refit, check, compare, report.

    First it shows what is in the tests, as 'look' does (OUT/look.json, OUT/look_<pad>.png).
    The plain model's fit and check are kept in OUT/<pad>/plain; OUT/<pad> holds the diagnosis and,
    with the effects that it names, the fit to all tests and its check. Where nothing is named,
    OUT/<pad> holds the plain model. OUT/report.html has all results in one file, and OUT/study.toml
    all that was chosen: 'study --settings OUT/study.toml' repeats it.

    Options:
    seed 0..: Makes a run repeat. Default: that of the settings, or 0.
    """
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
                source, output, choices=chosen.choices, settings=sampler, thresholds=thresholds,
                watcher=watcher, command=command_line(), references=chosen["references"],
                client=engine,
            )  # fmt: skip
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


def fit(
    inputs: InputOptions,
    output: Path,
    all_tests: bool = False,
    *,
    work: WorkOptions,
    seed: int | None = None,
    as_json: bool = False,
) -> None:
    """Fit the QLV model to each pad's tests whose role is 'fit'; sample its posterior.

    Leaves OUT/<pad>/posterior.nc (ArviZ), summary.json and the figures FIGURES; of
    all pads in OUT the figure constants, constants.csv and constants.tex. Figures are PNG and PDF.
    An interrupted run resumes when the same command is given again; pads that are finished are not
    fitted again.

    Options:
    all_tests: Fit every test.
    seed 0..: Makes a run repeat. Default: that of the settings, or 0.
    """
    from qlvbayes.pipeline.steps import FitStep

    chosen = inputs.chosen
    sampler, method = chosen.sampler(chosen.seed(seed)), chosen["method"] or METHODS[0]
    check_known("method", method, METHODS)
    used = {"method": method, "all_tests": all_tests, "sampler": sampler}
    step = partial(FitStep, method=method, all_tests=all_tests, settings=sampler)
    _run_step(step, inputs, output, work, seed=sampler.seed, used=used, as_json=as_json)


def diagnose(
    inputs: InputOptions,
    output: Path,
    *,
    work: WorkOptions,
    seed: int | None = None,
    as_json: bool = False,
) -> None:
    """Say which physical effect the model lacks, with a probability, or that none can be named.

    Looks at all tests of each pad together. Leaves OUT/<pad>/diagnosis.json, diagnosis.txt and the
    figures FIGURES.

    Options:
    seed 0..: Makes a run repeat. Default: that of the settings, or 0.
    """
    from qlvbayes.pipeline.steps import DiagnoseStep

    chosen = inputs.chosen
    number, thresholds = chosen.seed(seed), chosen.thresholds()
    step = partial(DiagnoseStep, seed=number, thresholds=thresholds)
    used = {"thresholds": thresholds}
    _run_step(step, inputs, output, work, seed=number, used=used, as_json=as_json)


def _run_step(
    step: Callable[[Choices], Step],
    inputs: InputOptions,
    output: Path,
    work: WorkOptions,
    *,
    seed: int,
    used: dict[str, Any],
    as_json: bool,
) -> None:
    """Do one step of every pad, record the run with what it ``used``, and print where it is."""
    from qlvbayes.cli.terminal import Terminal, show_done
    from qlvbayes.fitting.results import record_run
    from qlvbayes.fitting.summary import read_references
    from qlvbayes.pipeline.derived import draw_constants
    from qlvbayes.pipeline.many import run_pads

    chosen, watcher = inputs.chosen, Terminal(quiet=as_json)
    source = watcher.reading(inputs, work.part)
    choices, references, place = chosen.choices_of(source), chosen["references"], source.location
    if references:
        read_references(references)  # a file that cannot be used is refused before the work
    one, source = step(choices), source.kept(output)
    with work.engine() as engine:
        done = run_pads(
            output, source, lambda read: (step(chosen.choices(read)),),
            size=source.size, engine=engine, watcher=watcher,
        )  # fmt: skip
    if done.pads:
        record_run(output, one.name, command_line(), source.whole, choices, seed, used)
    if done.pads and one.name == "fit" and source.shard.count == 1:
        with waiting("figures of all pads"):
            draw_constants(output, references, place)
    show_done(output, done, one.leaves, as_json=as_json)
    watcher.took()
    done.raise_failed()


def check(
    folder: Path,
    pads: str = "",
    data: Path | None = None,
    program: str = "",
    hypotheses: str = "averaged",
    *,
    work: WorkOptions,
    seed: int = 0,
    as_json: bool = False,
) -> None:
    """Predict every test with the fitted posterior, by test and phase, against the noise floor.

    Leaves OUT/<pad>/check.json, curves.json and the figures FIGURES (PNG and
    PDF); for two pads or more the figure OUT/forces_at_rates too.

    With --program it predicts what the pads will do in a motion or under a load of your own, with
    50 and 90 % bands, and warns where that leaves what was tested; it leaves
    OUT/<pad>/prediction.json, prediction.csv and the figure prediction.

    Options:
    program: A motion or a load of your own: a CSV file with time_s and displacement_mm, or time_s
        and force_N; or text, as 'ramp 1.6 mm at 20 mm/s, hold 30 s, sine 0.1 mm 1 Hz 10 cycles' or
        'force 1 N in 0.1 s, hold 30 s'.
    hypotheses: Of a program: averaged over all that 'diagnose' left, where that was done; fitted:
        the model that 'fit' sampled, alone.
    """
    if program:
        from qlvbayes.cli.predict import predict

        predict(folder, program, pads, hypotheses, as_json=as_json)
        return
    from qlvbayes.cli.tables import pads_table
    from qlvbayes.cli.terminal import Terminal, show_done, show_figures
    from qlvbayes.fitting.summary import FitSummary
    from qlvbayes.pipeline.derived import draw_forces_at_rates, fitted_pads
    from qlvbayes.pipeline.many import run_pads
    from qlvbayes.pipeline.run import saved_studies
    from qlvbayes.pipeline.steps import CheckStep
    from qlvbayes.plots.catalogue import pictures_of
    from qlvbayes.report.page import MOST_ON_A_PAGE

    part, fitted = work.part, fitted_pads(folder)
    names = part.part(known_names(pads, fitted, folder) or fitted)
    studies = saved_studies(folder, names, data=data)
    step = CheckStep(seed)
    with work.engine() as engine:
        done = run_pads(
            folder, studies, lambda study: (step,), size=len(names), engine=engine,
            watcher=Terminal(quiet=as_json),
        )  # fmt: skip
    figures = [path for pad in done.pads for path in pictures_of("check", folder / pad)]
    figures += draw_forces_at_rates(folder) if part.count == 1 and done.pads else []
    if as_json or not done.pads:
        show_done(folder, done, step.leaves, as_json=as_json)
    else:
        paths = [folder / name / "summary.json" for name in names]
        summaries = [FitSummary.read(path) for path in paths if path.exists()]
        if 0 < len(summaries) <= MOST_ON_A_PAGE:
            out.print(pads_table(summaries))
        show_figures(figures)
    done.raise_failed()


def report(
    folder: Path, gather: bool = False, jobs: str = "1", references: Path | None = None
) -> None:
    """Write OUT/report.html anew from what lies in OUT: one page that opens offline.

    It says what was not done yet, and which command does it. With --gather parts that are not done
    yet are left out, the same command adds them later, and pads that failed are named.

    Options:
    folder FOLDER: The folder with the results.
    gather: First make tables and comparisons of the pads that are there: after a run in parts
        (--shard).
    references: With --gather: values to show next to the constants, as of 'fit'.
    """
    from qlvbayes.report.page import REPORT, write_report

    if not gather:
        with waiting("report"):
            path = write_report(folder)
        out.print(f"report in {path}", soft_wrap=True)
        return
    from qlvbayes.cli.terminal import Terminal
    from qlvbayes.pipeline.run import gather as gathered

    with WorkOptions(jobs).engine() as engine:
        done = gathered(folder, references=references, engine=engine, watcher=Terminal())
    count = len(done.pads)
    out.print(f"{count} pad{'' if count == 1 else 's'} in {folder}, report in {folder / REPORT}")
    done.raise_failed()
