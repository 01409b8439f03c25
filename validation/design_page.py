"""The page docs/design_proof.md, from finished cases."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from design_cases import FIRST, MINUTES, RATES, SCREENED, SIZES
from design_counting import (
    CERTAIN,
    HIDDEN,
    OPEN,
    SURE,
    goals,
    halvings,
    judged,
    ratios,
    rows_of,
    slope,
    verdict,
)
from page import Origin

_PAGE = """# Does the proposed test bring what is expected of it?

Simulated pads, by differential equations that share no code with the model; correlated noise, 500
rows a test. Seed, order, rules of the count and goals were committed before the run
(`validation/registered/design_{name}.json`); every case that finished counts, as it came out.

| | |
|---|---|
| command | `{command}` |
| date | {date} |
| commit | {commit} |
| machine | {machine} |
| seed | {seed} |
| cases | {done} of {total}, in the fixed order |

{goals}

## Constants

{pads} pads: every other one with one test at 20 mm/s, the others with three at 1, 20 and 100 mm/s.
The proposed test is the best of {screened} for the constant that is known worst, in bits per
minute, within {minutes:g} minutes; the standard one is the paper's (1.6 mm at 20 mm/s, 30 s, back
to 0.8 mm, 30 s); one is random. Every one was done and all tests were fitted together. *Expected*
and *realised* bits are for all constants: the fall of the log2 volume of the posterior. *Anew*: the
noise floor is measured in all tests, as a user would see it; *held*: it stays what was
assumed. *Noise*: sd of the floor measured anew over the assumed one.

{slopes}

{halvings}

{rows}

## The cause

{cause}

## Something unlisted

{unlisted}

## How to read it

- Slopes are by least squares through zero over all tests, proposed, standard and random ones.
- Halvings of the worst constant's sd per minute: log2(sd now/sd after)/minutes; the ratio is that
  of each pad's two, and the median over the pads counts. Where the standard test did not lower the
  sd and the proposed one did, the ratio counts as infinite; where neither did, as 0.
- A pad is resolved rightly where the hidden cause, summed over base laws, has a probability of
  {sure:g} or more, wrongly where another one has. A pad of which the diagnosis did not list the
  hidden cause counts as not resolved.
- A pad *looks certain* where the probability that something unlisted is there was {open_at:g} or
  more, and is below {certain_at:g} after the proposed test.
