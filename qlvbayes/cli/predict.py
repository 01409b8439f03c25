"""``qlvbayes check --program``: what a pad will do in a motion or under a load of your own."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from qlvbayes.cli.console import out
from qlvbayes.cli.options import AsJson, Fitted, Pads, known_names
from qlvbayes.io.checks import check_known

if TYPE_CHECKING:
    from qlvbayes.cli.terminal import Terminal
    from qlvbayes.fitting.results import Saved
    from qlvbayes.use.prescribed.forecast import Forecast
    from qlvbayes.use.prescribed.hypotheses import Hypotheses

_WHICH = ("averaged", "fitted")


Program = Annotated[
    str,
    typer.Option(
        help="A motion or a load of your own: a CSV file with time_s and displacement_mm, or "
        "time_s and force_N; or text, as 'ramp 1.6 mm at 20 mm/s, hold 30 s, sine 0.1 mm 1 Hz 10 "
        "cycles' or 'force 1 N in 0.1 s, hold 30 s'."
    ),
]
Which = Annotated[
    str,
    typer.Option(
        "--hypotheses",
        help="Of a program: averaged over all that 'diagnose' left, where that was done; fitted: "
        "the model that 'fit' sampled, alone.",
    ),
]


def predict_command(
    folder: Fitted,
    program: Program,
    pads: Pads = "",
    hypotheses: Which = "averaged",
    as_json: AsJson = False,
) -> None:
    """Predict the force of a prescribed displacement, or the displacement of a prescribed force.

    It is 'check --program'. With 50 and 90 % bands of the posterior, the fit's effects included,
    noise not; where the diagnosis left several hypotheses, averaged over them. The platen does
    exactly what the program says. Warns where it leaves the depths, speeds and times that were
    tested. Leaves OUT/<pad>/prediction.json, prediction.csv and the figure prediction (PNG and
    PDF).
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal, show_figures
    from qlvbayes.plots.catalogue import save_figures
    from qlvbayes.use.prescribed.forecast import content, predict_program, write_forecast

    check_known("way", hypotheses, _WHICH)
    watcher = Terminal(quiet=as_json)
    forecasts, figures = [], []
    for source in _sources(folder, pads, hypotheses, watcher):
        with watcher.doing(f"pad {source.pad}"):
            forecast = predict_program(source, program)
            pad_folder = folder / source.pad
            write_forecast(pad_folder, forecast)
            figures += save_figures("check --program", pad_folder, forecast)
        if forecast.averaged:
            watcher.notice(_averaging_words(forecast))
        for warning in forecast.warnings:
            watcher.notice(f"pad {forecast.pad}: {warning}")
        forecasts.append(forecast)
    if as_json:
        print(json.dumps([content(forecast) for forecast in forecasts], allow_nan=False))
        return
    out.print(_table(forecasts))
    show_figures(figures)


def _sources(
    folder: Path, pads: str, which: str, watcher: Terminal
) -> Iterator[Saved | Hypotheses]:
    """Yield each named pad's fit or hypotheses, one after the other, by default of all pads."""
    from qlvbayes.pipeline.derived import fitted_pads, saved_pads
    from qlvbayes.use.prescribed.hypotheses import FILE, Hypotheses

    averaged = which == "averaged"
    diagnosed = {file.parent.name for file in folder.glob(f"*/{FILE}") if averaged}
    alone = diagnosed and not any(folder.glob("*/posterior.nc"))
    fitted = set() if alone else set(fitted_pads(folder))
    known = sorted(fitted | diagnosed)
    for name in known_names(pads, known, folder) or known:
        fit = saved_pads(folder, only=[name])[0] if name in fitted else None
        hypotheses = Hypotheses.read(folder / name / FILE) if name in diagnosed else None
        yield _source(folder / name, fit, hypotheses, which, watcher)


def _source(
    pad_folder: Path,
    fit: Saved | None,
    hypotheses: Hypotheses | None,
    which: str,
    watcher: Terminal,
) -> Saved | Hypotheses:
    """Return the hypotheses where there are several or tests differ, else the fit.

    They are of the fit's tests; only they know by how much stiffness and strengths scatter.
    """
    if hypotheses is not None and fit is not None and fit.covered not in (None, hypotheses.covered):
        watcher.notice(f"pad {fit.pad}: its diagnosis is of other tests than its fit, and left out")
    elif hypotheses is not None and (fit is None or hypotheses.says_more):
        return hypotheses
    elif fit is not None and hypotheses is None and which == "averaged" and _undecided(pad_folder):
        watcher.notice(
            f"pad {fit.pad}: the diagnosis left several hypotheses and not their constants: run "
            "qlvbayes diagnose again to have them averaged over"
        )
    assert fit is not None
    return fit


def _undecided(pad_folder: Path) -> bool:
    """Return whether a diagnosis, whose draws are not saved, left several hypotheses."""
    from qlvbayes.diagnosis.result import DiagnosisResult

    file = pad_folder / "diagnosis.json"
    return file.is_file() and len(DiagnosisResult.read(file).alternatives) > 1


def _averaging_words(forecast: Forecast) -> str:
    several = forecast.averaged
    count = "1 hypothesis" if len(several) == 1 else f"{len(several)} hypotheses"
    share = 100.0 * sum(one.probability for one in several)
    return (
        f"pad {forecast.pad}: averaged over {count} of the diagnosis, {share:.0f} % of the "
        f"probability: {'; '.join(map(str, several))}"
    )


def _table(forecasts: Sequence[Forecast]) -> Table:
    """Return a table of the largest and the last predicted value, with 90 % bands."""
    first = forecasts[0]
    moved = first.program.quantity == "displacement"
    name = first.units.force_name if moved else first.units.displacement_name
    table = Table(title=first.program.title)
    for column in ("pad", f"largest {name}", "90 % band", f"last {name}", "90 % band"):
        table.add_column(column, justify="left" if column == "pad" else "right")
    for forecast in forecasts:
        unit = forecast.units.force if moved else forecast.units.displacement
        low, high = forecast.band(0.9)
        cells = [forecast.pad]
        for k in (int(forecast.median.argmax()), -1):
            cells += [f"{forecast.median[k]:.4g} {unit}", f"{low[k]:.4g} to {high[k]:.4g}"]
        table.add_row(*cells)
    return table
