"""Count what a decision by certainty would have said in registered blind studies.

`decisions.py RUN RUN ... -o docs/decisions.md` reads docs/wide_RUN.json. In place of the posterior
probabilities and the vetoes, an effect is named from a certainty on, and those of lower certainty
are a group, if they are at most three; certainties are those of studies left out (`certainty`).
Whether something unmodelled is left stays as the diagnosis said. The certainties come from answers
that vetoes had shaped: an effect that was refused has no gain on tests left out.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from certainty import Name, columns, given, learnt, left_out, names_of, seen_cases
from page import Origin

from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.evaluation.counting import COUNTS, LARGEST_GROUP, Case, Count, counted
from qlvbayes.io.files import write_whole

ROOT = Path(__file__).resolve().parents[1]

THRESHOLDS = (0.9, 0.8, 0.7, 0.6)
"""Certainties from which an effect is named."""
GROUPED = 0.5
"""Certainty from which an effect belongs to a group."""
CONFIRMED = DiagnosisSettings().confirmed
"""Least certainty of an effect that is named by its probability and passes the vetoes, in the rule
that asks for all three, which is that of `diagnose`."""

_HEAD = """# Validation: would certainty alone decide better?

`diagnose` names an effect by its posterior probability, unless a veto refuses it (tests left out
are predicted worse, its strength would have to vary, something unmodelled takes more of the error).
The other way is to name what has a [certainty](certainty.md) of some value or more, without vetoes;
effects with a certainty of {grouped:.0%} or more that are not named are a group. A third way takes
back the names of a certainty below {confirmed:.0%}: this is what `diagnose` does. Counted over the
{studies} studies of the runs behind those certainties in which what is hidden could be seen, each
with the certainties that the other studies give.

| | |
|---|---|
| command | `{command}` |
| date, commit | {date}, {commit} |
| machine | {machine} |

| | probability and vetoes | and certainty {confirmed:.0%} | {thresholds} |
|---|---|---|{rules}
{table}

Certainty keeps its word: of what it names from 90 % on next to nothing is wrong. But it is an
average over studies, and gives few effects that much. It names as often as probability and vetoes
do where it is also wrong as often, and is right in fewer studies. Therefore the verdict stays with
these, and the certainty is stated for each name. To ask for all three takes back a quarter of
the wrong names, and more studies are right.

The third way was registered with the run *support* before it, with a certainty of 60 % by the four
features of the answer alone that was learnt on the runs *bounds* and *beam*. There it took back 7
of 22 wrong names and left 122 of 212 studies right, as many as without it (single effects 21 of 33
instead of 24).
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


def confirmed(case: Case, certainty: Mapping[str, float]) -> Case:
    """Return a case in which names of a certainty below `CONFIRMED` are taken back.

    What they explained is then explained by nothing.

    Parameters
    ----------
    case
        A finished study.
    certainty
        Certainty of each effect that is likely.
    """
    named = [name for name in case["effects"] if name not in case["group"]]
    kept = [name for name in named if certainty.get(name, 1.0) >= CONFIRMED]
    if kept == named:
        return case
    verdict = "partly_explained" if kept else "unexplained"
    return case | {"verdict": verdict, "effects": kept, "group": []}


def certainties(
    learnt_on: Mapping[str, Sequence[Case]], counted_on: Mapping[str, Sequence[Case]]
) -> list[tuple[Case, dict[str, float]]]:
    """Return the cases of the runs to be counted, each with the certainty of its likely effects.

    Of runs that the certainty is learnt on, each study is left out once.
    """
    known = _names(learnt_on)
    values = dict(zip(map(_key, known), left_out(known).tolist(), strict=True))
    if new := [name for name in _names(counted_on) if _key(name) not in values]:
        weights = learnt(*columns(known))
        values |= zip(map(_key, new), given(weights, columns(new)[0]).tolist(), strict=True)
    of_study: dict[tuple[str, int], dict[str, float]] = {}
    for (run, study, effect), value in values.items():
        of_study.setdefault((run, study), {})[effect] = value
    return [
        (case, of_study.get((run, case["index"]), {}))
        for run, cases in counted_on.items()
        for case in cases
    ]


def _names(runs: Mapping[str, Sequence[Case]]) -> list[Name]:
    return [name for run, cases in runs.items() for name in names_of(run, cases)]


def _key(name: Name) -> tuple[str, int, str]:
    return name.run, name.study, name.effect


def page(seen: Sequence[tuple[Case, Mapping[str, float]]], command: str) -> str:
    """Return the page of some cases with the certainties of their likely effects."""
    ways = [[case for case, _ in seen], [confirmed(case, own) for case, own in seen]]
    ways += [[decided(case, own, least) for case, own in seen] for least in THRESHOLDS]
    table = [
        f"| {count.words} | {' | '.join(_cell(cases, count) for cases in ways)} |"
        for count in COUNTS
        if count.name != "failed"
    ]
    origin = Origin.now(command, ROOT)
    return _HEAD.format(
        grouped=GROUPED, confirmed=CONFIRMED, studies=len(seen), command=command, date=origin.date,
        commit=origin.commit, machine=origin.machine, table="\n".join(table),
        thresholds=" | ".join(f"certainty {least:.0%}" for least in THRESHOLDS),
        rules="---|" * len(THRESHOLDS),
    )  # fmt: skip


def _cell(cases: Sequence[Case], count: Count) -> str:
    rate = counted(cases, count)
    return f"{rate.hits} of {rate.n} ({rate.share:.0%})"


def main() -> int:
    """Count, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", help="registered runs that the certainty is learnt on")
    parser.add_argument(
        "--on", metavar="RUN", help="count this run instead, of which none is learnt"
    )
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "decisions.md")
    options = parser.parse_args()
    learnt_on = {run: seen_cases(run) for run in options.runs}
    counted_on = {options.on: seen_cases(options.on)} if options.on else learnt_on
    text = page(certainties(learnt_on, counted_on), shlex.join(sys.argv))
    write_whole(options.output, text.encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
