"""Count how often a comparison of two pads is right, on simulated pairs.

Interrupted, it goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from functools import partial
from math import sqrt

import numpy as np
from calibration import HIGH, LOW
from results import JOBS, Origin, Table, finished
from simulated_pairs import run_pair

MOST_ALARMS = 0.05
COLUMNS = ("pairs", "n", "called different", "called equal", "cannot tell")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=40, help="half of them equal")
    parser.add_argument("--seed", type=int, default=1, help="decides all pads and their noise")
    parser.add_argument("--jobs", type=int, default=JOBS)
    options = parser.parse_args()
    origin, name = Origin.now(), f"pairs-seed{options.seed}"
    study = partial(run_pair, options.seed)
    table(finished(name, study, range(options.pairs), options.jobs), origin).write("pairs")


def table(pairs: Sequence[dict], origin: Origin) -> Table:
    """Return the verdicts on the pairs by their kind, and what is asked with what was found."""
    rows = []
    for kind in dict.fromkeys(pair["kind"] for pair in pairs):
        found = [pair["differ"] for pair in pairs if pair["kind"] == kind]
        counts = [sum(x is value for x in found) for value in (True, False, None)]
        rows.append([kind, str(len(found)), *map(str, counts)])
    return Table(origin, len(pairs), COLUMNS, rows, list(_results(pairs)))


def _results(pairs: Sequence[dict]) -> Iterator[str]:
    """Yield lines with what is asked, and what was found."""
    share, error = pooled_coverage(pairs)
    equal = [pair["differ"] is True for pair in pairs if pair["kind"] == "equal"]
    alarms = float(np.mean(equal))
    names = dict.fromkeys(name for pair in pairs for name in pair["contrasts"])
    shares = {name: float(np.mean(_inside(pairs, name))) for name in names}
    outside = [f"{name} {x:.0%}" for name, x in shares.items() if not LOW <= x <= HIGH]
    inside = min(share - LOW, HIGH - share)
    yield (
        f"- 90 % intervals of differences hold the truth in {share:.1%} ± {error:.1%} (asked: "
        f"{LOW:.0%} to {HIGH:.0%}): {_met(inside, error)}."
    )
    yield (
        f"- Equal pairs called different: {sum(equal)} of {len(equal)} (asked: at most "
        f"{MOST_ALARMS:.0%}): {_met(MOST_ALARMS - alarms, _error(equal))}."
    )
    yield (
        f"- One by one, {len(outside)} of {len(names)} quantities are outside {LOW:.0%} to "
        f"{HIGH:.0%}{': ' if outside else ''}{', '.join(outside)}; of one quantity the share is "
        f"known to ± {sqrt(0.9 * 0.1 / len(pairs)):.1%} only."
    )
    converged = np.mean([c for pair in pairs for c in pair["converged"]])
    yield f"- {converged:.0%} of the fits converged."


def _met(margin: float, error: float) -> str:
    """In bold, and whether so few pairs can tell."""
    word = "**met**" if margin >= 0.0 else "**not met**"
    near = abs(margin) < 2.0 * error
    return f"{word}, within two standard errors of the bound" if near else word


def pooled_coverage(pairs: Sequence[dict]) -> tuple[float, float]:
    """Share of all intervals that hold the truth, and its standard error over pairs."""
    shares = [np.mean([_holds(c) for c in pair["contrasts"].values()]) for pair in pairs]
    return float(np.mean(shares)), float(np.std(shares) / sqrt(max(len(shares) - 1, 1)))


def _holds(c: dict) -> bool:
    return bool(c["low"] <= c["first"] - c["second"] <= c["high"])


def _inside(pairs: Sequence[dict], name: str) -> list[bool]:
    return [_holds(pair["contrasts"][name]) for pair in pairs if name in pair["contrasts"]]


def _error(found: Sequence[bool]) -> float:
    """Binomial standard error of a share, shrunk off 0 and 1, where it would be none."""
    share = (sum(found) + 1.0) / (len(found) + 2.0)
    return sqrt(share * (1.0 - share) / max(len(found), 1))


if __name__ == "__main__":
    main()
