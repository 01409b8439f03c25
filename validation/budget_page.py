"""The page docs/budget.md."""

from __future__ import annotations

from collections.abc import Sequence

from blind.counting import Case
from page import Origin

MOST = 1.05
"""Times what least squares leaves."""
_WORST = 12  # cases that are listed
_FITS = ("plain", "answer", "fit")

_PAGE = """# Does what is fitted follow the readings?

{done} of {pads} pads. *Plain*, *answer*: of the diagnosis, by all tests; *fit*: of `qlvbayes fit`,
by those to be fitted: how many leave more than {most} times what least
squares of the same model leaves of the block means (root mean square), and the largest ratio.
*Rises*: answers along whose steps the error of the fit rises (weighted by the sds that a file
states of its readings), and the largest factor. *Lowers*:
effects named that lower the mean square on tests left out by more than its standard error, of those
that can be tested.

| | |
|---|---|
| command | `{command}` |
| date, commit | {date}, {commit} |
| machine | {machine} |

| kind | pads | plain | most | answer | most | fit | most | rises | most | lowers | failed |
|---|---|---|---|---|---|---|---|---|---|---|---|
{rows}

## The worst

| pad | verdict | named | plain, least squares (N) | answer, the same | fit, the same | steps (N) |
|---|---|---|---|---|---|---|
{worst}
"""


def budget_page(found: Sequence[Case], pads: int, origin: Origin) -> str:
    """Markdown."""
    kinds = list(dict.fromkeys(case["kind"] for case in found))
    rows = [_row(kind, [c for c in found if c["kind"] == kind]) for kind in kinds]
    rows.append(_row("all", found))
    sound = [case for case in found if "error" not in case]
    failed = [f"| {c['index']} | {c['error']} | - | - | - | - | - |" for c in found if "error" in c]
    worst = [_case(c) for c in sorted(sound, key=_badness, reverse=True) if _badness(c) > MOST]
    return _PAGE.format(
        done=len(found), pads=pads, most=MOST, rows="\n".join(rows),
        worst="\n".join([*failed, *worst[:_WORST]]), command=origin.command, date=origin.date,
        commit=origin.commit, machine=origin.machine,
    )  # fmt: skip


def _badness(case: Case) -> float:
    return float(max(*(case[key]["ratio"] for key in _FITS), *case["rises"], 1.0))


def _row(kind: str, every: Sequence[Case]) -> str:
    some = [case for case in every if "error" not in case]
    cells = [kind, str(len(every))]
    for key in _FITS:
        ratios = [case[key]["ratio"] for case in some]
        cells += [str(sum(ratio > MOST for ratio in ratios)), f"{max(ratios, default=1.0):.2f}"]
    rising = [max(case["rises"]) for case in some if case["rises"]]
    cells += [str(len(rising)), f"{max(rising, default=1.0):.2f}"]
    tested = [one for case in some for one in case["lowered"] if one["error_N2"] is not None]
    lowers = sum(one["fall_N2"] > one["error_N2"] for one in tested)
    cells += [f"{lowers} of {len(tested)}", str(len(every) - len(some))]
    return f"| {' | '.join(cells)} |"


def _case(case: Case) -> str:
    fits = [f"{case[k]['rms_N']:.4g}, {case[k]['least_N']:.4g}" for k in _FITS]
    steps = ", ".join(f"{step:.4g}" for step in case["steps"])
    named = " + ".join(case["effects"]) or "-"
    return f"| {' | '.join([case['index'], case['verdict'], named, *fits, steps])} |"
