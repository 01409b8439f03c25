"""Does a proposed test bring what it promises, and more than another of the same length? A page.

Interrupted, it goes on where it was: finished cases lie in build/validation.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

import numpy as np
from coverage import progress
from design_cases import MINUTES, SCREENED, SURE, cause_case, constants_case
from keeping import Kept, code_digest
from page import Origin

from qlvbayes.files import write_whole
from qlvbayes.runtime import forget_compiled

ROOT = Path(__file__).resolve().parents[1]

_PAGE = """# Does the proposed test bring what it promises?

Simulated pads, by differential equations that share no code with the model; correlated noise, 500
rows a test. A development run of few pads, published as it came out. Asked for is a slope of 1 +-
0.2, the worst constant's sd falling twice as fast a minute as by the standard test, and 80 % of
ambiguous pads resolved rightly by one proposed test.

| | |
|---|---|
| command | `{command}` |
| date | {date} |
| commit | {commit} |
| machine | {machine} |

## Constants

{pads} pads with one test at 20 mm/s each. The proposed test is the best of {screened} for the
constant that is known worst, in bits per minute, within {minutes:g} minutes; the standard one is
the first test again (1.6 mm at 20 mm/s, 30 s, back to 0.8 mm, 30 s); one is random. Every one was
done and all tests were fitted together. *Promised* and *realised* bits are for all constants:
the fall of the log2 volume of the posterior.

Realised over promised bits, by least squares through zero over all {count} tests: **{slope:.2f}**
(sd {error:.2f}); correlation {correlation:.2f}.

| pad | worst constant | test | minutes | bits promised | realised | sd now | promised | realised |
|---|---|---|---|---|---|---|---|---|
{rows}

Halvings of the worst constant's sd per minute, median over the pads: proposed **{proposed:.2f}**,
standard **{standard:.2f}**, ratio of each pad's two: **{ratio:.1f}**.

## The cause

{cause}

## How to read it

Few pads say whether the machinery works, not how well. Where promised and realised bits are far
apart, why has not been looked into. Tests are ranked by bits per minute, so that a quick test that
tells a part of the cause beats a longer one that tells all of it; and base laws count as
explanations too, so that bits for the cause may be spent on them.
"""


def main() -> None:
    options = _options()
    command = shlex.join([".venv/bin/python", "validation/design.py", *sys.argv[1:]])
    origin = Origin.now(command, ROOT)
    file = ROOT / "build" / "validation" / code_digest() / f"design-seed{options.seed}.jsonl"
    kept = Kept(file)
    work = [(constants_case, k, k) for k in range(options.pads)]
    work += [(cause_case, k, 1000 + k) for k in range(options.ambiguous)]
    missing = [one for one in work if one[2] not in kept.fits]
    with progress() as bar:
        for case, k, _ in bar.track(missing, description="pads"):
            kept.add(case(k, options.seed))
            forget_compiled()
    wanted = {key for *_, key in work}
    cases = [case for key, case in sorted(kept.fits.items()) if key in wanted]
    write_whole(options.output, _page(cases, origin).encode())
    print(f"wrote {options.output}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, default=6)
    parser.add_argument("--ambiguous", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "design_proof.md")
    return parser.parse_args()


def _page(cases: list[dict], origin: Origin) -> str:
    constants = [case for case in cases if case["kind"] == "constants"]
    rows = [row for case in constants for row in case["rows"]]
    x, y = (np.array([row[key] for row in rows]) for key in ("promised", "realised"))
    slope = float(x @ y / (x @ x))
    error = float(np.sqrt(np.sum((y - slope * x) ** 2) / (x.size - 1) / (x @ x)))
    rates = {name: _rates(constants, name) for name in ("proposed", "standard")}
    return _PAGE.format(
        command=origin.command,
        date=origin.date,
        commit=origin.commit,
        machine=origin.machine,
        pads=len(constants),
        screened=SCREENED,
        minutes=MINUTES,
        count=x.size,
        slope=slope,
        error=error,
        correlation=float(np.corrcoef(x, y)[0, 1]),
        rows="\n".join(_row(case, row) for case in constants for row in case["rows"]),
        proposed=float(np.median(rates["proposed"])),
        standard=float(np.median(rates["standard"])),
        ratio=float(np.median(rates["proposed"] / rates["standard"])),
        cause=_cause([case for case in cases if case["kind"] == "cause"]),
    )


def _rates(cases: list[dict], name: str) -> np.ndarray:
    rows = [row for case in cases for row in case["rows"] if row["test"] == name]
    return np.array([np.log2(r["sd_now"] / r["sd_realised"]) / r["minutes"] for r in rows])


def _row(case: dict, row: dict) -> str:
    sds = (row[key] for key in ("sd_now", "sd_promised", "sd_realised"))
    cells = [str(case["index"]), case["worst"], row["test"], f"{row['minutes']:.2f}"]
    cells += [f"{row['promised']:.2f}", f"{row['realised']:.2f}", *(f"{sd:.2g}" for sd in sds)]
    return f"| {' | '.join(cells)} |"


def _cause(cases: list[dict]) -> str:
    """What became of the pads with a drag that grows nearly as the speed."""
    judged = [case for case in cases if "rows" in case]
    said = [
        f"Of {len(cases)} pads with a drag that grows as the 0.8th to 0.95th power of the speed, "
        f"tested at 0.1, 1, 20 and 100 mm/s, the diagnosis called {len(judged)} ambiguous. "
        "The explanations that it left were weighed without and with one test more, and what that "
        "adds to the evidence of each was multiplied into the diagnosis's probability; resolved "
        "means that "
        f"the hidden one has a probability of {SURE:g} or more."
    ]
    for name in ("proposed", "random"):
        rows = [row for case in judged for row in case["rows"] if row["test"] == name]
        right, wrong = (sum(row[key] for row in rows) for key in ("resolved", "wrong"))
        said.append(
            f"{name.capitalize()} test: {right} of {len(rows)} resolved rightly, {wrong} wrongly."
        )
    table = [
        "| pad | bits missing | promised | test | minutes | probability of the hidden one before "
        "| after |",
        "|---|---|---|---|---|---|---|",
    ]
    table += [
        f"| {case['index']} | {case['entropy']:.2f} | {case['promised'][0]:.2f} | "
        f"{row['test']}: {row['words']} | {row['minutes']:.2f} | "
        f"{case['before']:.3f} | {row['right']:.3f} |"
        for case in judged
        for row in case["rows"]
    ]
    return "\n\n".join(said) + "\n\n" + "\n".join(table)


if __name__ == "__main__":
    main()
