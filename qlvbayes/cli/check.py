"""``qlvbayes check``: how well a fit predicts the tests that it has not seen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.cli.console import out
from qlvbayes.cli.options import Fitted, Seed, Style
from qlvbayes.cli.tables import pads_table
from qlvbayes.cli.terminal import Terminal, show_figures
from qlvbayes.fitting.results import Saved, load
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.pipeline.checking import check_into
from qlvbayes.pipeline.drawing import draw_forces_at_rates


def check(
    folder: Fitted,
    data: Annotated[
        Path | None, typer.Option(help="The measurements, if they have moved since the fit.")
    ] = None,
    style: Style = None,
    seed: Seed = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Predict every test with the fitted posterior, by test and phase, against the noise floor.

    Leaves OUT/<pad>/check.json, curves.json and the figures forces, hysteresis and residual_map
    (PNG and PDF); for two pads or more the figure OUT/forces_at_rates too.
    """
    files = sorted(folder.glob("*/posterior.nc"))
    if not files:
        raise InputError("no fit in this folder", file=folder, remedy="run qlvbayes fit first")
    studies: dict[Path, Measurements] = {}
    watcher = Terminal(quiet=as_json)
    found, figures = [], []
    for file in files:
        saved = load(file)
        source = data or Path(saved.source)
        if source not in studies:
            studies[source] = _study(source, saved)
        checked, drawn = check_into(file.parent, saved, studies[source], seed=seed, watcher=watcher)
        figures += drawn
        found.append(checked)
    figures += draw_forces_at_rates(folder, found)
    if as_json:
        print(json.dumps([checked.check.as_dict() for checked in found], allow_nan=False))
        return
    _show_constants(files)
    show_figures(figures)


def _study(source: Path, saved: Saved) -> Measurements:
    if not saved.source and source == Path():
        raise InputError(
            f"the posterior of pad {saved.pad} does not say where its measurements are",
            remedy="say where they are with --data FILE",
        )
    if not source.exists():
        raise InputError(
            "the measurements are no longer here",
            file=source,
            remedy="say where they are with --data FILE",
        )
    study = read_measurements(source)
    if saved.sha256 and study.sha256 != saved.sha256:
        raise InputError(
            "the file has changed since the fit", file=source, remedy="run qlvbayes fit again"
        )
    return study


def _show_constants(files: list[Path]) -> None:
    summaries = [file.with_name("summary.json") for file in files]
    found = [FitSummary.read(path) for path in summaries if path.exists()]
    if found:
        out.print(pads_table(found))
