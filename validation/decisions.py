"""What would a decision by certainty alone have said? Counts on registered blind studies.

`decisions.py RUN RUN ... -o docs/decisions.md` reads docs/wide_RUN.json. In place of the posterior
probabilities and the vetoes, an effect is named from a certainty on, and those of lower certainty
are a group, if they are at most three; certainties are those of studies left out (`certainty`).
Whether something unmodelled is left stays as the diagnosis said. The certainties come from answers
that vetoes had shaped: an effect that was refused has no gain on tests left out.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from certainty import left_out, names_of, runs_asked_for
from page import Origin

from qlvbayes.evaluation.counting import COUNTS, LARGEST_GROUP, Case, Count, counted
from qlvbayes.io.files import write_whole

ROOT = Path(__file__).resolve().parents[1]

THRESHOLDS = (0.9, 0.8, 0.7, 0.6)
"""Certainties from which an effect is named."""
GROUPED = 0.5
"""Certainty from which an effect belongs to a group."""

_HEAD = """# Validation: would certainty alone decide better?

`diagnose` names an effect by its posterior probability, unless a veto refuses it (tests left out
are predicted worse, its strength would have to vary, something unmodelled takes more of the error).
The other way is to name what has a [certainty](certainty.md) of some value or more, without vetoes;
effects with a certainty of {grouped:.0%} or more that are not named are a group. Counted over the
{studies} studies of the runs behind those certainties in which what is hidden could be seen. (These
certainties come from answers that vetoes had shaped; a run whose cases hold the support for every
likely effect is to show whether more can be had.)

| | |
|---|---|
| command | `{command}` |
| date, commit | {date}, {commit} |
| machine | {machine} |

| | probability and vetoes | {thresholds} |
|---|---|{rules}
{table}

Certainty keeps its word: of what it names from 90 % on next to nothing is wrong. But it is an
average over studies, and gives few effects that much. It names as often as probability and vetoes
do where it is also wrong as often, and is right in fewer studies. Therefore the verdict stays with
these, and the certainty stands beside each name.
"""


def decided(case: Case, certainty: Mapping[str, float], least: float) -> Case:
    """Return a case with the verdict that the certainties of its effects give.

    Parameters
    ----------
    case
        A finished study.
    certainty
        Certainty of each effect that is likely.
    least
        Certainty from which an effect is named.
    """
    ordered = sorted(certainty, key=lambda name: -certainty[name])
    named = [name for name in ordered if certainty[name] >= least]
    group = [name for name in ordered if GROUPED <= certainty[name] < least]
    unmodelled = case["verdict"] in ("unexplained", "partly_explained")
    if group and not unmodelled and len(group) <= LARGEST_GROUP:
        return case | {"verdict": "ambiguous", "effects": [*named, group[0]], "group": group}
    if named:
        verdict = "partly_explained" if unmodelled else "missing_effect"
    else:
        verdict = "unexplained" if unmodelled or group else "adequate"
    return case | {"verdict": verdict, "effects": named, "group": []}


def page(runs: Mapping[str, Sequence[Case]], command: str) -> str:
    """Return the page."""
    names = [name for run, cases in runs.items() for name in names_of(run, cases)]
    certainties: dict[tuple[str, int], dict[str, float]] = {}
    for name, value in zip(names, left_out(names).tolist(), strict=True):
        certainties.setdefault((name.run, name.study), {})[name.effect] = value
    seen = [
        (case, certainties.get((run, case["index"]), {}))
        for run, cases in runs.items()
        for case in cases
    ]
    columns = [[case for case, _ in seen]]
    columns += [[decided(case, own, least) for case, own in seen] for least in THRESHOLDS]
    table = [
        f"| {count.words} | {' | '.join(_cell(cases, count) for cases in columns)} |"
        for count in COUNTS
        if count.name != "failed"
    ]
    origin = Origin.now(command, ROOT)
    return _HEAD.format(
        grouped=GROUPED, studies=len(seen), command=command, date=origin.date,
        commit=origin.commit, machine=origin.machine, table="\n".join(table),
        thresholds=" | ".join(f"certainty {least:.0%}" for least in THRESHOLDS),
        rules="---|" * len(THRESHOLDS),
    )  # fmt: skip


def _cell(cases: Sequence[Case], count: Count) -> str:
    rate = counted(cases, count)
    return f"{rate.hits} of {rate.n} ({rate.share:.0%})"


def main() -> int:
    """Count, and write the page."""
    runs, output = runs_asked_for(__doc__, "decisions.md")
    write_whole(output, page(runs, shlex.join(sys.argv)).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
