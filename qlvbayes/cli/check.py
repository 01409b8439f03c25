"""``qlvbayes check``: how well a fit predicts the tests that it has not seen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.checked import CheckedPad, check_pad
from qlvbayes.checks import InputError
from qlvbayes.cli.console import out, waiting
from qlvbayes.cli.tables import check_table, pads_table
from qlvbayes.data import Study, read_study
from qlvbayes.files import write_json
from qlvbayes.results import Saved, load


def check(
    folder: Annotated[Path, typer.Argument(help="The folder that 'fit' wrote.")],
    data: Annotated[
        Path | None, typer.Option(help="The measurements, if they have moved since the fit.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Makes a run repeat.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Predict every test with the fitted posterior, by test and phase, against the noise floor.

    Leaves OUT/<pad>/check.json and the figures forces and residual_map (PNG and PDF).
    """
    files = sorted(folder.glob("*/posterior.nc"))
    if not files:
        raise InputError("no fit in this folder", file=folder, remedy="run qlvbayes fit first")
    studies: dict[Path, Study] = {}
    reports, figures = [], []
    for file in files:
        saved = load(file)
        source = data or Path(saved.source)
        if source not in studies:
            studies[source] = _study(source, saved)
        checked, drawn = check_one(saved, studies[source], file.parent, seed, as_json)
        figures += drawn
        reports.append(checked.check.as_dict())
    if as_json:
        print(json.dumps(reports, allow_nan=False))
        return
    _show_constants(files)
    out.print("figures:", *(f"  {path}" for path in figures), sep="\n", markup=False)


def check_one(
    saved: Saved, study: Study, folder: Path, seed: int, quiet: bool
) -> tuple[CheckedPad, list[Path]]:
    """Check one pad, write its results and figures, show its errors."""
    with waiting(f"pad {saved.pad}: predicting"):
        checked = check_pad(saved, study.pad(saved.pad), seed=seed)
        write_json(folder / "check.json", checked.check.as_dict())
        figures = _figures(checked, folder)
    if not quiet:
        units = checked.experiment.units
        out.print(check_table(checked.check, units.force, units.speed))
    return checked, figures


def _study(source: Path, saved: Saved) -> Study:
    if not source.exists():
        raise InputError(
            "the measurements are no longer here",
            file=source,
            remedy="say where they are with --data FILE",
        )
    study = read_study(source)
    if study.sha256 != saved.sha256:
        raise InputError(
            "the file has changed since the fit", file=source, remedy="run qlvbayes fit again"
        )
    return study


def _figures(checked: CheckedPad, folder: Path) -> list[Path]:
    # here, so that the other commands do not wait for matplotlib
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.forces import plot_forces
    from qlvbayes.plots.residual_map import plot_residual_map

    units = checked.experiment.units
    return [
        save_figure(plot_forces(checked.predictions, units), folder / "forces"),
        save_figure(plot_residual_map(checked.check, units), folder / "residual_map"),
    ]


def _show_constants(files: list[Path]) -> None:
    summaries = [file.with_name("summary.json") for file in files]
    found = [json.loads(path.read_text(encoding="utf-8")) for path in summaries if path.exists()]
    if found:
        out.print(pads_table(found))
