"""Blind studies that are kept: rates of every run, and the studies of those that still count.

`rates.csv` has one line a run: its name, seed, size, date, commit, and each count as hits/studies.
`NAME.csv.xz` has one line a study, with what the counts ask for and what certainty is learnt from;
cells of several values are JSON.
"""

from __future__ import annotations

import csv
import io
import json
import lzma
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from blind.constants import errors_of
from blind.counting import COUNTS, Case, Rate, counted
from results import RESULTS

from qlvbayes.diagnosis.certainty import LEAST
from qlvbayes.io.files import write_whole

_PLAIN = ("index", "kind", "verdict", "seen", "peak_N")
_NESTED = (
    "strata", "names", "kin", "effects", "group", "base", "rig", "seconds", "refused",
    "probabilities", "log_bayes_factors", "support", "guess", "errors",
)  # fmt: skip
_FACTS = ("run", "rig", "seed", "registered", "finished", "seen", "date", "commit", "new")


@dataclass(frozen=True)
class Run:
    """A run of blind studies.

    rig: of the population, ``paper`` or ``wide``; registered, finished: studies; seen: those whose
    hidden effects the tests could show; new: what its version of the program had first; rates: by
    the name of the count.
    """

    run: str
    rig: str
    seed: int
    registered: int
    finished: int
    seen: int
    date: str
    commit: str
    new: str
    rates: dict[str, Rate]


def rates_of(cases: Sequence[Case]) -> dict[str, Rate]:
    """Return every rate of some studies."""
    return {count.name: counted(cases, count) for count in COUNTS}


def read_runs() -> dict[str, Run]:
    """Return the runs of rates.csv by name, in the order of its lines."""
    with (RESULTS / "rates.csv").open(encoding="utf-8", newline="") as file:
        return {row["run"]: _run(row) for row in csv.DictReader(file)}


def _run(row: dict[str, str]) -> Run:
    numbers = {key: int(row[key]) for key in ("seed", "registered", "finished", "seen")}
    words = {key: row[key] for key in ("run", "rig", "date", "commit", "new")}
    rates = {count.name: Rate(*map(int, row[count.name].split("/"))) for count in COUNTS}
    return Run(**words, **numbers, rates=rates)  # type: ignore[arg-type]


def write_run(run: Run) -> None:
    """Write the line of a run, in place of an older one of its name."""
    known = read_runs() if (RESULTS / "rates.csv").exists() else {}
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*_FACTS, *(count.name for count in COUNTS)])
    for one in (known | {run.run: run}).values():
        rates = [f"{rate.hits}/{rate.n}" for rate in one.rates.values()]
        table.writerow([*(getattr(one, key) for key in _FACTS), *rates])
    write_whole(RESULTS / "rates.csv", text.getvalue().encode())


def read_cases(run: str) -> list[Case]:
    """Return the studies of a run that are kept."""
    with lzma.open(RESULTS / f"{run}.csv.xz", "rt", encoding="utf-8", newline="") as file:
        rows = [
            {key: json.loads(cell) for key, cell in row.items() if cell}
            for row in csv.DictReader(file)
        ]
    return rows


def write_cases(run: str, cases: Sequence[Case]) -> None:
    """Keep what counts of the studies of a run."""
    text = io.StringIO()
    table = csv.DictWriter(text, [*_PLAIN, *_NESTED], lineterminator="\n")
    table.writeheader()
    for case in cases:
        row = _kept(case)
        table.writerow(
            {key: json.dumps(value, separators=(",", ":")) for key, value in row.items()}
        )
    write_whole(RESULTS / f"{run}.csv.xz", lzma.compress(text.getvalue().encode(), preset=9))


def _kept(case: Case) -> dict[str, Any]:
    """Return a study without what nothing asks for, and the errors of its constants in sds."""
    likely = {n: p for n, p in case.get("probabilities", {}).items() if p >= LEAST}
    row = {key: case[key] for key in (*_PLAIN, *_NESTED) if key in case}
    if "guess" in case:
        row["guess"] = {name: p for name, p in case["guess"].items() if name in likely}
    return row | {
        "base": {"relaxation": case.get("base", {}).get("relaxation")},
        "rig": {"gap_mm": case["rig"]["gap_mm"]},
        "refused": [[name, ""] for name, _ in case.get("refused", ())],
        "probabilities": likely,
        "log_bayes_factors": {n: case["log_bayes_factors"][n] for n in likely},
        "support": {n: s for n, s in case.get("support", {}).items() if n in likely},
        "errors": errors_of(case),
    }
