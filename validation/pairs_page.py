"""The page docs/pairs.md, from finished pairs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import sqrt

import numpy as np
from calibration import HIGH, LOW
from page import Origin
from simulated_fits import MOST_STEPS
from simulated_pairs import NEAR

from qlvbayes.comparison.contrast import BY_CHANCE
from qlvbayes.comparison.joint import FALSE_ALARMS

MOST_ALARMS = 0.05

_HEAD = """# Validation: is a comparison of two pads right?

Pairs of pads were simulated by differential equations that share no code with the fit, with the
paper's protocol at six speeds, white and correlated noise (0.01 N in all) and {rows} rows a test.
Half of the pairs are equal; a quarter is near (each constant off by {near:.0%}, one sd), a quarter
drawn independently (far). All tests of each pad were fitted (at most {steps} steps of the sampler)
and the two compared with the default settings. All fits count, converged or not.

{results}

| | |
|---|---|
| command | `{command}` |
| date | {date} |
| commit | {commit} |
| machine | {machine} |

{pairs} pairs, {converged:.1%} of the fits converged; {fit:.0f} s for the fits of a pair and
{compare:.1f} s for its comparison (medians).
"""

_VERDICTS = """## The verdict on the pair

One joint test of all shared constants, at {level:.0%} false alarms.

| pairs | n | called different | called equal | cannot tell |
|---|---|---|---|---|
"""

_QUANTITIES = """
## Quantity by quantity

Unequal pairs are counted as: right direction, wrong direction, equal rightly, equal wrongly, cannot
tell.

| quantity | n | difference in 90 % interval | equal pairs: called different | unequal pairs |
|---|---|---|---|---|
"""

_READING = """
## How to read it

- *difference in 90 % interval*: share of the pairs whose central 90 % interval of first minus
  second holds the true difference, with its binomial standard error. Quantities of one pair are
  not independent of each other, so that the pooled share is no more certain than its error, which
  is taken over pairs, says.
- *equal pairs, called different*: one quantity at a time, by a probability of direction of 97.5 %;
  {chance:.0%} are expected where the two are equal. That is why the verdict on the pair is a joint
  test.
- *right direction* and *wrong*: called greater or less rightly or wrongly; *equal rightly*: called
  equal where the true ratio is within 1/1.1 to 1.1.
- The truth of what is read from a model (stiffness, forces, ...) was computed with the true
  constants by the package itself, whose readings are tested against closed forms.
