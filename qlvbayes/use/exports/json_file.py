"""Write all that the fit knows of a pad as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict

from qlvbayes.use.exports.card import card
from qlvbayes.use.exports.pad import Draws, ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry


class JsonFile(AbstractTarget):
    """JSON file of laws, spectrum, intervals, tested range and draws, every one in all digits."""

    name = "json"
    steps = True
    what = "laws, spectrum, intervals, tested range and draws, without loss"

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.json``."""
        content = {
            "schema": 1,
            "pad": pad.pad,
            "date": pad.date,
            "card": card(pad, type(self)),
            "units": asdict(pad.units),
            "elastic": type(pad.elastic).name,
            "relaxation": pad.choices.relaxing,
            "bonded": pad.choices.bonded,
            "effects": list(pad.choices.effects),
            "source": pad.origin,
            "fitted_tests": list(pad.fitted),
            "converged": pad.converged,
            "covered": pad.covered.as_dict() if pad.covered else None,
            "constants": {
                x.name: {"unit": x.unit, "median": x.median, "hdi90": [x.low, x.high]}
                for x in pad.intervals
            },
            "closest_to_median": _rows(pad, pad.middle)[0],
            "draws": _rows(pad, pad.table),
        }
        return {f"{pad.identifier}.json": (json.dumps(content, allow_nan=False) + "\n").encode()}


def _rows(pad: ExportedPad, draws: Draws) -> list[dict]:
    """Return the constants of each draw."""
    elastic = type(pad.elastic).units
    effects = [name for piece in pad.pieces for name in piece.columns]
    columns = (x.tolist() for x in (draws.elastic, draws.effects, draws.fractions, draws.rates))
    return [
        {
            "elastic": dict(zip(elastic, e, strict=True)),
            "effects": dict(zip(effects, a, strict=True)),
            "c": c,
            "v": v,
        }
        for e, a, c, v in zip(*columns, strict=True)
    ]
