"""``qlvbayes predict``: what a fitted pad will do in a motion or under a load of your own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from qlvbayes.checks import InputError
from qlvbayes.cli.console import out
from qlvbayes.cli.options import AsJson, Style, split_names
from qlvbayes.cli.terminal import Terminal, show_figures
from qlvbayes.study.comparing import saved_pads

if TYPE_CHECKING:
    from qlvbayes.prescribed.forecast import Forecast
    from qlvbayes.results import Saved


def predict_command(
    folder: Annotated[Path, typer.Argument(help="The folder that 'fit' wrote.")],
    program: Annotated[
        str,
        typer.Option(
            help="A CSV file with time_s and displacement_mm, or time_s and force_N; or text: "
            "'ramp 1.6 mm at 20 mm/s, hold 30 s, sine 0.1 mm 1 Hz 10 cycles', 'force 1 N in 0.1 s, "
            "hold 30 s'."
        ),
    ],
    pad: Annotated[str, typer.Option(help="Only these pads, as 'B,C'. Default: all.")] = "",
    style: Style = None,
    as_json: AsJson = False,
) -> None:
    """Predict the force of a prescribed displacement, or the displacement of a prescribed force.

    With 50 and 90 % bands of the posterior, the fit's effects included, noise not. The platen does
    exactly what the program says. Warns where it leaves the depths, speeds and times that were
    tested. Leaves OUT/<pad>/prediction.json, prediction.csv and the figure prediction (PNG and
    PDF).
    """
    # here, so that other commands do not wait for matplotlib
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.prediction import plot_prediction
    from qlvbayes.prescribed.forecast import predict_program
    from qlvbayes.prescribed.writing import content, write_forecast

    watcher = Terminal(quiet=as_json)
    found, figures = [], []
    for saved in _chosen(saved_pads(folder), folder, pad):
        with watcher.doing(f"pad {saved.pad}"):
            forecast = predict_program(saved, program)
            place = folder / saved.pad
            write_forecast(place, forecast)
            figures.append(save_figure(plot_prediction(forecast), place / "prediction"))
        for warning in forecast.warnings:
            watcher.notice(f"pad {saved.pad}: {warning}")
        found.append(forecast)
    if as_json:
        print(json.dumps([content(forecast) for forecast in found], allow_nan=False))
        return
    out.print(_table(found))
    show_figures(figures)


def _chosen(found: Sequence[Saved], folder: Path, pads: str) -> list[Saved]:
    known = {saved.pad: saved for saved in found}
    for name in (names := split_names(pads)):
        if name not in known:
            raise InputError(
                f"no fit of pad '{name}'", file=folder, remedy=f"name of {', '.join(known)}"
            )
    return [known[name] for name in names] if names else list(found)


def _table(found: Sequence[Forecast]) -> Table:
    """The answer's largest value and its last, with 90 % bands."""
    first = found[0]
    moved = first.program.quantity == "displacement"
    name = first.units.force_name if moved else first.units.displacement_name
    table = Table(title=first.program.told)
    for column in ("pad", f"largest {name}", "90 % band", f"last {name}", "90 % band"):
        table.add_column(column, justify="left" if column == "pad" else "right")
    for forecast in found:
        unit = forecast.units.force if moved else forecast.units.displacement
        low, high = forecast.band(0.9)
        cells = [forecast.pad]
        for k in (int(forecast.median.argmax()), -1):
            cells += [f"{forecast.median[k]:.4g} {unit}", f"{low[k]:.4g} to {high[k]:.4g}"]
        table.add_row(*cells)
    return table
