"""Learn how often an effect with such evidence is there, from registered blind studies.

`certainty.py RUN RUN ... -o docs/certainty.md` reads docs/wide_RUN.json, learns the weights of
`qlvbayes/diagnosis/certainty.py`, writes them with their provenance to certainty.json next to it,
and a page with what they are worth on studies that they were not learnt from.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from page import Origin
from scipy.stats import beta

import qlvbayes.diagnosis.certainty as package
from qlvbayes.diagnosis.certainty import FEATURES, LEAST, features
from qlvbayes.diagnosis.result import Support
from qlvbayes.evaluation.counting import Case, true_names
from qlvbayes.io.files import write_json, write_whole

ROOT = Path(__file__).resolve().parents[1]
Array = NDArray[np.float64]

FOLDS = 10
"""Parts of the studies, each of which is left out once."""
EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)
"""Of the bins of certainty: fifths, the last one halved where names are given."""
_RIDGE = 1.0  # penalty on a weight of a standardised feature: as one more study each way
_STEPS = 50  # of Newton's method, which ends in under ten

_HEAD = """# Validation: does certainty keep its word?

The posterior over hypotheses takes what is missing to be one of them. `certainty` in
`diagnosis.json` corrects it by what happened in {studies} registered blind studies ({runs}), in
which {names} effects had a probability of {least:.0%} or more: it is a logistic regression on
{count} features of a diagnosis that is finished ({features}).
A name counts as right by the rules of the count of those runs. Here each study's names have the
certainty that the other nine tenths of the studies give.

| | |
|---|---|
| command | `{command}` |
| date, commit | {date}, {commit} |
| machine | {machine} |

| certainty | names | there | 95 % bounds | mean certainty |
|---|---|---|---|---|
{table}

Mean log loss of a name, in nats: **{loss:.3f}**; of the posterior probability itself
{stated:.3f}, of one share for all {share:.3f}. An effect with a feature outside of the range seen
in the studies has no certainty.

An earlier certainty was learnt on the runs [bounds](wide_bounds.md) and [beam](wide_beam.md), from
four features that the answer alone has. On the run *support*, from which none of it was learnt, it
kept its word: of 87 names with a certainty of 0.9 or more 82 were there, of 26 between 0.8 and 0.9
23, of 75 between 0.6 and 0.8 49, of 81 between 0.4 and 0.6 31, of 95 between 0.2 and 0.4 31, and of
45 below 7. Its mean log loss there was 0.515, and 1.999 of the probability itself.

| feature | lowest | highest | weight |
|---|---|---|---|
{weights}
"""


@dataclass(frozen=True)
class Name:
    """An effect that a study's diagnosis took to be likely, and whether it is there."""

    run: str
    study: int
    effect: str
    x: Array
    stated: float
    there: bool


