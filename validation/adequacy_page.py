"""The page docs/adequacy.md, from finished pads."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from adequacy_pads import KINDS, NOISELESS_PADS, PADS, RATES, ROWS
from page import Origin
from scipy.stats import binomtest, kstest

LEVELS = (0.01, 0.05, 0.95, 0.99)

_HEAD = """# Validation: is a right model called right, whatever the noise?

Pads with nothing hidden were simulated by differential equations that share no code with the fit
(the paper's protocol at {rates} mm/s, {rows} rows a test, {sets} sets of constants), read with
noise of eight kinds, and fitted with the right model. The p-value of the adequacy test should be
uniform: one in a hundred below 0.01, one in twenty above 0.95. `check` should accuse one pad in a
hundred.

| | |
|---|---|
| command | `{command}` |
| date | {date} |
| commit | {commit} |
| machine | {machine} |

| noise | pads | KS | below 0.01 | below 0.05 | above 0.95 | above 0.99 | alarms of `check` |
|---|---|---|---|---|---|---|---|
{rows_of_table}

*KS*: p-value of Kolmogorov and Smirnov's test of uniformity. Shares are followed by their two-sided
95 % bounds (Clopper and Pearson), the alarms by their one-sided 95 % upper bound.

Without any hold ("g") the noise is measured about smooth curves of single strokes, which take some
of it for the pad's: p is too low, the answer says that this is not testable, and a pad is called
adequate all the same where what is left over all is below the tolerance. Without noise ("h") what
is left is the error of the numbers, far below the floor that stands in for it: each of its
{noiseless} sets of constants gives one p-value, and only the low ones mean anything.
"""


def write(path: Path, results: Mapping[str, Sequence[dict]], origin: Origin) -> None:
    """Write the page whole or not at all."""
    part = path.with_suffix(".part")
    part.parent.mkdir(parents=True, exist_ok=True)
    part.write_text(page(results, origin), encoding="utf-8")
    os.replace(part, path)


def page(results: Mapping[str, Sequence[dict]], origin: Origin) -> str:
    """Markdown."""
    rows = "\n".join(_row(kind, pads) for kind, pads in results.items())
    rates = ", ".join(f"{rate:g}" for rate in RATES)
    return _HEAD.format(
        rates=rates,
        rows=ROWS,
        rows_of_table=rows,
        sets=PADS,
        noiseless=NOISELESS_PADS,
        **vars(origin),
    )


def _row(kind: str, pads: Sequence[dict]) -> str:
    ps = np.array([pad["p"] for pad in pads])
    tails = [_share(int(np.sum(ps < x if x < 0.5 else ps > x)), ps.size) for x in LEVELS]
    alarms = sum(pad["alarm"] for pad in pads)
    most = binomtest(alarms, ps.size, alternative="less").proportion_ci().high
    cells = [
        f"({kind}) {KINDS[kind].words}", str(ps.size), f"{kstest(ps, 'uniform').pvalue:.2g}",
        *tails,
        f"{alarms / ps.size:.1%} (at most {most:.1%})",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def _share(count: int, size: int) -> str:
    bounds = binomtest(count, size).proportion_ci()
    return f"{count / size:.1%} ({bounds.low:.1%} to {bounds.high:.1%})"