"""


def pairs_page(pairs: Sequence[dict], origin: Origin) -> str:
    """Markdown."""
    head = _HEAD.format(
        rows=500, near=NEAR, steps=MOST_STEPS, results=_results(pairs), command=origin.command,
        date=origin.date, commit=origin.commit, machine=origin.machine, pairs=len(pairs),
        converged=float(np.mean([c for pair in pairs for c in pair["converged"]])),
        fit=float(np.median([pair["fit_seconds"] for pair in pairs])),
        compare=float(np.median([pair["compare_seconds"] for pair in pairs])),
    )  # fmt: skip
    verdicts = _VERDICTS.format(level=FALSE_ALARMS) + "\n".join(_verdict_rows(pairs)) + "\n"
    quantities = _QUANTITIES + "\n".join(_quantity_rows(pairs)) + "\n"
    return "\n".join([head, verdicts + quantities, _READING.format(chance=BY_CHANCE).lstrip()])


def _results(pairs: Sequence[dict]) -> str:
    """Report what is asked, and what was found."""
    share, error = pooled_coverage(pairs)
    equal = [pair["differ"] is True for pair in pairs if pair["kind"] == "equal"]
    alarms = _share(equal)
    inside = min(share - LOW, HIGH - share)
    names = _names(pairs)
    shares = {name: _share(_inside(pairs, name)) for name in names}
    outside = [f"{name} {x:.0%}" for name, x in shares.items() if not LOW <= x <= HIGH]
    lines = [
        f"- 90 % intervals of differences hold the truth in {share:.1%} ± {error:.1%} (asked: "
        f"{LOW:.0%} to {HIGH:.0%}): {_met(inside >= 0.0, inside, error)}.",
        f"- Equal pairs called different: {sum(equal)} of {len(equal)} (asked: at most "
        f"{MOST_ALARMS:.0%}): {_met(alarms <= MOST_ALARMS, alarms - MOST_ALARMS, _error(equal))}.",
        f"- One by one, {len(outside)} of {len(names)} quantities are outside {LOW:.0%} to "
        f"{HIGH:.0%}{': ' if outside else ''}{', '.join(outside)}; of one quantity the share is "
        f"known to ± {sqrt(0.9 * 0.1 / len(pairs)):.1%} only.",
    ]
    return "\n".join(lines)


def _met(good: bool, margin: float, error: float) -> str:
    """In bold, and whether so few pairs can tell."""
    word = "**met**" if good else "**not met**"
    near = abs(margin) < 2.0 * error
    return f"{word}, within two standard errors of the bound" if near else word


def pooled_coverage(pairs: Sequence[dict]) -> tuple[float, float]:
    """Share of all intervals that hold the truth, and its standard error over pairs."""
    shares = [_share(_holds(c) for c in pair["contrasts"].values()) for pair in pairs]
    return float(np.mean(shares)), float(np.std(shares) / sqrt(max(len(shares) - 1, 1)))


def _holds(c: dict) -> bool:
    return bool(c["low"] <= c["first"] - c["second"] <= c["high"])


def _names(pairs: Sequence[dict]) -> list[str]:
    return list(dict.fromkeys(name for pair in pairs for name in pair["contrasts"]))


def _inside(pairs: Sequence[dict], name: str) -> list[bool]:
    return [_holds(pair["contrasts"][name]) for pair in pairs if name in pair["contrasts"]]


def _share(found: Iterable[bool]) -> float:
    values = list(found)
    return float(np.mean(values)) if values else float("nan")


def _with_error(found: Sequence[bool]) -> str:
    return f"{_share(found):.1%} ± {_error(found):.1%}" if found else "-"


def _error(found: Sequence[bool]) -> float:
    """Binomial standard error of a share, shrunk off 0 and 1, where it would be none."""
    share = (sum(found) + 1.0) / (len(found) + 2.0)
    return sqrt(share * (1.0 - share) / max(len(found), 1))


def _verdict_rows(pairs: Sequence[dict]) -> Iterator[str]:
    for kind in dict.fromkeys(pair["kind"] for pair in pairs):
        found = [pair["differ"] for pair in pairs if pair["kind"] == kind]
        counts = [sum(x is value for x in found) for value in (True, False, None)]
        yield f"| {kind} | {len(found)} | {' | '.join(map(str, counts))} |"


def _quantity_rows(pairs: Sequence[dict]) -> Iterator[str]:
    for name in _names(pairs):
        equal, unequal = [], []
        for pair in pairs:
            if name in pair["contrasts"]:
                side = equal if pair["kind"] == "equal" else unequal
                side.append((pair["contrasts"][name], pair["region"]))
        alarms = [c["answer"] in ("greater", "less") for c, _ in equal]
        outcomes = [_outcome(c, region) for c, region in unequal]
        kinds = ("right", "wrong", "equal", "not equal", "open")
        counts = ", ".join(str(outcomes.count(kind)) for kind in kinds)
        inside = _inside(pairs, name)
        cells = [name, str(len(inside)), _with_error(inside), _with_error(alarms), counts]
        yield f"| {' | '.join(cells)} |"


def _outcome(c: dict, region: float) -> str:
    if c["answer"] == "equal":
        ratio = c["first"] / c["second"]
        return "equal" if 1.0 / (1.0 + region) <= ratio <= 1.0 + region else "not equal"
    if c["answer"] == "cannot tell":
        return "open"
    return "right" if (c["answer"] == "greater") == (c["first"] > c["second"]) else "wrong"