def runs_asked_for(description: str | None, page: str) -> tuple[dict[str, list[Case]], Path]:
    """Return the studies of each run on the command line that could be seen, and the output."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("runs", nargs="+", help="registered runs, in the order of their dates")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / page)
    options = parser.parse_args()
    return {run: seen_cases(run) for run in options.runs}, options.output


def seen_cases(run: str) -> list[Case]:
    """Return the published studies of a run that could be seen and were diagnosed."""
    text = (ROOT / "docs" / f"wide_{run}.json").read_text(encoding="utf-8")
    cases = json.loads(text)["cases"]
    return [case for case in cases if case.get("seen") and case.get("stages")]


def names_of(run: str, cases: Sequence[Case]) -> Iterator[Name]:
    """Every effect of a probability of `LEAST` or more, in studies that could be seen."""
    for case in cases:
        there = true_names(case)
        for effect, stated in case["probabilities"].items():
            factor, support = case["log_bayes_factors"].get(effect), case["support"].get(effect)
            if stated < LEAST or factor is None or support is None:
                continue
            x = features(factor, Support(**support))
            yield Name(run, case["index"], effect, x, stated, effect in there)


def learnt(x: Array, there: Array) -> Array:
    """Return weights (1 + F,) by penalised likelihood, the constant first; x (n, F), there (n,)."""
    mean, sd = x.mean(axis=0), x.std(axis=0)
    design = np.column_stack([np.ones(len(x)), (x - mean) / sd])
    penalty = _RIDGE * np.diag([0.0, *np.ones(x.shape[1])])
    weights = np.zeros(design.shape[1])
    for _ in range(_STEPS):
        share = _logistic(design @ weights)
        slope = design.T @ (share - there) + penalty @ weights
        curvature = (design.T * (share * (1.0 - share))) @ design + penalty
        weights = weights - np.linalg.solve(curvature, slope)
    return np.concatenate([[weights[0] - weights[1:] @ (mean / sd)], weights[1:] / sd])


def _logistic(log_odds: Array) -> Array:
    return 1.0 / (1.0 + np.exp(-log_odds))


def given(weights: Array, x: Array) -> Array:
    """Return certainties (n,) at features (n, F)."""
    return _logistic(weights[0] + x @ weights[1:])


def left_out(names: Sequence[Name]) -> Array:
    """Certainty (n,) of every name by the studies of the other folds."""
    x, there = columns(names)
    studies = sorted({(name.run, name.study) for name in names})
    order = np.random.default_rng(0).permutation(len(studies))
    fold = {study: int(order[k]) % FOLDS for k, study in enumerate(studies)}
    folds = np.array([fold[name.run, name.study] for name in names])
    found = np.zeros(len(names))
    for k in range(FOLDS):
        found[folds == k] = given(learnt(x[folds != k], there[folds != k]), x[folds == k])
    return found


def columns(names: Sequence[Name]) -> tuple[Array, Array]:
    return np.array([name.x for name in names]), np.array([float(name.there) for name in names])


def loss(certainties: Array, there: Array) -> float:
    """Mean log loss (nats); what is stated as sure counts as sure to a thousandth."""
    some = np.clip(certainties, 1e-3, 1.0 - 1e-3)
    return float(-np.mean(there * np.log(some) + (1.0 - there) * np.log(1.0 - some)))


def bins(certainties: Array, there: Array) -> list[tuple[float, float, int, int, float]]:
    """Return of each bin its ends, how many names, how many there, and the mean certainty."""
    found = []
    for low, high in pairwise(EDGES):
        inside = (certainties >= low) & ((certainties < high) | (high == 1.0))
        if inside.any():
            count, right = int(inside.sum()), int(there[inside].sum())
            found.append((low, high, count, right, float(certainties[inside].mean())))
    return found


def _bounds(right: int, count: int) -> str:
    """Clopper and Pearson's, two-sided."""
    low = beta.ppf(0.025, right, count - right + 1) if right else 0.0
    high = beta.ppf(0.975, right + 1, count - right) if right < count else 1.0
    return f"{low:.0%} to {high:.0%}"


def rows(certainties: Array, there: Array) -> list[str]:
    """Return the rows of the table of bins: names, those there with bounds, mean certainty."""
    return [
        f"| {low:.1f} to {high:.1f} | {count} | {right} ({right / count:.0%}) | "
        f"{_bounds(right, count)} | {mean:.2f} |"
        for low, high, count, right, mean in bins(certainties, there)
    ]


def page(names: Sequence[Name], weights: Array, command: str) -> str:
    """The page."""
    x, there = columns(names)
    found = left_out(names)
    runs = list(dict.fromkeys(name.run for name in names))
    origin = Origin.now(command, ROOT)
    about = zip(FEATURES, x.min(axis=0), x.max(axis=0), weights[1:], strict=True)
    return _HEAD.format(
        studies=len({(name.run, name.study) for name in names}),
        runs=", ".join(f"[{run}](wide_{run}.md)" for run in runs),
        names=len(names),
        least=LEAST,
        count=len(FEATURES),
        features=", ".join(f"`{name}`" for name in FEATURES),
        command=command,
        date=origin.date,
        commit=origin.commit,
        machine=origin.machine,
        table="\n".join(rows(found, there)),
        loss=loss(found, there),
        stated=loss(np.array([name.stated for name in names]), there),
        share=loss(np.full(len(names), there.mean()), there),
        weights="\n".join(f"| {n} | {a:.2f} | {b:.2f} | {w:.2f} |" for n, a, b, w in about),
    )


def main() -> int:
    """Learn, write the weights and the page."""
    runs, output = runs_asked_for(__doc__, "certainty.md")
    names = [name for run, cases in runs.items() for name in names_of(run, cases)]
    x, there = columns(names)
    weights = learnt(x, there)
    known = {
        "weights": weights.tolist(),
        "low": x.min(axis=0).tolist(),
        "high": x.max(axis=0).tolist(),
        "names": len(names),
        "studies": len({(name.run, name.study) for name in names}),
        "runs": list(runs),
        "bins": [row[:4] for row in bins(left_out(names), there)],
    }
    write_json(Path(str(package.__file__)).with_suffix(".json"), known)
    write_whole(output, page(names, weights, shlex.join(sys.argv)).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
