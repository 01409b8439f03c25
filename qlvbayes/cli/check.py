"""``qlvbayes check``: how well a fit predicts the tests that it has not seen."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from qlvbayes.cli.console import out
from qlvbayes.cli.groups import with_groups
from qlvbayes.cli.options import Fitted, Seed, Style, WorkOptions
from qlvbayes.io.checks import InputError
from qlvbayes.parallel.faults import Fault, fault_of

if TYPE_CHECKING:
    from qlvbayes.pipeline.gathering import Reader
    from qlvbayes.pipeline.many import Work


@with_groups
def check(
    folder: Fitted,
    data: Annotated[
        Path | None,
        typer.Option(help="The measurements, if they have moved since the fit: file or folder."),
    ] = None,
    *,
    work: WorkOptions,
    style: Style = None,
    seed: Seed = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Predict every test with the fitted posterior, by test and phase, against the noise floor.

    Leaves OUT/<pad>/check.json, curves.json and the figures FIGURES (PNG and
    PDF); for two pads or more the figure OUT/forces_at_rates too.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal, show_done, show_figures
    from qlvbayes.pipeline.drawing import draw_forces_at_rates
    from qlvbayes.pipeline.gathering import Reader
    from qlvbayes.pipeline.many import raise_failed, run_pads
    from qlvbayes.plots.catalogue import pictures_of

    part = work.part
    files = part.part(sorted(folder.glob("*/posterior.nc")))
    if not files and part.count == 1:
        raise InputError("no fit in this folder", file=folder, remedy="run qlvbayes fit first")
    watcher = Terminal(quiet=as_json)
    with work.engine() as engine:
        todo = _work(files, Reader(data), seed)
        done = run_pads(folder, todo, size=len(files), engine=engine, watcher=watcher)
    figures = [path for pad in done.pads for path in pictures_of("check", folder / pad)]
    figures += draw_forces_at_rates(folder) if part.count == 1 and done.pads else []
    if as_json or not done.pads:
        show_done(folder, done, "check.json", as_json=as_json)
    else:
        _show_constants(files)
        show_figures(figures)
    raise_failed([done])


def _work(files: Sequence[Path], reader: Reader, seed: int) -> Iterator[Work | Fault]:
    from qlvbayes.fitting.results import load
    from qlvbayes.pipeline.checking import CheckStep
    from qlvbayes.pipeline.many import Work

    for file in files:
        try:
            study = reader.study(load(file))
        except Exception as error:  # one fit without measurements must not stop the others
            yield replace(fault_of(error), of=f"pad {file.parent.name}")
            continue
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        yield Work(CheckStep(digest, seed), study, file.parent)


def _show_constants(files: Sequence[Path]) -> None:
    from qlvbayes.cli.tables import pads_table
    from qlvbayes.fitting.summary import FitSummary
    from qlvbayes.report.page import MOST_ON_A_PAGE

    paths = [file.with_name("summary.json") for file in files]
    summaries = [FitSummary.read(path) for path in paths if path.exists()]
    if 0 < len(summaries) <= MOST_ON_A_PAGE:
        out.print(pads_table(summaries))
