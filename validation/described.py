"""Blind studies of described laws: simulate and diagnose pads, and predict fresh tests of them.

`described.py --studies N --seed S --jobs J -o OUT` writes OUT/described.jsonl, a study a line, from
which an interrupted run goes on, and OUT/described.json with the counts. `described_pads` says what
is hidden. Where a law is described, fresh tests of the same pad are predicted by the hypothesis
without it and with it; where none is, both are alike. `--keep` keeps the table of what is finished.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from blind.case import FAILED, THRESHOLDS, verdict_of
from blind.counting import Case, Rate, bound
from blind.store import Store, run_missing
from described_pads import Study, make_study
from lifelike import commit
from results import Origin, Table, commits_of, share

from qlvbayes.cli.console import counting
from qlvbayes.diagnosis.decision import Verdict
from qlvbayes.diagnosis.description.describe import Described, Fitted
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.io.files import write_json
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.parallel.engines import opened_engine

_HALF = 0.5  # of the error on fresh tests
_WORSE = 1.02  # times that error, from which a law does harm


def run_case(seed: int, commit: str, index: int) -> Case:
    """Simulate one study and diagnose it; an error of the diagnosis is its verdict."""
    begun = time.process_time()
    study = make_study(seed, index)
    case: Case = {
        "plan": plan_key(seed), "index": index, "seed": seed, "commit": commit,
        "scene": study.scene, "hidden": study.hidden, "programme": study.plan.kind,
        "share_of_peak": study.share, "noise_N": study.noise,
        "parameters": study.effect.parameters if study.effect else {},
    }  # fmt: skip
    between = time.process_time()
    try:
        found = diagnose(prepare(study.pad), Choices(), settings=THRESHOLDS)
        case |= verdict_of(found.result) | _described(study, found.work.law)
    except Exception as error:  # one bad study must not end a run
        text = f"{type(error).__name__}: {error}"
        case |= {"verdict": FAILED, "error": text, "effects": [], "group": [], "law": None}
    case["seconds"] = {"simulate": between - begun, "diagnose": time.process_time() - between}
    return case


def plan_key(seed: int) -> str:
    """Return the name of the studies of one seed."""
    return f"described-seed{seed}"


def _described(study: Study, law: Described) -> Case:
    """Return the law of a study, and the errors on its fresh tests without it and with it."""
    record = law.record
    found: Case = {"law": record.effect if record else None}
    if record:
        found |= {
            "formula": record.formula, "heldout": [record.heldout_before, record.heldout_after],
            "standard_errors": record.sds,
        }  # fmt: skip
    errors = [fresh_error(study, one) for one in (law.before, law.after) if one]
    return found | {"fresh": errors}


def fresh_error(study: Study, fitted: Fitted) -> float:
    """Return the root mean square error (N) on the fresh tests."""
    whole = prepare(replace(study.pad, tests=(*study.pad.tests, *study.fresh)))
    names = {test.name for test in study.fresh}
    record = whole.record([trial for trial in whole.trials if trial.name in names])
    real = np.asarray(record.blocks.real)
    left = np.asarray(record.blocks.force) - fitted.forces(record)
    return float(np.sqrt(np.mean(left[real] ** 2)))


def describes(case: Case) -> bool:
    """Return whether a law is described."""
    return case["law"] is not None


def _halves(case: Case) -> bool:
    return describes(case) and case["fresh"][1] <= _HALF * case["fresh"][0]


def _harms(case: Case) -> bool:
    return describes(case) and case["fresh"][1] > _WORSE * case["fresh"][0]


def _is_open(case: Case) -> bool:
    """Return whether the verdict says that something unlisted is there."""
    return case["verdict"] in (Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED)


COUNTS: tuple[tuple[str, tuple[str, ...], Callable[[Case], bool], bool], ...] = (
    ("outsider: the verdict says that something unlisted is there", ("outsider",), _is_open, True),
    ("outsider: a law is described", ("outsider",), describes, True),
    ("outsider: the law halves the error on fresh tests", ("outsider",), _halves, True),
    ("outsider: the law makes fresh tests worse", ("outsider",), _harms, False),
    ("nothing hidden: a law is described", ("none",), describes, False),
    ("listed effect: a law is described", ("listed",), describes, False),
)
"""Questions, the scenes that they are asked of, and whether more is better."""


def rates(cases: Sequence[Case]) -> dict[str, tuple[Rate, float | None]]:
    """Return each rate with its one-sided 95 % bound."""
    found = {}
    for words, scenes, hit, good in COUNTS:
        rate = Rate.from_cases([case for case in cases if case["scene"] in scenes], hit)
        found[words] = rate, bound(rate, good) if rate.n else None
    return found


def keep(cases: Sequence[Case], count: int, seed: int) -> None:
    """Write validation/results/described.json."""
    rows = [
        [words, share(rate.hits, rate.n), "-" if limit is None else f"{limit:.0%}"]
        for words, (rate, limit) in rates(cases).items()
    ]
    seconds = sum(case["seconds"]["diagnose"] for case in cases) / max(len(cases), 1)
    note = f"{len(cases)} of {count} registered studies were finished; {seconds:.0f} s of CPU each."
    machine = f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()}"
    command = f"python validation/described.py --studies {count} --seed {seed}"
    origin = Origin(command, Origin.today(), commits_of(cases), machine)
    Table(origin, len(cases), ["hidden: law", "studies", "bound"], rows, [note]).write("described")


def main() -> int:
    """Run, or keep the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=140)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes that run the studies")
    parser.add_argument("--keep", action="store_true", help="keep the table of what is finished")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    store = Store(options.output / "described.jsonl", plan_key(options.seed))
    if options.keep:
        finished = min(store.missing(options.studies), default=options.studies)
        keep(store.first(finished), options.studies, options.seed)
        return 0
    with opened_engine(options.jobs) as engine, counting("studies") as done:
        case = partial(run_case, options.seed, commit())
        run_missing(case, store, range(options.studies), done, engine)
    found = rates(store.first(options.studies))
    table = {
        words: {"hits": rate.hits, "n": rate.n, "bound95": limit}
        for words, (rate, limit) in found.items()
    }
    write_json(options.output / "described.json", table)
    for words, (rate, limit) in found.items():
        print(f"{words}: {rate.hits} of {rate.n}, 95 % bound {limit:.0%}" if limit else words)
    return 0


if __name__ == "__main__":
    sys.exit(main())
