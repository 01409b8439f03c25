"""The page on why verdicts of a run were wrong."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from textwrap import fill

import causes
from causes import CAUSES, RIGHT
from page import Origin

from qlvbayes.evaluation.counting import Case
from qlvbayes.evaluation.population import KINDS

_HEAD = """# Why verdicts of '{run}' were wrong

Of the studies in [its page](wide_{run}.md) that could be seen, {wrong} verdicts were wrong. {done}
of them were simulated and diagnosed again, and what is really hidden was fitted from its true
constants, from others with the relaxation drawn anew and from points near by, ten starts in all.

| | |
|---|---|
| command | `{command}` |
| date, commit | {date}, {commit} |
| machine | {machine} |

{earlier}{meaning}
"""
_WORDS = {RIGHT: "right now"}


def why_page(
    run: str, found: Sequence[Case], wrong: int, origin: Origin, before: dict | None
) -> str:
    """Markdown; before: what an earlier run of the same left next to its page."""
    head = _HEAD.format(
        run=run, wrong=wrong, done=len(found), command=origin.command, date=origin.date,
        commit=origin.commit, machine=origin.machine, earlier=_earlier(found), meaning=_meaning(),
    )  # fmt: skip
    return "\n".join([head, _counts(found, before), _kinds(found), _studies(found)])


def _earlier(found: Sequence[Case]) -> str:
    """State which studies other code than the present one explained."""
    commits = Counter(case["commit"] for case in found if "commit" in case)
    return "".join(
        f"{n} of them by the code of commit {commit}.\n\n" for commit, n in commits.items()
    )


def _meaning() -> str:
    """The definition of the causes, as it stands in the code."""
    text = str(causes.__doc__).partition("\n\n")[2].replace("``", "`")
    return text.strip()


def _counts(found: Sequence[Case], before: dict | None) -> str:
    now = {case["index"]: case["cause"] for case in found}
    lines = ["## By cause\n", *_table({"studies": now})]
    if before is not None:
        earlier = {case["index"]: case["cause"] for case in before["cases"]}
        both = now.keys() & earlier.keys()
        columns = {f"before ({before['commit']})": earlier, "now": now}
        lines.append(f"\nOf the {len(both)} studies that an earlier commit explained too:\n")
        lines += _table({head: {k: own[k] for k in both} for head, own in columns.items()})
    return "\n".join([*lines, ""])


def _table(columns: dict[str, dict[int, str]]) -> list[str]:
    """Count the studies that have each cause, by column."""
    lines = [f"| cause | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    counts = [Counter(own.values()) for own in columns.values()]
    for cause in (RIGHT, *CAUSES):
        if any(count[cause] for count in counts):
            numbers = " | ".join(str(count[cause]) for count in counts)
            lines.append(f"| {_WORDS.get(cause, cause)} | {numbers} |")
    return lines


def _kinds(found: Sequence[Case]) -> str:
    known = [cause for cause in (RIGHT, *CAUSES) if any(c["cause"] == cause for c in found)]
    lines = [
        "## By what is hidden\n",
        f"| hidden | {' | '.join(known)} |",
        "|---" * (len(known) + 1) + "|",
    ]
    for kind in KINDS:
        count = Counter(case["cause"] for case in found if case["kind"] == kind)
        lines.append(f"| {kind} | {' | '.join(str(count[cause]) for cause in known)} |")
    inexact = sum(not case.get("exact", True) for case in found)
    note = f"Of {inexact} of them the package has the law of what is hidden only nearly (*)."
    return "\n".join([*lines, "", note, ""])


_READING = """*truth*, *seen*: log posterior of the likeliest
true hypothesis, as reached from its constants and as the search left it, less the answer's; *chi2*:
of a block mean under the noise floor alone, of the truth's fit, of the answer, and of the true
constants by what the noise makes of it and by what the model's force is away from the simulator's;
*half*: how many block means, of all, carry half of the
difference of log likelihoods (or, where the answer is the truth, of what is beyond noise), and the
largest; with a dash the readings do not speak against it, what it costs by its priors does."""


def _studies(found: Sequence[Case]) -> str:
    lines = ["## Study by study\n", fill(" ".join(_READING.split()), 100) + "\n"]
    lines += ["| study | hidden | verdict | answer | cause | truth | seen | chi2 | half |"]
    lines += ["|---|---|---|---|---|---|---|---|---|"]
    for case in sorted(found, key=lambda c: ((RIGHT, *CAUSES).index(c["cause"]), c["index"])):
        hidden = " + ".join(case["names"]) or "-"
        star = "" if case.get("exact", True) else " (*)"
        cells = [
            str(case["index"]),
            hidden + star,
            case.get("verdict", "-"),
            case.get("answer", "-"),
        ]
        lines.append(f"| {' | '.join([*cells, case['cause'], *_figures(case)])} |")
    return "\n".join([*lines, ""])


def _figures(case: Case) -> list[str]:
    """Truth, seen, chi^2 and readings."""
    if case.get("log_truth") is None:
        return ["-", "-", "-", case.get("error", "-").replace("|", "/")]
    truth = f"{case['log_truth'] - case['log_answer']:+.1f}"
    seen = "-" if case["log_seen"] is None else f"{case['log_seen'] - case['log_answer']:+.1f}"
    chi2 = [case["fit"]["chi2"], case["said"]["chi2"]]
    if at := case["true_constants"]:
        chi2 += [at["chi2_noise"], at["chi2_model"]]
    shown, where = case["readings"], "-"
    if shown["half"]:
        one = shown["largest"][0]
        where = (
            f"{shown['half']} of {shown['of']}: {one['test']} {one['phase']}, "
            f"{one['time_s']:.4g} s, "
            f"{one['nats']:.1f} of {shown['nats']:.1f} nats, {one['residual_N']:+.3g} N"
        )
    return [truth, seen, ", ".join(f"{value:.3g}" for value in chi2), where]
