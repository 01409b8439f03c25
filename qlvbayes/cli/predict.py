"""``qlvbayes check --program``: what a pad will do in a motion or under a load of your own."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.table import Table

from qlvbayes.cli.console import out, table
from qlvbayes.cli.options import known_names
from qlvbayes.cli.terminal import Terminal, show_figures
from qlvbayes.fitting.results import Saved
from qlvbayes.io.checks import check_known
from qlvbayes.pipeline.derived import fitted_pads, saved_pads
from qlvbayes.plots.catalogue import save_figures
from qlvbayes.use.prescribed.forecast import Forecast, content, predict_program, write_forecast
from qlvbayes.use.prescribed.hypotheses import FILE, Hypotheses


def predict(folder: Path, program: str, pads: str, hypotheses: str, *, as_json: bool) -> None:
    """Predict the force of a prescribed displacement, or the displacement of a prescribed force.

    With bands of the posterior, the fit's effects included, noise not; where the diagnosis left
    several ``hypotheses``, "averaged" over them, or "fitted". The platen does exactly what the
    program says. Warns where it leaves what was tested.
    """
    check_known("way", hypotheses, ("averaged", "fitted"))
    watcher = Terminal(quiet=as_json)
    forecasts, figures = [], []
    for source in _sources(folder, pads, hypotheses == "averaged", watcher):
        with watcher.doing(f"pad {source.pad}"):
            forecast = predict_program(source, program)
            write_forecast(folder / source.pad, forecast)
            figures += save_figures("check --program", folder / source.pad, forecast)
        if several := forecast.averaged:
            count = "1 hypothesis" if len(several) == 1 else f"{len(several)} hypotheses"
            share = 100.0 * sum(one.probability for one in several)
            watcher.notice(
                f"pad {forecast.pad}: averaged over {count} of the diagnosis, {share:.0f} % of the "
                f"probability: {'; '.join(map(str, several))}"
            )
        watcher.notice(*(f"pad {forecast.pad}: {warning}" for warning in forecast.warnings))
        forecasts.append(forecast)
    if as_json:
        print(json.dumps([content(forecast) for forecast in forecasts], allow_nan=False))
        return
    out.print(_table(forecasts))
    show_figures(figures)


def _sources(
    folder: Path, pads: str, averaged: bool, watcher: Terminal
) -> Iterator[Saved | Hypotheses]:
    """Yield of each named pad, by default all, its fit, or the hypotheses where they say more.

    They are of the fit's tests; only they know by how much stiffness and strengths scatter.
    """
    diagnosed = {file.parent.name for file in folder.glob(f"*/{FILE}") if averaged}
    alone = diagnosed and not any(folder.glob("*/posterior.nc"))
    fitted = set() if alone else set(fitted_pads(folder))
    known = sorted(fitted | diagnosed)
    for name in known_names(pads, known, folder) or known:
        fit = saved_pads(folder, [name])[0] if name in fitted else None
        left = Hypotheses.read(folder / name / FILE) if name in diagnosed else None
        if left and fit and fit.covered not in (None, left.covered):
            other = "its diagnosis is of other tests than its fit, and left out"
            watcher.notice(f"pad {name}: {other}")
            yield fit
        elif left is not None and (fit is None or left.says_more):
            yield left
        elif fit is not None:
            yield fit


def _table(forecasts: Sequence[Forecast]) -> Table:
    """Return a table of the largest and the last predicted value, with 90 % bands."""
    first = forecasts[0]
    moved = first.program.quantity == "displacement"
    name = first.units.force_name if moved else first.units.displacement_name
    columns = ("pad", f">largest {name}", ">90 % band", f">last {name}", ">90 % band")
    made = table(first.program.title, *columns)
    for forecast in forecasts:
        unit = forecast.units.force if moved else forecast.units.displacement
        low, high = forecast.band(0.9)
        cells = [forecast.pad]
        for k in (int(forecast.median.argmax()), -1):
            cells += [f"{forecast.median[k]:.4g} {unit}", f"{low[k]:.4g} to {high[k]:.4g}"]
        made.add_row(*cells)
    return made
