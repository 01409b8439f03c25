"""``qlvbayes check``: how well a fit predicts the tests that it has not seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from qlvbayes.cli.console import out
from qlvbayes.cli.groups import with_groups
from qlvbayes.cli.options import AsJson, Data, Fitted, Pads, Seed, WorkOptions, known_names
from qlvbayes.cli.predict import Which, predict_command
from qlvbayes.io.checks import InputError
from qlvbayes.parallel.faults import Fault, fault_of

if TYPE_CHECKING:
    from qlvbayes.pipeline.finals import Reader
    from qlvbayes.pipeline.many import Work


@with_groups
def check(
    folder: Fitted,
    pads: Pads = "",
    data: Data = None,
    program: Annotated[
        str,
        typer.Option(
            help="A motion or a load of your own to predict in place of the tests: a CSV file with "
            "time_s and displacement_mm, or time_s and force_N; or text, as 'ramp 1.6 mm at 20 "
            "mm/s, hold 30 s, sine 0.1 mm 1 Hz 10 cycles' or 'force 1 N in 0.1 s, hold 30 s'."
        ),
    ] = "",
    hypotheses: Which = "averaged",
    *,
    work: WorkOptions,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Predict every test with the fitted posterior, by test and phase, against the noise floor.

    Leaves OUT/<pad>/check.json, curves.json and the figures FIGURES (PNG and
    PDF); for two pads or more the figure OUT/forces_at_rates too.

    With --program it predicts what the pads will do in a motion or under a load of your own, with
    50 and 90 % bands, and warns where that leaves what was tested; it leaves
    OUT/<pad>/prediction.json, prediction.csv and the figure prediction.
    """
    if program:
        predict_command(folder, program, pads, hypotheses, as_json)
        return
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal, show_done, show_figures
    from qlvbayes.pipeline.drawing import draw_forces_at_rates
    from qlvbayes.pipeline.finals import Reader
    from qlvbayes.pipeline.many import raise_failed, run_pads
    from qlvbayes.plots.catalogue import pictures_of

    part = work.part
    fitted = {file.parent.name: file for file in sorted(folder.glob("*/posterior.nc"))}
    names = known_names(pads, fitted, folder) if fitted else []
    files = part.part([fitted[name] for name in names or fitted])
    if not files and part.count == 1:
        raise InputError("no fit in this folder", file=folder, remedy="run qlvbayes fit first")
    watcher = Terminal(quiet=as_json)
    with work.engine() as engine:
        todo = _work(folder, files, Reader(data), seed)
        done = run_pads(folder, todo, size=len(files), engine=engine, watcher=watcher)
    figures = [path for pad in done.pads for path in pictures_of("check", folder / pad)]
    figures += draw_forces_at_rates(folder) if part.count == 1 and done.pads else []
    if as_json or not done.pads:
        show_done(folder, done, "check.json", as_json=as_json)
    else:
        _show_constants(files)
        show_figures(figures)
    raise_failed([done])


def _work(folder: Path, files: Sequence[Path], reader: Reader, seed: int) -> Iterator[Work | Fault]:
    from qlvbayes.fitting.results import load
    from qlvbayes.pipeline.many import Work
    from qlvbayes.pipeline.steps import CheckStep

    for file in files:
        try:
            study = reader.study(load(file))
        except Exception as error:  # one fit without measurements must not stop the others
            yield replace(fault_of(error), of=f"pad {file.parent.name}")
            continue
        yield Work((CheckStep(seed),), study, folder)


def _show_constants(files: Sequence[Path]) -> None:
    from qlvbayes.cli.tables import pads_table
    from qlvbayes.fitting.summary import FitSummary
    from qlvbayes.report.page import MOST_ON_A_PAGE

    paths = [file.with_name("summary.json") for file in files]
    summaries = [FitSummary.read(path) for path in paths if path.exists()]
    if 0 < len(summaries) <= MOST_ON_A_PAGE:
        out.print(pads_table(summaries))
