"""The wide population: register a run, run it, publish it.

`--register NAME --studies N --seed S` writes validation/registered/NAME.json, to be committed;
`NAME` runs and publishes it. Interrupted, the same command goes on where it was; with `--finished`
it publishes what there is and runs nothing. Studies of the same code that were published where it
writes are taken up, so that a run may be spread over machines.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from functools import partial
from pathlib import Path

from page import Origin
from registration import ROOT, Registration
from wide_page import wide_page

from qlvbayes.cli.console import counting
from qlvbayes.evaluation.case import run_case
from qlvbayes.evaluation.population import Population
from qlvbayes.evaluation.report import Report
from qlvbayes.evaluation.store import Store, run_missing
from qlvbayes.io.files import write_json, write_whole
from qlvbayes.parallel.engines import opened_engine
from qlvbayes.parallel.faults import FailedError


def main() -> None:
    options = _options()
    if options.register:
        registered = Registration.of_present(
            options.name, options.seed, options.studies, options.note
        )
        print(f"{registered.write()}: commit it before the run")
        return
    registered = Registration.read(options.name)
    broken = registered.broken(options.finished)
    if broken:
        sys.exit(
            f"{', '.join(broken)} changed since '{options.name}' was registered: register anew"
        )
    population = registered.population
    file = ROOT / "build" / "validation" / f"{options.name}-{registered.code}.jsonl"
    store = Store(file, population.key)
    take_up(options.output.with_suffix(".json"), registered, store)
    if not options.finished and store.missing(registered.studies):
        _run(population, store, registered.studies, options.workers)
    _publish(registered, store, options.output)


def _run(population: Population, store: Store, studies: int, workers: int) -> None:
    """Run what is missing; a pad that the simulator cannot make is reported and stays missing."""
    try:
        with opened_engine(workers) as engine, counting("studies") as report:
            run_missing(partial(run_case, population), store, range(studies), report, engine)
    except FailedError as error:
        print(*error.lines, sep="\n", file=sys.stderr)
        if not all("the simulation stopped" in fault.text for fault in error.faults):
            sys.exit("a study failed otherwise than by its simulation; the others are store")


def take_up(published: Path, registered: Registration, store: Store) -> None:
    """Store the published studies of this run that are not stored already."""
    if not published.exists():
        return
    for case in json.loads(published.read_text(encoding="utf-8"))["cases"]:
        same = (case["plan"], case.get("code")) == (store.plan, registered.code)
        if same and case["index"] not in store.cases:
            store.add(case)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", help="of the registration")
    parser.add_argument("--register", action="store_true", help="write the registration of a run")
    parser.add_argument("--studies", type=int, default=240)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--note", default="", help="a sentence for the page")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "wide_studies.md")
    parser.add_argument("--finished", action="store_true", help="publish, run nothing")
    parser.add_argument("--workers", type=int, default=2, help="processes that run the studies")
    return parser.parse_args()


def _publish(registered: Registration, store: Store, output: Path) -> None:
    report = Report(registered.population, tuple(store.first(registered.studies)))
    origin = Origin.now(f".venv/bin/python validation/wide.py {shlex.join(sys.argv[1:])}", ROOT)
    write_whole(output, wide_page(report, registered, origin).encode())
    write_json(output.with_suffix(".json"), report.as_dict())
    print(output)


if __name__ == "__main__":
    main()
