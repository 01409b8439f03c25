"""Compare the closed form, by which tests are proposed, with nested Monte Carlo; write a page.

Interrupted, it goes on where it was: finished pads lie in build/validation.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from coverage import progress
from design_cases import FIRST, MINUTES, RATES, Lab, believed, plain, ready
from nested_bits import nested_bits
from page import Origin

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import draw_designs
from qlvbayes.diagnosis.nexttest.errors import ReadingErrors
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.diagnosis.nexttest.screening import screen
from qlvbayes.diagnosis.nexttest.series import between, bits_for_constants
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.effects import PowerLawDrag, ViscousDrag
from qlvbayes.evaluation.store import Store, code_digest
from qlvbayes.io.files import write_whole
from qlvbayes.io.runtime import forget_compiled
from qlvbayes.motion.experiment import Experiment
from qlvbayes.simulate import HIDDEN, HiddenPad, draw_constants

ROOT = Path(__file__).resolve().parents[1]
_DRAWN = 128  # designs a pad
_BEST, _RANDOM = 3, 3  # of these, by the closed form, and any, that are judged by Monte Carlo
_OUTER = 96  # sets of simulated readings

_PAGE = """# How far is the closed form from nested Monte Carlo?

`qlvbayes design` and `diagnose` rank tests by a closed form, which takes forces for linear in the
constants within what the tests so far leave open. Here the same bits come from nested Monte Carlo
without that (`validation/nested_bits.py`). *Constants*: pads with one test at 20 mm/s or three at
1, 20 and 100 mm/s, bits for all constants of the law. *Cause*: pads with a drag that grows as the
0.8th to 0.95th power of the speed, tested at {rates} mm/s; this drag and one just as the speed
are taken for equally probable. Of {drawn} tests drawn for each pad, the {best} best by the closed
form and {random} random ones were judged.

| | |
|---|---|
| command | `{command}` |
| date | {date} |
| commit | {commit} |
| machine | {machine} |

| bits for | pads | tests | nested less closed: mean, sd | in % of closed | error of nested | lost |
|---|---|---|---|---|---|---|
{rows}

- *Constants*: half the logarithm of a determinant, which is exact for linear forces.
- *Cause*: the closed form is a third of the way from its lower to its upper bound, which is exact
  for explanations that differ little; {within} of {tests} Monte Carlo values lie between the
  bounds, within two of their errors. The error, as a share of the distance between the bounds, is
  {share:+.2f} in the mean, with an sd of {sd:.2f}.
- *Lost*: bits of the judged test that is best by Monte Carlo, less those of the test that is best
  by the closed form (of constants bits per minute), mean over the pads.
