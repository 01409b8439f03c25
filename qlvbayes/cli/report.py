"""``qlvbayes report``: the results of a study as one page, also of parts that were run apart."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.cli.console import out, waiting
from qlvbayes.cli.options import Jobs, engine_of_jobs
from qlvbayes.parallel.running import FailedError


def report(
    folder: Annotated[Path, typer.Argument(help="The folder with the results.")],
    gather: Annotated[
        bool,
        typer.Option(
            "--gather",
            help="First make tables and comparisons of the pads that are there: after a run in "
            "parts (--shard).",
        ),
    ] = False,
    jobs: Jobs = "1",
    references: Annotated[
        Path | None,
        typer.Option(help="With --gather: values to show next to the constants, as of 'fit'."),
    ] = None,
) -> None:
    """Write OUT/report.html anew from what lies in OUT: one page that opens offline.

    It says what was not done yet, and which command does it. With --gather parts that are not done
    yet are left out, the same command adds them later, and pads that failed are named.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.report.page import write_report

    if not gather:
        with waiting("report"):
            path = write_report(folder)
        out.print(f"report in {path}", soft_wrap=True)
        return
    from qlvbayes.cli.terminal import Terminal
    from qlvbayes.pipeline.run import gather as gathered
    from qlvbayes.report.page import REPORT

    with engine_of_jobs(jobs) as engine:
        tally = gathered(folder, references=references, engine=engine, watcher=Terminal())
    count = len(tally.pads)
    out.print(f"{count} pad{'' if count == 1 else 's'} in {folder}, report in {folder / REPORT}")
    if tally.faults:
        raise FailedError(tally.faults, tally.total)
