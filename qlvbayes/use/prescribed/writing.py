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


def columns(found: Forecast) -> dict[str, np.ndarray]:
    """Time, what is prescribed, and the median and the bands of the answer, (N,) each."""
    units = found.units
    place = column_name(units.displacement_name, "" if units.dimensionless else units.displacement)
    load = column_name(units.force_name, units.force)
    moved = found.program.quantity == "displacement"
    given, answer = (place, load) if moved else (load, place)
    table = {"time_s": found.time, given: found.given, answer: found.median}
    for share in BANDS:
        low, high = found.band(share)
        table |= {f"{answer}_low{share * 100:.0f}": low, f"{answer}_high{share * 100:.0f}": high}
    return table


def content(found: Forecast) -> dict[str, object]:
    """Return the content of prediction.json."""
    return {
        "schema": 1,
        "pad": found.pad,
        "program": found.program.told,
        "prescribed": found.program.quantity,
        "effects": list(found.effects),
        "draws": len(found.answers),
        "averaged": [
            {
                "base": {"elastic": one.base.elastic, "relaxation": one.base.relaxation},
                "effects": list(one.effects),
                "probability": one.probability,
            }
            for one in found.averaged
        ],
        "units": asdict(found.units),
        "warnings": list(found.warnings),
        "columns": {name: values.tolist() for name, values in columns(found).items()},
    }


def write_forecast(folder: Path, found: Forecast) -> None:
    """Leave prediction.json and prediction.csv."""
    write_json(folder / "prediction.json", content(found), indent=None)
    table = columns(found)
    rows = [",".join(table)]
    rows += [",".join(f"{x:.{_DIGITS}g}" for x in row) for row in zip(*table.values(), strict=True)]
    write_whole(folder / "prediction.csv", ("\n".join(rows) + "\n").encode())
