"""A forecast as files: JSON for machines, CSV for a spreadsheet or a controller."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from qlvbayes.io.files import write_json, write_whole
from qlvbayes.io.units import column_name
from qlvbayes.use.prescribed.forecast import Forecast

BANDS = (0.5, 0.9)
_DIGITS = 9  # more than any rig resolves


def columns(forecast: Forecast) -> dict[str, np.ndarray]:
    """Return time, the prescribed quantity, and median and bands of the answer, (N,) each."""
    units = forecast.units
    displacement = column_name(
        units.displacement_name, "" if units.dimensionless else units.displacement
    )
    load = column_name(units.force_name, units.force)
    moved = forecast.program.quantity == "displacement"
    given, answer = (displacement, load) if moved else (load, displacement)
    table = {"time_s": forecast.time, given: forecast.given, answer: forecast.median}
    for share in BANDS:
        low, high = forecast.band(share)
        table |= {f"{answer}_low{share * 100:.0f}": low, f"{answer}_high{share * 100:.0f}": high}
    return table


def content(forecast: Forecast) -> dict[str, object]:
    """Return the content of prediction.json."""
    return {
        "schema": 1,
        "pad": forecast.pad,
        "program": forecast.program.title,
        "prescribed": forecast.program.quantity,
        "effects": list(forecast.effects),
        "draws": len(forecast.answers),
        "averaged": [
            {
                "base": {"elastic": one.base.elastic, "relaxation": one.base.relaxation},
                "effects": list(one.effects),
                "probability": one.probability,
            }
            for one in forecast.averaged
        ],
        "units": asdict(forecast.units),
        "warnings": list(forecast.warnings),
        "columns": {name: values.tolist() for name, values in columns(forecast).items()},
    }


def write_forecast(folder: Path, forecast: Forecast) -> None:
    """Write prediction.json and prediction.csv."""
    write_json(folder / "prediction.json", content(forecast), indent=None)
    table = columns(forecast)
    rows = [",".join(table)]
    rows += [",".join(f"{x:.{_DIGITS}g}" for x in row) for row in zip(*table.values(), strict=True)]
    write_whole(folder / "prediction.csv", ("\n".join(rows) + "\n").encode())
