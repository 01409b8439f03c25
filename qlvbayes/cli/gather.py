"""``qlvbayes gather``: what was done in parts, put together."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.cli.console import out
from qlvbayes.cli.options import Cluster, Jobs, References, Style
from qlvbayes.io.runtime import cores
from qlvbayes.parallel.engines import opened_engine
from qlvbayes.parallel.faults import FailedError


def gather_command(
    folder: Annotated[Path, typer.Argument(help="The folder that the parts wrote into.")],
    jobs: Jobs = 1,
    cluster: Cluster = None,
    references: References = None,
    style: Style = None,
) -> None:
    """Make tables, comparison and report of the pads that are there, after a run with --shard.

    Parts that are not done yet are left out; the same command adds them later. In a study, pads
    whose last fit depends on the effects of other pads are fitted first. Leaves what the same run
    without --shard leaves, and names the pads that failed.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal
    from qlvbayes.pipeline.gathering import gather
    from qlvbayes.report.page import REPORT

    with opened_engine(jobs or cores(), cluster) as engine:
        tally = gather(folder, references=references, engine=engine, watcher=Terminal())
    count = len(tally.pads)
    out.print(f"{count} pad{'' if count == 1 else 's'} in {folder}, report in {folder / REPORT}")
    if tally.faults:
        raise FailedError(tally.faults, tally.total)
