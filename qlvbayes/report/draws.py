"""Constants from the draws alone, for a posterior that came without its summary."""

from __future__ import annotations

import json
from pathlib import Path

from qlvbayes.fitting.diagnostics import diagnose_chain
from qlvbayes.fitting.results import load
from qlvbayes.fitting.summary import FitSummary, constant_of
from qlvbayes.model.drawn import described_fields


def summary_of_draws(path: Path) -> tuple[FitSummary, dict]:
    """What ``summary.json`` would say; the units and the choices that ours carry as attributes.

    Raises InputError where the file is no posterior with our names of the constants.
    """
    saved = load(path)
    kinds = {name: f.unit for f in described_fields(saved.choices) for name in f.names}
    judged = diagnose_chain(saved.constants)
    troubles = tuple(judged.troubles)
    summary = FitSummary(
        pad=saved.pad,
        units=saved.units,
        effects=saved.choices.effects,
        sampler=saved.method,
        converged=not troubles,
        troubles=troubles,
        parameters={
            name: constant_of(saved.constants[..., k], saved.units.of(kinds[name]), k, judged)
            for k, name in enumerate(saved.names)
        },
    )
    facts = {
        "displacement_unit": saved.units.displacement,
        "force_unit": saved.units.force,
        "choices": json.dumps(saved.choices.as_dict()),
    }
    return summary, facts
