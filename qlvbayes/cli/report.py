"""``qlvbayes report``: the results of a study as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.cli.console import out, waiting


def report(
    folder: Annotated[Path, typer.Argument(help="The folder with the results.")],
) -> None:
    """Write OUT/report.html anew from what lies in OUT: one page that opens offline.

    It says what was not done yet, and which command does it.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.report.page import write_report

    with waiting("report"):
        path = write_report(folder)
    out.print(f"report in {path}", soft_wrap=True)
