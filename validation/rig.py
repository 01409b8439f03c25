"""Write the page of blind studies on the paper's rig, from a folder of `qlvbayes benchmark`.

`rig.py OUT --commit HASH -o docs/rig_studies.md` reads OUT/benchmark.json, which the registered
command left at that commit.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from textwrap import fill

from page import Origin
from wide_page import tables

from qlvbayes.evaluation.constants import coverage
from qlvbayes.evaluation.population import Population
from qlvbayes.evaluation.report import Report
from qlvbayes.io.files import write_json, write_whole

ROOT = Path(__file__).resolve().parents[1]

ASKED = {
    "none_adequate": 0.95, "false_name": 0.02, "single_named": 0.95, "single_group": 0.95,
    "double_named": 0.85, "form_kin": 0.90, "outside_open": 0.90, "beside_named": 0.60,
    "wrong": 0.05, "failed": 0.0, "right": 0.75,
}  # fmt: skip
"""Shares asked of each rate: at least, or for what is bad at most."""

_HEAD = """# Blind studies on the paper's rig

{intro}

| | |
|---|---|
| registration | [validation](validation.md#fitted-motions): seed {seed}, {studies} studies |
| command | `qlvbayes benchmark --studies {studies} --seed {seed}` |
| date, commit | {date}, {commit} |
| machine | {machine} |
| studies | {done}, of which {seen} could be seen; {seconds} s for one (median) |
"""
_INTRO = """
Pads of the paper's laws and constants are simulated by differential equations that share no code
with the fit, and tested by the paper's programme with correlated noise. Equally many hide nothing,
one candidate effect, two, another form of one, something unmodelled, or that together with a
candidate. What *could be seen* follows from the simulator alone. Rates are over those studies, with
one-sided 95 % bounds (Clopper-Pearson). Seed, code and rules were committed before the run."""


def page(report: Report, commit: str, studies: int) -> str:
    """Return the page in Markdown; ``studies`` is how many were registered."""
    origin = Origin.now("", ROOT)
    head = _HEAD.format(
        intro=fill(" ".join(_INTRO.split()), 100), seed=report.population.seed, studies=studies,
        date=origin.date, commit=commit, machine=origin.machine, done=len(report.cases),
        seen=len(report.seen),
        seconds="-" if report.seconds is None else f"{report.seconds:.0f}",
    )  # fmt: skip
    return "\n".join([head, *tables(report, ASKED), _constants(report)])


def _constants(report: Report) -> str:
    """Return how often 90 % intervals contain the truth, where one effect is hidden and seen."""
    lines = [
        "## 90 % intervals of the constants, where one effect is hidden and can be seen\n",
        "| constant | contain the truth, without the effect | in the model of the answer |",
        "|---|---|---|",
    ]
    for name, found in coverage(report.cases).items():
        shown = [f"{rate.hits} of {rate.n}" for rate in (found.before, found.after)]
        lines.append(f"| {name} | {' | '.join(shown)} |")
    return "\n".join([*lines, ""])


def main() -> int:
    """Write the page and the figures behind it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the command left benchmark.json")
    parser.add_argument("--commit", required=True, help="the commit that ran the studies")
    parser.add_argument("--registered", type=int, default=200, help="studies that were registered")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "rig_studies.md")
    options = parser.parse_args()
    found = json.loads((options.folder / "benchmark.json").read_text(encoding="utf-8"))
    report = Report(Population(found["seed"], paper=True), tuple(found["cases"]))
    write_whole(options.output, page(report, options.commit, options.registered).encode())
    write_json(options.output.with_suffix(".json"), report.as_dict())
    return 0


if __name__ == "__main__":
    sys.exit(main())
