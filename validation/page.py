"""The page docs/validation.md, from finished fits."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from calibration import (
    HIGH,
    LOW,
    Alarms,
    Calibration,
    alarms,
    calibrations,
    converged,
    predicted,
    seconds,
)
from simulated_fits import MOST_STEPS, Setting

_OF_OTHERS = (
    "## Calibrated by simulation",
    "## Bad readings",
)  # sections of ranks.py, bad_readings.py
_PHASES = ("ramp", "hold", "unload", "recovery")

_HEAD = """# Validation: do the intervals hold the truth?

Pads were simulated from constants drawn at random, by differential equations that share no code
with the fit, with the paper's protocol: pressed to 1.6 mm at 0.1 to 100 mm/s, held 30 s, back to
0.8 mm, held 30 s; an encoder of 1 um, a load cell with noise. The 20 mm/s test of each pad was
fitted with the default settings (but at most {steps} steps of the sampler), the noise as it was
measured in the holds, the other tests predicted. All fits count, converged or not.
A 90 % credible interval should hold the truth nine times out of ten; asked for is a share between
{low:.0%} and {high:.0%} for every constant of the pad.

The comparison of two pads is validated on [its own page](pairs.md), the diagnosis on
[another](rig_studies.md).
Whether fits follow the readings as least squares does, by
`validation/budget.py`.

{verdict}

| | |
|---|---|
| command | `{command}` |
| date | {date} |
| commit | {commit} |
| machine | {machine} |
"""

_READING = """## How to read it

- *in 90 %*: share of the fits whose reported 90 % interval (highest density) holds the truth, with
  its binomial standard error.
- *z*: (posterior mean - truth)/posterior sd. Its mean should be 0 and its sd 1; a mean off 0 is a
  bias, an sd above 1 means intervals too narrow. The standard error of both follows from the number
  of fits n: 1/sqrt(n) for the mean, 1/sqrt(2n) for the sd.
- *width*: median width of the interval over the true value.
- *false alarms*: the model is right here, so that every cell (test and phase) that `check` calls
  failing is one. The aim is 1 % of studies with any.
- *predicted*: share of samples of the unseen tests inside the 90 % predictive interval, mean over
  pads with its standard error.
"""

_LIMITS = """## Limits

- `check` takes the noise floor, measured in the holds, as exact. Of correlated noise the holds of
  six tests show the size to about a tenth and the correlation time to about a third only; with it
  there are more false alarms than the 1 % aimed at.
- The model, the kind of noise and contact are right here. What a wrong model does, `check` has to
  show.
- Constants are drawn around the paper's pads: m 0.2 to 1.2 N/mm, b 0.3 to 1.5 1/mm, v[1] 2 to 15
  1/s, v[2] 0.05 to 0.5 1/s, shares of at least 0.03. Outside of that nothing was tried.
- Noise is normal and as large as in the paper's data (0.01 N in all) in every pad. Outliers and
  other sizes were not tried here.
- The priors are not the distribution that the constants were drawn from; a share of exactly 90 % is
  therefore not to be expected, only one near it.
"""


@dataclass(frozen=True)
class Origin:
    """Origin of a page: its command, date, commit and machine."""

    command: str
    date: str
    commit: str
    machine: str

    @classmethod
    def now(cls, command: str, root: Path) -> Origin:
        """Return the origin of a page made now, in the git working tree at ``root``."""
        date = datetime.now(UTC).strftime("%Y-%m-%d")
        git = ("git", "describe", "--always", "--exclude=*", "--dirty=, with uncommitted changes")
        found = subprocess.run(git, cwd=root, capture_output=True, text=True, check=False)
        machine = (
            f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()}"
        )
        return cls(command, date, found.stdout.strip() or "unknown", machine)


def write_page(path: Path, results: Mapping[Setting, Sequence[dict]], origin: Origin) -> None:
    """Write the page whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    text = page(results, origin)
    for heading in _OF_OTHERS if path.is_file() else ():
        if section := _section_of(path.read_text(encoding="utf-8"), heading):
            text = with_section(text, section)
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)


def with_section(text: str, section: str) -> str:
    """Return the page with a section of another script at its end, replacing an older one."""
    older = _section_of(text, section.splitlines()[0])
    rest = text.replace(older, "") if older else text
    return f"{rest.rstrip()}\n\n{section.strip()}\n"


def _section_of(text: str, heading: str) -> str:
    """The section under a heading, up to the next one; empty if there is none."""
    _, found, section = text.partition(f"{heading}\n")
    return found + section.partition("\n## ")[0] if found else ""


def page(results: Mapping[Setting, Sequence[dict]], origin: Origin) -> str:
    """Markdown."""
    head = _HEAD.format(
        low=LOW, high=HIGH, steps=MOST_STEPS, verdict=_verdict(results), command=origin.command,
        date=origin.date, commit=origin.commit, machine=origin.machine,
    )  # fmt: skip
    parts = [head, *(_section(setting, fits) for setting, fits in results.items())]
    return "\n".join([*parts, _READING, _LIMITS])


def _verdict(results: Mapping[Setting, Sequence[dict]]) -> str:
    off = [
        f"{row.name} {row.inside:.1%} ({setting.describe()})"
        for setting, fits in results.items()
        for row in calibrations(fits)
        if not row.name.startswith("noise.") and not row.within
    ]
    if not off:
        return "**Result: every constant of the pad is within it, in every table below.**"
    return f"**Result: outside of it: {'; '.join(off)}. All others are within it.**"


def _section(setting: Setting, fits: Sequence[dict]) -> str:
    title = setting.describe()
    rows = [_row(row) for row in calibrations(fits)]
    facts = (
        f"{len(fits)} pads; {converged(fits):.1%} of the fits converged; "
        f"{seconds(fits):.1f} s for a fit (median)."
    )
    return "\n".join(
        [
            f"## {title[0].upper()}{title[1:]}\n",
            facts + "\n",
            "| constant | in 90 % | z mean | z sd | width |",
            "|---|---|---|---|---|",
            *rows,
            "",
            *_predictions(fits),
        ]
    )


def _row(row: Calibration) -> str:
    return (
        f"| {row.name} | {row.inside:.1%} ± {row.error:.1%} | {row.z_mean:+.2f} | "
        f"{row.z_sd:.2f} | {row.width:.1%} |"
    )


def _predictions(fits: Sequence[dict]) -> list[str]:
    lines = [_alarm_text(alarms(fits))]
    shares = {phase: predicted(fits, phase) for phase in _PHASES}
    seen = [f"{phase} {s[0]:.1%} ± {s[1]:.1%}" for phase, s in shares.items() if s]
    if seen:
        lines.append(f"Predicted: {', '.join(seen)}.")
    return [f"{line}\n" for line in lines]


def _alarm_text(found: Alarms) -> str:
    return (
        f"False alarms: in {found.alarmed} of {found.studies} studies "
        f"({found.alarmed / found.studies:.1%}); {found.failing} of {found.cells} cells."
    )