"""


def page(cases: Sequence[dict], total: int, name: str, registered: dict, origin: Origin) -> str:
    """The whole page."""
    constants, cause, outside = (
        [case for case in cases if case["kind"] == kind]
        for kind in ("constants", "cause", "outside")
    )
    met = {True: "met", False: "**missed**", None: "no case"}
    asked = [[words, value, met[yes]] for words, value, yes in goals(constants, cause, outside)]
    return _PAGE.format(
        name=name, command=origin.command, date=origin.date, commit=origin.commit,
        machine=origin.machine, seed=registered["seed"], done=len(cases), total=total,
        goals=_table(["asked", "found", ""], asked), pads=len(constants), screened=SCREENED,
        minutes=MINUTES, slopes=_slopes(constants), halvings=_halvings(constants),
        rows=_rows(constants), cause=_cause(cause), unlisted=_unlisted(outside), sure=SURE,
        open_at=OPEN, certain_at=CERTAIN,
    )  # fmt: skip


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _slopes(cases: Sequence[dict]) -> str:
    head = ["pads with", "next tests", "slope anew", "correlation", "slope held", "correlation"]
    table = []
    for count in sorted({len(rates) for rates in FIRST}):
        rows = rows_of([case for case in cases if case["first"] == count])
        if len(rows) > 2:
            cells = [f"{count} tests" if count > 1 else "1 test", str(len(rows))]
            for key in ("realised", "held"):
                x, y = (np.array([row[k] for row in rows]) for k in ("promised", key))
                value, error = slope(rows, key)
                cells += [f"{value:.2f} ± {error:.2f}", f"{np.corrcoef(x, y)[0, 1]:.2f}"]
            table.append(cells)
    return _table(head, table)


def _halvings(cases: Sequence[dict]) -> str:
    head = ["halvings of the worst sd a minute, median", "proposed", "standard", "random"]
    head += ["ratio of each pad's first two, median", "its quartiles"]
    table = []
    kinds = {"sd_realised": "noise anew", "sd_held": "noise held", "sd_promised": "as expected"}
    for key, words in kinds.items():
        names = ("proposed", "standard", "random")
        cells = [words, *(f"{np.median(halvings(cases, name, key)):.2f}" for name in names)]
        found = ratios(cases, key)
        low, high = np.quantile(found, [0.25, 0.75], method="nearest")
        table.append([*cells, f"{np.median(found):.1f}", f"{low:.1f}, {high:.1f}"])
    return _table(head, table)


def _rows(cases: Sequence[dict]) -> str:
    head = ["pad", "tests", "worst constant", "test", "minutes", "bits expected", "realised anew"]
    head += ["held", "noise", "sd now", "expected", "anew", "held"]
    table = []
    for case in cases:
        for row in case["rows"]:
            cells = [str(case["index"]), str(case["first"]), case["worst"], row["test"]]
            bits = ("minutes", "promised", "realised", "held", "noise")
            cells += [f"{row[key]:.2f}" for key in bits]
            sds = ("sd_now", "sd_promised", "sd_realised", "sd_held")
            table.append([*cells, *(f"{row[key]:.2g}" for key in sds)])
    return _table(head, table)


def _cause(cases: Sequence[dict]) -> str:
    """Report the pads with a drag that grows nearly as the speed."""
    some = judged(cases)
    rates = ", ".join(f"{rate:g}" for rate in RATES)
    listed = sum(HIDDEN in case["causes"] for case in some)
    said = (
        f"{len(cases)} pads with a drag that grows as the 0.8th to 0.95th power of the speed, "
        f"tested at {rates} mm/s: the diagnosis called {len(some)} ambiguous, and of {listed} of "
        "these the hidden set of effects is among those that the design reckons with. The proposed "
        f"test is the best of {SCREENED} by all bits for the cause within {MINUTES:g} minutes; the "
        "random one is as long within a quarter. What a test adds to each explanation's evidence "
        "was multiplied into the diagnosis's probability."
    )
    return "\n\n".join([said, _causes(some), _resolved(some)])


def _causes(cases: Sequence[dict]) -> str:
    """A row a kind of test."""
    head = ["test", "resolved rightly", "wrongly", "open", "bits expected, mean"]
    head += ["bits gained by the hidden cause, mean", "minutes, median"]
    table = []
    for name in ("proposed", "random", "standard"):
        pairs = [(case, row) for case in cases for row in rows_of([case], name)]
        if not pairs:
            continue
        found = [verdict(row) for _, row in pairs]
        gains = [
            np.log2(row["after"][HIDDEN] / case["causes"][HIDDEN])
            for case, row in pairs
            if row["after"].get(HIDDEN, 0.0) > 0.0
        ]
        expected = np.mean([row["promised"][0] for _, row in pairs])
        cells = [name, *(str(found.count(key)) for key in ("right", "wrong", "open"))]
        cells += [f"{expected:.2f}", f"{np.mean(gains):.2f}" if gains else ""]
        table.append([*cells, f"{np.median([row['minutes'] for _, row in pairs]):.1f}"])
    return _table(head, table)


def _resolved(cases: Sequence[dict]) -> str:
    """A row a test."""
    head = ["pad", "bits missing", "test", "minutes", "bits expected, at least and at most"]
    head += ["hidden cause before", "after", "likeliest after"]
    table = []
    for case in cases:
        for row in case["rows"]:
            best = max(row["after"], key=lambda key: row["after"][key])
            low, high = row["promised"]
            cells = [str(case["index"]), f"{case['entropy']:.2f}", f"{row['test']}: {row['words']}"]
            cells += [f"{row['minutes']:.2f}", f"{low:.2f}, {high:.2f}"]
            cells += [
                f"{case['causes'].get(HIDDEN, 0.0):.3f}",
                f"{row['after'].get(HIDDEN, 0):.3f}",
            ]
            table.append([*cells, f"{best} ({row['after'][best]:.3f})"])
    return _table(head, table)


def _unlisted(cases: Sequence[dict]) -> str:
    low, high = SIZES
    said = (
        f"{len(cases)} pads with an effect of no candidate's form hidden, {low:.0%} to {high:.0%} "
        "of the peak force; the test proposed for all that is not known was done, and the whole "
        "diagnosis made again."
    )
    head = ["pad", "hidden", "share of the peak", "test", "bits expected for the cause"]
    head += ["bits missing", "P(outside) before", "after", "verdict before", "after"]
    table = [
        [str(c["index"]), c["hidden"], f"{c['size']:.3f}", c["words"], f"{c['promised'][0]:.2f}",
         f"{c['entropy']:.2f}", f"{c['before']:.3f}", f"{c['after']:.3f}", *c["verdicts"]]
        for c in cases
    ]  # fmt: skip
    return f"{said}\n\n{_table(head, table)}"
