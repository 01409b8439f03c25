"""``qlvbayes check``: how well a fit predicts the tests that it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qlvbayes.cli.command import with_groups
from qlvbayes.cli.console import out
from qlvbayes.cli.options import AsJson, Data, Fitted, Pads, Seed, WorkOptions, known_names
from qlvbayes.cli.predict import Program, Which, predict_command
from qlvbayes.io.checks import InputError
from qlvbayes.parallel.running import Fault


@with_groups
def check(
    folder: Fitted,
    pads: Pads = "",
    data: Data = None,
    program: Program = "",
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
    from qlvbayes.pipeline.derived import draw_forces_at_rates
    from qlvbayes.pipeline.many import Work, raise_failed, run_pads
    from qlvbayes.pipeline.run import saved_studies
    from qlvbayes.pipeline.steps import CheckStep
    from qlvbayes.plots.catalogue import pictures_of

    part = work.part
    fitted = sorted(file.parent.name for file in folder.glob("*/posterior.nc"))
    names = part.part((known_names(pads, fitted, folder) if fitted else []) or fitted)
    if not names and part.count == 1:
        raise InputError("no fit in this folder", file=folder, remedy="run qlvbayes fit first")
    watcher = Terminal(quiet=as_json)
    step = CheckStep(seed)
    studies = saved_studies(folder, names, data=data)
    todo = (one if isinstance(one, Fault) else Work((step,), one, folder) for one in studies)
    with work.engine() as engine:
        done = run_pads(folder, todo, size=len(names), engine=engine, watcher=watcher)
    figures = [path for pad in done.pads for path in pictures_of("check", folder / pad)]
    figures += draw_forces_at_rates(folder) if part.count == 1 and done.pads else []
    if as_json or not done.pads:
        show_done(folder, done, "check.json", as_json=as_json)
    else:
        _show_constants([folder / name for name in names])
        show_figures(figures)
    raise_failed(done)


def _show_constants(folders: Sequence[Path]) -> None:
    from qlvbayes.cli.tables import pads_table
    from qlvbayes.fitting.summary import FitSummary
    from qlvbayes.report.page import MOST_ON_A_PAGE

    paths = [folder / "summary.json" for folder in folders]
    summaries = [FitSummary.read(path) for path in paths if path.exists()]
    if 0 < len(summaries) <= MOST_ON_A_PAGE:
        out.print(pads_table(summaries))
