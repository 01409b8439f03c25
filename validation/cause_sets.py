r"""Count how many causes a set must hold to contain what is there, on registered blind studies.

`cause_sets.py RUN RUN ... -o docs/cause_sets.md` reads docs/wide_RUN.json. A set of causes is
conformal by class (Vovk 2012, doi:10.1007/s10994-013-5355-6): it holds every cause whose certainty
is at least the quantile, at one minus the level, of the certainties that causes of its class had
where they were there. The classes are the candidate effects, *nothing* and *something else*. All
is learnt in other studies than those in which it is counted, in ten folds. Elastic and relaxation
laws are no causes here: their probabilities are reported by themselves.
"""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from certainty import FOLDS, columns, given, learnt, names_of, runs_asked_for
from numpy.typing import NDArray
from page import Origin

from qlvbayes.diagnosis.certainty import STRUCTURE
from qlvbayes.evaluation.counting import Case
from qlvbayes.io.files import write_whole

ROOT = Path(__file__).resolve().parents[1]
Array = NDArray[np.float64]

LEVELS = (0.8, 0.9, 0.95)
"""Shares of the studies whose set is to hold all that is there."""
NOTHING, ELSE = "nothing", "something else"
KINDS = {
    "none": "nothing hidden",
    "single": "one effect",
    "double": "two effects",
    "form": "another form of an effect",
    "outside": "something unlisted",
    "outside_beside": "something unlisted and an effect",
}
_UNLIKELY = 0.01  # certainty of an effect that is sure to be there, if it has no support: below all
_LEAST = 1e-6  # probability below which odds no longer count

_HEAD = """# Validation: how many causes must a set hold?

One answer to a question that tests leave open is a set of causes that holds what is there with a
stated probability. `validation/cause_sets.py` counts how large such sets are, over the {studies}
studies of the runs behind [certainty](certainty.md) in which what is hidden could be seen. A set
holds those of the candidate effects, *nothing* and *something else* that are at least as certain as
all but a share of the true causes of their class were (conformal prediction by class). Each study
is left out of what its set is made from. It counts as held if everything hidden in it is in its
set.

| | |
|---|---|
| command | `{command}` |
| date, commit | {date}, {commit} |
| machine | {machine} |

| level | causes in a set: median (middle half) | held |
|---|---|---|
{sizes}

By what is hidden, at a level of {middle:.0%}:

| hidden | studies | held | causes in a set (median) |
|---|---|---|---|
{kinds}

A set that holds what is there in 95 % of the studies is no answer: it names more than half of all
causes. Therefore `diagnose` states no such set. It reports the certainty of each likely effect,
from which a reader sees the same, and leaves the rest open.
"""


@dataclass(frozen=True)
class Scored:
    """A study's causes with their certainties, and the hidden ones with the class of each."""

    kind: str
    certainty: dict[str, float]
    hidden: tuple[tuple[str, float], ...]


def class_of(cause: str) -> str:
    """Return the class of a cause."""
    return cause if cause in (NOTHING, ELSE) else "effect"


def _study_features(case: Case, surest: float) -> Array:
    """Return what tells *nothing* and *something else*: odds, structure and error left."""
    last = case["stages"][-1]
    return np.array(
        [
            _odds(case["probabilities"].get("none", 0.0)),
            _odds(case.get("outside") or 0.0),
            _odds(surest),
            float(last["p_value"] < STRUCTURE),
            math.log(last["rmse"] / case["floor"]),
        ]
    )


def _odds(probability: float) -> float:
    clipped = min(max(probability, _LEAST), 1.0 - _LEAST)
    return math.log(clipped / (1.0 - clipped))


