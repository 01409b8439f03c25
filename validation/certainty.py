"""Learn how often an effect with such evidence is there, from registered blind studies.

`certainty.py RUN RUN ...` reads the studies of runs in validation/results, learns the weights of
`qlvbayes/diagnosis/certainty.py`, and writes them with their provenance to certainty.json next to
it. What they are worth on studies that they were not learnt from is in docs/reliability.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from blind.counting import Case, has_failed, true_names
from msgspec import structs
from numpy.typing import NDArray
from results import grid, share
from runs import read_cases
from scipy.stats import beta

import qlvbayes.diagnosis.certainty as package
from qlvbayes.diagnosis.certainty import LEAST, calibration, features
from qlvbayes.diagnosis.result import Support
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.io.files import write_json

Array = NDArray[np.float64]

FOLDS = 10
"""Parts of the studies, each of which is left out once."""
EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)
"""Of the bins of certainty: fifths, the last one halved where names are given."""
_RIDGE = 1.0  # penalty on a weight of a standardised feature: as one more study each way
_STEPS = 50  # of Newton's method, which ends in under ten


@dataclass(frozen=True)
class Name:
    """An effect that a study's diagnosis took to be likely, and whether it is there."""

    run: str
    study: int
    effect: str
    x: Array
    stated: float
    there: bool


def diagnosed(run: str) -> list[Case]:
    """Return the studies of a run that could be seen and in which the program did not stop."""
    return [case for case in read_cases(run) if case["seen"] and not has_failed(case)]


def names_of(run: str, cases: Sequence[Case]) -> Iterator[Name]:
    """Every effect of a probability of `LEAST` or more, in studies that could be seen."""
    for case in cases:
        there = true_names(case)
        for effect, stated in case["probabilities"].items():
            factor, support = case["log_bayes_factors"].get(effect), case["support"].get(effect)
            if stated < LEAST or factor is None or support is None:
                continue
            x = features(factor, stored_support(support))
            yield Name(run, case["index"], effect, x, stated, effect in there)


def stored_support(support: Mapping[str, Any]) -> Support:
    """Return the support of a stored study; what earlier versions measured besides is left out."""
    known = {field.name for field in structs.fields(Support)}
    return Support(**{"heldout": None} | {k: v for k, v in support.items() if k in known})


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


def rows(certainties: Array, there: Array) -> list[list[str]]:
    """Return the rows of the table of bins: names, those there with bounds, mean certainty."""
    return [
        [f"{low:.1f} to {high:.1f}", str(n), share(right, n), _bounds(right, n), f"{mean:.2f}"]
        for low, high, n, right, mean in bins(certainties, there)
    ]


def of_certainty(learnt_on: str, other: str) -> str:
    """Return how many effects were there, by their certainty and by their stated probability."""
    head = ["run", "certainty", "names", "there", "95 % bounds", "mean certainty"]
    names = list(names_of(learnt_on, diagnosed(learnt_on)))
    known = calibration()
    stated = [(known(name.x), name) for name in names_of(other, diagnosed(other))]
    sure = [(value, name) for value, name in stated if value is not None]
    values_of = {learnt_on: (left_out(names), names)}
    values_of[other] = np.array([value for value, _ in sure]), [name for _, name in sure]
    lines, words = [], []
    for run, (values, some) in values_of.items():
        there = columns(some)[1]
        lines += [[run, *row] for row in rows(values, there)]
        posterior = np.array([name.stated for name in some])
        words.append(
            f"*{run}*: mean log loss of a name {loss(values, there):.2f} nats, of its posterior "
            f"probability {loss(posterior, there):.2f}, of one share for all "
            f"{loss(np.full(len(some), there.mean()), there):.2f}; of names with a posterior "
            f"probability of 0.9 or more, refused or not, "
            f"{share(int(there[posterior >= 0.9].sum()), int((posterior >= 0.9).sum()))} are there."
        )
    return "\n".join([*grid(head, lines), "", *(f"- {line}" for line in words)])


def confirmed(case: Case, certainty: Mapping[str, float]) -> Case:
    """Return a case with the names of the present rule: by probability and certainty alone.

    What a name that is taken back explained is then explained by nothing. `certainty` is that of
    each effect that is likely.
    """
    settings = DiagnosisSettings()
    likely = [one for one, p in case["probabilities"].items() if p >= settings.named]
    kept = [
        one for one in likely if one != "none" and certainty.get(one, 1.0) >= settings.confirmed
    ]
    named = [name for name in case["effects"] if name not in case["group"]]
    if set(kept) == set(named):
        return case
    sound = case["verdict"] in ("adequate", "missing_effect") and set(named) <= set(kept)
    verdict = "missing_effect" if sound else "partly_explained" if kept else "unexplained"
    return case | {"verdict": verdict, "effects": kept, "group": []}


def confirmed_cases(run: str) -> list[Case]:
    """Return the diagnosed studies of a run by that rule, each by the certainty of the others."""
    cases = diagnosed(run)
    names = list(names_of(run, cases))
    own: dict[int, dict[str, float]] = {}
    for name, value in zip(names, left_out(names).tolist(), strict=True):
        own.setdefault(name.study, {})[name.effect] = value
    return [confirmed(case, own.get(case["index"], {})) for case in cases]


def main() -> int:
    """Learn, and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", help="registered runs, in the order of their dates")
    runs = parser.parse_args().runs
    write_json(Path(str(package.__file__)).with_suffix(".json"), weights_of(runs))
    return 0


def weights_of(runs: Sequence[str]) -> dict[str, Any]:
    """Return what certainty.json holds when it is learnt on these runs."""
    names = [name for run in runs for name in names_of(run, diagnosed(run))]
    x, there = columns(names)
    return {
        "weights": learnt(x, there).tolist(),
        "low": x.min(axis=0).tolist(),
        "high": x.max(axis=0).tolist(),
        "names": len(names),
        "studies": len({(name.run, name.study) for name in names}),
        "runs": list(runs),
        "bins": [row[:4] for row in bins(left_out(names), there)],
    }


if __name__ == "__main__":
    sys.exit(main())
