r"""The ceiling of a blind run: in how many studies could an observer tell what is missing at all?

The observer knows every mechanism of the population, the pad's laws, the noise and the motion, and
the shape of whatever else is hidden, but no constant: those of the pad are free, and of anything
else that is hidden only the size is known, to a factor of about one. As in `blind.visible`, the
pattern p of a hidden mechanism is the difference of two simulations without noise, whitened by the
errors' covariance and projected off the simulator's slopes by the law's constants. With O, the
patterns of all others that are hidden, which count as errors of their true size,

.. math:: \chi^2 = |p|^2 \text{ (seen)}, \qquad
          \chi^2 = p^T (1 + O O^T)^{-1} p \text{ (told)}.

A mechanism with k constants *could be seen*, or *told*, where chi^2 - k ln(1 + chi^2) > 10. A study
could be told where all its hidden mechanisms could; with nothing hidden it always could. Whether
another mechanism imitates a hidden one is not asked: the ceiling that is found is an upper bound.

`ceiling.py --run support --minutes 10` computes this for the studies of a run that are simulated
soonest, of each kind in turn, as many as fit in so many minutes of CPU, and writes
validation/results/ceiling.json.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

import numpy as np
from blind.counting import Case, has_failed, is_right, names_wrongly
from blind.population import KINDS
from blind.store import Store
from blind.study import BlindStudy, make_study
from blind.visible import SEEN, _expected_evidence, _factors, _slopes, _some
from guess_pads import soonest
from numpy.typing import NDArray
from registration import Registration
from results import BUILD, Origin, Table, share
from runs import read_cases
from scipy.linalg import solve_triangular

Array = NDArray[np.float64]


def patterns(study: BlindStudy) -> Array:
    """Return the whitened pattern (E, n) of each hidden mechanism, projected off the constants."""
    times = [t[_some(t.size)] for t in study.times]
    whole = study.forces(study.law, study.effects, times)
    factors = _factors(study, times, whole)
    rows = []
    for effect in study.effects:
        others = [other for other in study.effects if other is not effect]
        rest = study.forces(study.law, others, times)
        rows.append(_whitened(factors, [a - b for a, b in zip(whole, rest, strict=True)]))
    slopes = _whitened(factors, _slopes(study, times, whole))
    scale = np.linalg.norm(slopes, axis=0)
    basis, values, _ = np.linalg.svd(
        slopes / np.where(scale > 0.0, scale, 1.0), full_matrices=False
    )
    basis = basis[:, values > 1e-8 * values.max()]
    left = np.array(rows)
    return np.asarray(left - (left @ basis) @ basis.T)


def _whitened(factors: Sequence[Array], parts: Sequence[Array]) -> Array:
    solved = [solve_triangular(f, p, lower=True) for f, p in zip(factors, parts, strict=True)]
    return np.concatenate(solved)


def against_others(left: Array) -> Array:
    """Return chi^2 (E,) of each pattern (E, n) where the others are errors of their true size."""
    found = []
    for k, own in enumerate(left):
        others = np.delete(left, k, axis=0)
        with_own = others @ own
        inner = np.eye(len(others)) + others @ others.T
        found.append(own @ own - with_own @ np.linalg.solve(inner, with_own))
    return np.array(found)


def ceiling_of(study: BlindStudy) -> dict[str, dict[str, float]]:
    """Return the expected 2 ln(Bayes factor) of each hidden mechanism, seen and told, by name."""
    if not study.effects:
        return {"seen": {}, "told": {}}
    left = patterns(study)
    both = {"seen": np.sum(left**2, axis=1), "told": against_others(left)}
    return {
        key: {
            effect.name: _expected_evidence(float(one), effect)
            for effect, one in zip(study.effects, chi2, strict=True)
        }
        for key, chi2 in both.items()
    }


def could_be(case: Case, key: str) -> bool:
    """Return whether all that is hidden in a study could be ``seen`` or ``told``."""
    return all(value > SEEN for value in case["ceiling"][key].values())


def rows(cases: Sequence[Case]) -> list[list[str]]:
    """Return the rows of the table: of each kind, studies, what could be seen and told, right."""
    table = []
    for words, kinds in (*((kind.replace("_", " "), (kind,)) for kind in KINDS), ("all", KINDS)):
        some = [case for case in cases if case["kind"] in kinds]
        seen = [case for case in some if could_be(case, "seen")]
        clear = [case for case in some if could_be(case, "told")]
        right, wrong = (sum(map(hit, clear)) for hit in (is_right, names_wrongly))
        unclear = [case for case in some if not could_be(case, "told")]
        table.append(
            [
                words, str(len(some)), share(len(seen), len(some)), share(len(clear), len(some)),
                share(right, len(clear)), share(wrong, len(clear)),
                share(sum(map(is_right, unclear)), len(unclear)),
            ]
        )  # fmt: skip
    return table


COLUMNS = [
    "hidden", "studies", "could be seen", "could be told", "right of these", "wrong name of these",
    "right of the others",
]  # fmt: skip


def main() -> int:
    """Compute what is not stored while there is time, and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", default="support", help="registered run, whose studies are kept")
    parser.add_argument("--minutes", type=float, default=10.0, help="of CPU, at most")
    options = parser.parse_args()
    origin = Origin.now()
    population = Registration.read(options.run).population
    store = Store(BUILD / f"ceiling-{population.key}.jsonl")
    begun, found = time.process_time(), []
    for case in soonest(read_cases(options.run)):
        index = case["index"]
        if index not in store.cases and time.process_time() - begun < 60.0 * options.minutes:
            store.add({"index": index, **ceiling_of(make_study(population, index))})
        if index in store.cases and not has_failed(case):
            found.append(case | {"ceiling": store.cases[index]})
    notes = [f"{len(found)} studies of the run *{options.run}*, those that are simulated soonest."]
    Table(origin, len(found), COLUMNS, rows(found), notes).write("ceiling")
    return 0


if __name__ == "__main__":
    sys.exit(main())
