"""Are adequacy p-values uniform on right models, whatever the noise?

Pads with nothing hidden are read with noise of eight kinds and fitted with the right model
(`adequacy_pads`). Interrupted, it goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import cache, partial

import numpy as np
from adequacy_pads import KINDS, Bench
from results import JOBS, Origin, Table, finished
from scipy.stats import binomtest, kstest

LEVELS = (0.01, 0.05, 0.95, 0.99)
"""Of p-values, whose tails are counted."""
COLUMNS = (
    "noise", "pads", "KS", "below 0.01", "below 0.05", "above 0.95", "above 0.99",
    "alarms of `check`",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, default=300, help="empty pads of each kind of noise")
    parser.add_argument("--seed", type=int, default=1, help="decides all pads and their noise")
    parser.add_argument("--jobs", type=int, default=JOBS)
    options = parser.parse_args()
    origin, rows = Origin.now(), []
    for letter, kind in KINDS.items():
        pads = options.pads if kind.noisy else min(options.pads, kind.pads)
        name, study = f"adequacy-{letter}-seed{options.seed}", partial(run, letter, options.seed)
        rows.append(row(letter, finished(name, study, range(pads), options.jobs)))
    Table(origin, options.pads, COLUMNS, rows).write("adequacy")


def run(letter: str, seed: int, index: int) -> dict:
    """Return one pad's p-values."""
    return _bench(letter, seed).run(index)


@cache
def _bench(letter: str, seed: int) -> Bench:
    return Bench(letter, seed)


def row(letter: str, pads: Sequence[dict]) -> list[str]:
    """Return the row of a kind of noise."""
    ps = np.array([pad["p"] for pad in pads])
    tails = [_share(int(np.sum(ps < x if x < 0.5 else ps > x)), ps.size) for x in LEVELS]
    alarms = sum(pad["alarm"] for pad in pads)
    most = binomtest(alarms, ps.size, alternative="less").proportion_ci().high
    return [
        f"({letter}) {KINDS[letter].words}", str(ps.size), f"{kstest(ps, 'uniform').pvalue:.2g}",
        *tails, f"{alarms / ps.size:.1%} (at most {most:.1%})",
    ]  # fmt: skip


def _share(count: int, size: int) -> str:
    bounds = binomtest(count, size).proportion_ci()
    return f"{count / size:.1%} ({bounds.low:.1%} to {bounds.high:.1%})"


if __name__ == "__main__":
    main()
