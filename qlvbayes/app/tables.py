"""Write tables of a session as CSV: residuals by sample, and the constants with their fit."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping

from qlvbayes.app.bench.bench import Bench, Look
from qlvbayes.app.bench.model import ByHand
from qlvbayes.io.escaping import as_cells
from qlvbayes.io.units import column_name


def residuals_csv(bench: Bench, look: Look) -> str:
    """Return a row for each sample: measured, modelled, residual."""
    units, samples = bench.experiment.units, bench.samples
    displacement = column_name(
        units.displacement_name, "" if units.dimensionless else units.displacement
    )
    force = column_name(units.force_name, units.force)
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(
        ["pad", "test", "phase", "time_s", displacement, force, f"model_{units.force}",
         f"residual_{units.force}"]
    )  # fmt: skip
    for k, trial in enumerate(samples.trials):
        own, names = samples.rows[k], as_cells([bench.experiment.pad, trial.name])
        columns = zip(
            samples.phases(k).tolist(),
            trial.test.time[own].tolist(),
            trial.test.displacement[own].tolist(),
            trial.test.force[own].tolist(),
            look.forces[k].tolist(),
            strict=True,
        )
        for phase, time, depth, measured, modelled in columns:
            rows.writerow(
                [*names, phase, f"{time:.6f}", f"{depth:.8g}",
                 f"{measured:.8g}", f"{modelled:.8g}", f"{measured - modelled:.8g}"]
            )  # fmt: skip
    return out.getvalue()


def constants_csv(bench: Bench, model: ByHand, begun: Mapping[str, float]) -> str:
    """Return a row for each constant: value, unit, start of its fit, prior, fitted tests."""
    trials = bench.samples.trials
    tests = " ".join(trial.name for trial in trials)
    first = min(float(trial.test.time[0]) for trial in trials)
    last = max(float(trial.test.time[-1]) for trial in trials)
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(
        ["pad", "parameter", "value", "unit", "initial", "prior_low", "prior_high", "belongs_to",
         "fitted_tests", "fitted_from_s", "fitted_to_s"]
    )  # fmt: skip
    for slider in bench.sliders(model):
        initial = begun.get(slider.name)
        rows.writerow(
            [*as_cells([bench.experiment.pad, slider.name]), f"{slider.value:.8g}", slider.unit,
             "" if initial is None else f"{initial:.8g}", f"{slider.prior[0]:.4g}",
             f"{slider.prior[1]:.4g}", slider.owner, *as_cells([tests]), f"{first:.6g}",
             f"{last:.6g}"]
        )  # fmt: skip
    return out.getvalue()
