"""Count how often the 90 % credible intervals of `fit` hold the truth, on simulated pads.

Interrupted, it goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from math import sqrt

from calibration import HIGH, LOW, alarms, calibrations, converged, predicted
from results import JOBS, Origin, Table, finished
from simulated_fits import Setting, run

KINDS = (Setting("white", 500), Setting("correlated", 500))
COLUMNS = ("pads with", "constant", "in 90 %", "z mean", "z sd", "width")
_PHASES = ("ramp", "hold", "unload", "recovery")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fits", type=int, default=200, help="pads of each kind of noise")
    parser.add_argument("--seed", type=int, default=1, help="decides all pads and their noise")
    parser.add_argument("--jobs", type=int, default=JOBS)
    options = parser.parse_args()
    origin = Origin.now()
    results = {
        setting: finished(
            f"coverage-{setting.name}-seed{options.seed}",
            partial(run, setting, options.seed),
            range(options.fits),
            options.jobs,
        )
        for setting in KINDS
    }
    table(results, origin).write("coverage")


def table(results: Mapping[Setting, Sequence[dict]], origin: Origin) -> Table:
    """Return the shares of all constants, with what is outside of the range that is asked for."""
    size = min(map(len, results.values()))
    rows = [
        [
            setting.noise, row.name, f"{row.inside:.1%} ± {row.error:.1%}", f"{row.z_mean:+.2f}",
            f"{row.z_sd:.2f}", f"{row.width:.1%}",
        ]
        for setting, fits in results.items()
        for row in calibrations(fits)
    ]  # fmt: skip
    off = [
        f"{row.name} {row.inside:.1%} ({setting.noise})"
        for setting, fits in results.items()
        for row in calibrations(fits)
        if not row.name.startswith("noise.") and not row.within
    ]
    error = sqrt(0.9 * 0.1 / size)
    asked = f"Asked for is {LOW:.0%} to {HIGH:.0%} of every constant of the pad; "
    asked += f"of {size} pads a share of 90 % is known to ± {error:.1%} (one sd). "
    verdict = f"Outside of it are {', '.join(off)}." if off else "All are within it."
    notes = [f"- {_facts(setting, fits)}" for setting, fits in results.items()]
    return Table(origin, size, COLUMNS, rows, [asked + verdict, "", *notes])


def _facts(setting: Setting, fits: Sequence[dict]) -> str:
    """Return a line with what else was found with one kind of noise."""
    found, shares = alarms(fits), {phase: predicted(fits, phase) for phase in _PHASES}
    seen = [f"{phase} {s[0]:.1%} ± {s[1]:.1%}" for phase, s in shares.items() if s]
    return (
        f"*{setting.noise}*: {setting.describe()}; {len(fits)} pads, {converged(fits):.0%} of the "
        f"fits converged; false alarms of `check` in {found.alarmed} of {found.studies} pads "
        f"({found.failing} of {found.cells} cells); samples of tests that were not fitted inside "
        f"the 90 % interval: {', '.join(seen) or '-'}."
    )


if __name__ == "__main__":
    main()
