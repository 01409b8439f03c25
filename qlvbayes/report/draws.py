"""Constants from the draws alone, for a posterior that came without its summary."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from qlvbayes.drawn import described_fields
from qlvbayes.inference.diagnostics import diagnose_chain, highest_density
from qlvbayes.results import Saved, load


def summary_of_draws(path: Path) -> tuple[dict, dict]:
    """What ``summary.json`` would say; the units and the choices that ours carry as attributes.

    Raises InputError where the file is no posterior with our names of the constants.
    """
    saved = load(path)
    kinds = {name: f.unit for f in described_fields(saved.choices) for name in f.names}
    judged = diagnose_chain(saved.constants)
    parameters = {
        name: _parameter(
            saved.constants[..., k],
            saved.units.of(kinds[name]),
            judged.r_hat[k],
            judged.ess_bulk[k],
        )
        for k, name in enumerate(saved.names)
    }
    facts = {
        "displacement_unit": saved.units.displacement,
        "force_unit": saved.units.force,
        "choices": json.dumps(saved.choices.as_dict()),
    }
    return _summary(saved, parameters, judged.troubles), facts


def _summary(saved: Saved, parameters: dict, troubles: list[str]) -> dict:
    return {
        "schema": 1,
        "pad": saved.pad,
        "units": saved.units.as_dict(),
        "effects": list(saved.choices.effects),
        "sampler": saved.method,
        "converged": not troubles,
        "troubles": troubles,
        "parameters": parameters,
    }


def _parameter(values: np.ndarray, unit: str, r_hat: float, ess: float) -> dict:
    return {
        "unit": unit,
        "mean": float(values.mean()),
        "sd": float(values.std()) if np.ptp(values) > 0.0 else 0.0,
        "median": float(np.median(values)),
        "hdi90": list(highest_density(values)),
        "r_hat": float(r_hat) if np.isfinite(r_hat) else None,
        "ess_bulk": float(ess) if np.isfinite(ess) else None,
    }
