"""From a folder of results to one HTML file."""

from __future__ import annotations

from pathlib import Path

from qlvbayes.io.files import write_whole
from qlvbayes.report.collect import collect
from qlvbayes.report.page import page

REPORT = "report.html"


def write_report(out: str | Path) -> Path:
    """Write ``out/report.html`` from what lies in ``out``; return where it is.

    One file that opens without a network: verdicts, constants, comparisons, errors by test and
    phase, curves to zoom into, missing effects, methods. Steps that were not done are named with
    the command that does them.

    Parameters
    ----------
    out
        The folder of results.

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    InputError
        There are no results, or a file of them cannot be read.
    """
    folder = Path(out)
    path = folder / REPORT
    write_whole(path, page(collect(folder)).encode())
    return path
