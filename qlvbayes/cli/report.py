"""``qlvbayes report``: the results of a study as one page."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from qlvbayes.cli.console import out, waiting
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import write_whole


def report(
    folder: Annotated[
        Path,
        typer.Argument(help="The folder with the results, or a session that the bench saved."),
    ],
) -> None:
    """Write OUT/report.html anew from what lies in OUT: one page that opens offline.

    It says what was not done yet, and which command does it. The page of a saved session
    (SESSION.zip) is SESSION.html next to it.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.report.page import write_report

    with waiting("report"):
        path = _of_session(folder) if folder.suffix.lower() == ".zip" else write_report(folder)
    out.print(f"report in {path}", soft_wrap=True)


def _of_session(archive: Path) -> Path:
    from qlvbayes.app.intake import opened
    from qlvbayes.report.page import write_report

    if not archive.is_file():
        raise InputError("no such file", file=archive, remedy="check the path")
    path = archive.with_suffix(".html")
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / archive.stem
        opened(folder, archive)
        write_whole(path, write_report(folder).read_bytes())
    return path