"""


def error_case(index: int, seed: int) -> dict:
    """Bits of some tests of one pad by both, for constants (even pads) or for the cause (odd)."""
    rng = np.random.default_rng([seed, index])
    cause = index % 2 == 1
    experiment, belief, size = _doubtful(rng) if cause else _certain(rng, index // 2)
    rig, clock = Rig.from_tests(experiment), experiment.scales.clock
    errors = ReadingErrors(experiment.floor, experiment.scales.force, size)
    designs = draw_designs(rig, belief.recovery, 60.0 * MINUTES, _DRAWN, index)
    products, finite = screen(belief, designs, rig, errors, clock)
    names = () if cause else belief.base_names
    low, high = products.bits_for_cause(belief.probabilities, belief.groups)
    closed = between(low, high) if cause else bits_for_constants(belief, products, names)
    minutes = np.array([one.minutes for one in designs])
    worth = np.where(finite, closed if cause else closed / minutes, -np.inf)
    best = np.argsort(-worth)[:_BEST]
    others = rng.choice(np.setdiff1d(np.flatnonzero(finite), best), _RANDOM, replace=False)
    rows = []
    for k in (*best.tolist(), *others.tolist()):
        nested = nested_bits(
            belief, [designs[k]], rig, errors, names, clock=clock, seed=index, outer=_OUTER
        )
        value, error = (
            (nested.cause, nested.cause_error)
            if cause
            else (nested.constants, nested.constants_error)
        )
        rows.append({"closed": float(closed[k]), "least": float(low[k]), "most": float(high[k]),
                     "nested": value, "error": error, "minutes": float(minutes[k])})  # fmt: skip
    return {"index": index, "kind": "cause" if cause else "constants", "rows": rows}


def _certain(rng: np.random.Generator, turn: int) -> tuple[Experiment, Belief, float]:
    lab = Lab(HiddenPad(draw_constants(rng), ()), rng)
    return plain(lab.tests(FIRST[turn % len(FIRST)], int(rng.integers(2**32))))


def _doubtful(rng: np.random.Generator) -> tuple[Experiment, Belief, float]:
    n, k = float(rng.uniform(0.8, 0.95)), float(rng.uniform(0.002, 0.005))
    lab = Lab(HiddenPad(draw_constants(rng), (HIDDEN["power_law_drag"](k=k, n=n),)), rng)
    experiment = ready(lab.tests(RATES, int(rng.integers(2**32))))
    search = build_search(experiment, kinds=(ViscousDrag, PowerLawDrag))
    search.begin()
    search.evaluate(search.baseline)
    both = [search.baseline.plus(name) for name in ("viscous_drag", "power_law_drag")]
    for hypothesis in both:
        search.evaluate(hypothesis, search.baseline)
    belief = believed(search, [(hypothesis, 0.5) for hypothesis in both])
    # one family, but here the two are what is asked for
    own = [replace(one, cause=one.words) for one in belief.explanations]
    size = max(search.modes[hypothesis][0].mode.size for hypothesis in both)
    return experiment, Belief.from_explanations(own), size


def _row(kind: str, cases: Sequence[dict]) -> str:
    some = [case for case in cases if case["kind"] == kind]
    closed, nested, errors = (
        np.array([row[key] for case in some for row in case["rows"]])
        for key in ("closed", "nested", "error")
    )
    apart = nested - closed
    share = apart / np.maximum(closed, 1e-3)
    lost = []
    for case in some:
        worth = [row["nested"] / (row["minutes"] if kind == "constants" else 1.0)
                 for row in case["rows"]]  # fmt: skip
        lost.append(max(worth) - worth[0])
    cells = [kind, str(len(some)), str(len(apart)), f"{apart.mean():+.3f}, {apart.std():.3f}",
             f"{share.mean():+.1%}, {share.std():.1%}", f"{np.median(errors):.3f}",
             f"{np.mean(lost):.3f}"]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def page(cases: Sequence[dict], origin: Origin) -> str:
    """Return the page."""
    rows = [row for case in cases if case["kind"] == "cause" for row in case["rows"]]
    within = sum(
        row["least"] - 2.0 * row["error"] <= row["nested"] <= row["most"] + 2.0 * row["error"]
        for row in rows
    )
    shares = [(row["nested"] - row["closed"]) / (row["most"] - row["least"]) for row in rows]
    return _PAGE.format(
        rates=", ".join(f"{rate:g}" for rate in RATES), drawn=_DRAWN, best=_BEST, random=_RANDOM,
        command=origin.command, date=origin.date, commit=origin.commit, machine=origin.machine,
        rows="\n".join(_row(kind, cases) for kind in ("constants", "cause")), within=within,
        tests=len(rows), share=np.mean(shares), sd=np.std(shares),
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "design_error.md")
    options = parser.parse_args()
    folder = ROOT / "build" / "validation" / code_digest()
    store = Store(folder / f"design_error-seed{options.seed}.jsonl")
    with progress() as bar:
        missing = [index for index in range(options.pads) if index not in store.cases]
        for index in bar.track(missing, description="pads"):
            store.add(error_case(index, options.seed))
            forget_compiled()
    command = shlex.join([".venv/bin/python", "validation/design_error.py", *sys.argv[1:]])
    cases = [store.cases[index] for index in range(options.pads)]
    write_whole(options.output, page(cases, Origin.now(command, ROOT)).encode())
    print(f"wrote {options.output}")


if __name__ == "__main__":
    main()
