"""Write the page of blind studies on the paper's rig, from a folder of `qlvbayes benchmark`.

`rig.py OUT --commit HASH -o docs/rig_studies.md` reads the studies in OUT/studies that the
registered command left at that commit, or those of the published JSON file. By the rule of the
registration the studies up to the first that is missing count.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from itertools import count, takewhile
from pathlib import Path
from textwrap import fill

import numpy as np
from certainty import loss, names_of, rows
from page import Origin
from wide_page import tables

from qlvbayes.diagnosis.certainty import LEAST, calibration
from qlvbayes.evaluation.constants import coverage
from qlvbayes.evaluation.counting import Case
from qlvbayes.evaluation.population import Population
from qlvbayes.evaluation.report import Report
from qlvbayes.io.files import write_json, write_whole

ROOT = Path(__file__).resolve().parents[1]

SEED, STUDIES = 518, 200
"""Of the registered run."""
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
| registration | [validation](validation.md): seed {seed}, {studies} studies |
| command | `qlvbayes benchmark --studies {studies} --seed {seed}` |
| date, commit | {date}, {commit} |
| machine | {machine} |
| studies | {finished} finished, {done} count, {seen} could be seen; {seconds} s for one (median) |
"""
_INTRO = """
Pads of the paper's laws and constants are simulated by differential equations that share no code
with the fit, and tested by the paper's programme with correlated noise. Equally many hide nothing,
one candidate effect, two, another form of one, something unmodelled, or that together with a
candidate. What *could be seen* follows from the simulator alone. Rates are over those studies, with
one-sided 95 % bounds (Clopper-Pearson). Seed, code and rules were committed before the run: the
studies up to the first that is missing count, in the order of their numbers."""


def page(report: Report, commit: str, finished: int) -> str:
    """Return the page in Markdown; ``finished`` is the number of studies that are done."""
    origin = Origin.now("", ROOT)
    head = _HEAD.format(
        intro=fill(" ".join(_INTRO.split()), 100), seed=SEED, studies=STUDIES, finished=finished,
        date=origin.date, commit=commit, machine=origin.machine, done=len(report.cases),
        seen=len(report.seen),
        seconds="-" if report.seconds is None else f"{report.seconds:.0f}",
    )  # fmt: skip
    return "\n".join([head, *tables(report, ASKED), _certainty(report), _constants(report)])


def _certainty(report: Report) -> str:
    """Return how many effects of each certainty are there; it was learnt on another run."""
    cases = [case for case in report.seen if case.get("stages")]
    known = calibration()
    stated = [(known(name.x), name.there) for name in names_of("rig", cases)]
    certain = np.array([(one, there) for one, there in stated if one is not None], dtype=float)
    values, there = certain.T
    runs = ", ".join(known.runs)
    intro = (
        f"The certainty was learnt on the run *{runs}*, away from this rig. Of {len(stated)} "
        f"effects with a probability of {LEAST:.0%} or more in studies that could be seen, "
        f"{len(stated) - len(values)} have none, as a feature lies outside the range seen there. "
        f"Mean log loss of the others: {loss(values, there):.3f} nats, of one share for all "
        f"{loss(np.full(len(values), there.mean()), there):.3f}."
    )
    head = "| certainty | names | there | 95 % bounds | mean certainty |\n|---|---|---|---|---|"
    title = "## Certainty of an effect against the share in which it is there\n"
    return "\n".join([title, fill(intro, 100) + "\n", head, *rows(values, there), ""])


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


def counted(cases: Sequence[Case]) -> tuple[Case, ...]:
    """Return the cases up to the first that is missing, in the order of their numbers."""
    by_index = {case["index"]: case for case in cases}
    prefix = takewhile(by_index.__contains__, count())
    return tuple(by_index[index] for index in prefix)


def _read(source: Path) -> list[Case]:
    """Return the finished studies in a folder of results, or in a published file."""
    if source.is_file():
        found = json.loads(source.read_text(encoding="utf-8"))
        return [*found["cases"], *found["not_counted"]]
    (store,) = (source / "studies").glob("*.jsonl")
    return [json.loads(line) for line in store.read_text(encoding="utf-8").splitlines()]


def main() -> int:
    """Write the page and the figures behind it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path, help="folder of the command, or the published file")
    parser.add_argument("--commit", required=True, help="the commit that ran the studies")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "rig_studies.md")
    options = parser.parse_args()
    cases = _read(options.source)
    report = Report(Population(SEED, paper=True), counted(cases))
    text = page(report, options.commit, len(cases))
    numbers = {case["index"] for case in report.cases}
    others = [case for case in cases if case["index"] not in numbers]
    write_whole(options.output, text.encode())
    write_json(options.output.with_suffix(".json"), report.as_dict() | {"not_counted": others})
    return 0


if __name__ == "__main__":
    sys.exit(main())