def scored(cases: Sequence[Case], fold: NDArray[np.intp]) -> list[Scored]:
    """Return every study's certainties, learnt from the other folds."""
    position = {case["index"]: k for k, case in enumerate(cases)}
    names = list(names_of("", cases))
    x, there = columns(names)
    sure = _left_out(x, there, fold[[position[name.study] for name in names]])
    known = [
        {name: _UNLIKELY * p for name, p in case["probabilities"].items() if name != "none"}
        for case in cases
    ]
    for name, value in zip(names, sure.tolist(), strict=True):
        known[position[name.study]][name.effect] = value
    of_study = np.array(
        [_study_features(c, max(v.values())) for c, v in zip(cases, known, strict=True)]
    )
    for cause, kinds in ((NOTHING, ("none",)), (ELSE, ("outside", "outside_beside"))):
        is_there = np.array([float(case["kind"] in kinds) for case in cases])
        for own, value in zip(known, _left_out(of_study, is_there, fold), strict=True):
            own[cause] = float(value)
    return [
        Scored(case["kind"], own, tuple(_hidden(case, own)))
        for case, own in zip(cases, known, strict=True)
    ]


def _left_out(x: Array, there: Array, fold: NDArray[np.intp]) -> Array:
    """Return certainties (n,) by logistic regressions on the other folds."""
    found = np.zeros(len(x))
    for k in range(FOLDS):
        found[fold == k] = given(learnt(x[fold != k], there[fold != k]), x[fold == k])
    return found


def _hidden(case: Case, certainty: dict[str, float]) -> list[tuple[str, float]]:
    """Return class and certainty of all that is hidden; a form counts by its likeliest kin."""
    hidden = []
    if case["kind"] == "none":
        hidden.append((NOTHING, certainty[NOTHING]))
    if case["kind"] in ("outside", "outside_beside"):
        hidden.append((ELSE, certainty[ELSE]))
    kin = [case["kin"][name] for name in case["names"] if case["kin"][name]]
    return hidden + [("effect", max(certainty.get(one, 0.0) for one in own)) for own in kin]


def sets(studies: Sequence[Scored], fold: NDArray[np.intp], level: float) -> list[tuple[int, bool]]:
    """Return the size of each study's set, and whether it holds all that is hidden."""
    found = []
    for study, own in zip(studies, fold, strict=True):
        others = [s for s, k in zip(studies, fold, strict=True) if k != own]
        least = {
            cause: float(
                np.quantile([v for s in others for c, v in s.hidden if c == cause], 1.0 - level)
            )
            for cause in ("effect", NOTHING, ELSE)
        }
        size = sum(value >= least[class_of(cause)] for cause, value in study.certainty.items())
        found.append((size, all(value >= least[cause] for cause, value in study.hidden)))
    return found


def page(cases: Sequence[Case], command: str) -> str:
    """Return the page."""
    fold = np.random.default_rng(0).permutation(len(cases)) % FOLDS
    studies = scored(cases, fold)
    counts = {level: sets(studies, fold, level) for level in LEVELS}
    sizes = []
    for level, some in counts.items():
        size, held = np.array(some).T
        low, middle, high = np.quantile(size, [0.25, 0.5, 0.75])
        sizes.append(
            f"| {level:.0%} | {middle:.0f} ({low:.0f} to {high:.0f}) | {held.mean():.0%} |"
        )
    kinds = [
        _row(words, [c for c, s in zip(counts[LEVELS[0]], studies, strict=True) if s.kind == kind])
        for kind, words in KINDS.items()
    ]
    origin = Origin.now(command, ROOT)
    return _HEAD.format(
        studies=len(cases),
        command=command,
        date=origin.date,
        commit=origin.commit,
        machine=origin.machine,
        sizes="\n".join(sizes),
        middle=LEVELS[0],
        kinds="\n".join(kinds),
    )


def _row(words: str, some: Sequence[tuple[int, bool]]) -> str:
    """Return the table's row of one kind of study."""
    size, held = np.array(some).T
    return f"| {words} | {len(some)} | {held.mean():.0%} | {np.median(size):.0f} |"


def main() -> int:
    """Count, and write the page."""
    runs, output = runs_asked_for(__doc__, "cause_sets.md")
    cases = [case for own in runs.values() for case in own]
    write_whole(output, page(cases, shlex.join(sys.argv)).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
