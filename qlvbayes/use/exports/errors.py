"""State how far a simulator's own force is from the measured one, phase by phase."""

from __future__ import annotations

import json
from collections.abc import Mapping

from qlvbayes.io.wording import visible
from qlvbayes.motion.phases import NAMES
from qlvbayes.use.exports.card import card
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.reduction import Floats, Pressing
from qlvbayes.use.exports.target import AbstractTarget

_MODEL = "with memory"


def error_files(
    pad: ExportedPad,
    target: type[AbstractTarget],
    pressed: Pressing,
    forces: Mapping[str, Floats],
    constants: Mapping[str, float | list[float]],
) -> dict[str, bytes]:
    """Return the content of ``pad_B_error.txt`` and ``pad_B_error.json``."""
    every = {**forces, _MODEL: pressed.force}
    errors = {name: pressed.errors(force) for name, force in every.items()}
    whole = {name: pressed.miss(force) for name, force in every.items()}
    content = {
        "schema": 1,
        "pad": pad.name,
        "target": target.name,
        "date": pad.date,
        "against": "model" if pressed.absent else "measured",
        "why_not_measured": pressed.absent or None,
        "numbers": dict(constants),
        "whole": {
            name: {"rms": x.rms, "largest": x.largest, "holds_rms": x.hold}
            for name, x in whole.items()
        },
        "cells": [
            {
                "test": cell.test,
                "role": cell.role or None,
                "phase": cell.phase,
                "peak_N": float(peak),
                "rms_over_peak": {name: float(values[i]) for name, values in errors.items()},
            }
            for i, (cell, peak) in enumerate(zip(pressed.cells, pressed.peaks, strict=True))
        ],
    }
    table = _table(pressed, errors, {name: miss.rms for name, miss in whole.items()})
    lines = [*card(pad, target), "", *map(visible, _words(pressed)), "", *map(visible, table)]
    text = "\n".join(lines)
    name = pad.identifier
    return {
        f"{name}_error.txt": (text + "\n").encode(),
        f"{name}_error.json": (json.dumps(content, allow_nan=False, indent=1) + "\n").encode(),
    }


def _table(
    pressed: Pressing, errors: Mapping[str, Floats], whole: Mapping[str, float]
) -> list[str]:
    """Return lines of the errors by test and phase, and over all of them."""
    wide = max(len(cell.test) for cell in pressed.cells)
    columns = {name: max(len(name), 7) for name in errors}
    head = f"{'test':{wide}}  {'role':8}  {'phase':9}  {'peak N':>8}"
    lines = [head + "".join(f"  {name:>{size}}" for name, size in columns.items())]
    for i, (cell, peak) in enumerate(zip(pressed.cells, pressed.peaks, strict=True)):
        row = f"{cell.test:{wide}}  {cell.role:8}  {NAMES[cell.phase]:9}  {peak:8.4g}"
        lines.append(row + "".join(f"  {errors[k][i]:>{n}.2%}" for k, n in columns.items()))
    row = f"{'all':{wide}}  {'':8}  {'':9}  {'':8}"
    return [*lines, row + "".join(f"  {whole[k]:>{n}.2%}" for k, n in columns.items())]


def _words(pressed: Pressing) -> list[str]:
    """Return what the table is of, and what follows from it."""
    if pressed.absent:
        return [
            f"Set against the pad's own model, not against measured forces: {pressed.absent}.",
            "Root mean square of the contact's force less the model's, over the largest force:",
        ]
    return [
        "Root mean square of the force less the measured one, over the test's largest force.",
        "The last column is the pad's model, as --to c, fmu, mujoco (the plugin) and matlab "
        "represent it; where it is much smaller than the others, no contact without memory is "
        "enough.",
    ]
