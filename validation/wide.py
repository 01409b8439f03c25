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
from qlvbayes.evaluation.keeping import Kept, run_missing
from qlvbayes.evaluation.population import Population
from qlvbayes.evaluation.widecase import run_wide
from qlvbayes.evaluation.widereport import WideReport
from qlvbayes.io.files import write_json, write_whole
from qlvbayes.parallel.engines import opened_engine
from qlvbayes.parallel.faults import FailedError


def main() -> None:
    options = _options()
    if options.register:
        promise = Registration.of_present(options.name, options.seed, options.studies, options.note)
        print(f"{promise.write()}: commit it before the run")
        return
    promise = Registration.read(options.name)
    broken = promise.broken(options.finished)
    if broken:
        sys.exit(
            f"{', '.join(broken)} changed since '{options.name}' was registered: register anew"
        )
    population = Population(promise.seed)
    file = ROOT / "build" / "validation" / f"{options.name}-{promise.code}.jsonl"
    kept = Kept(file, population.key)
    take_up(options.output.with_suffix(".json"), promise, kept)
    if not options.finished and kept.missing(promise.studies):
        _run(population, kept, promise.studies, options.workers)
    _publish(promise, kept, options.output)


def _run(population: Population, kept: Kept, studies: int, workers: int) -> None:
    """Run what is missing; a pad that the simulator cannot make is told and stays missing."""
    try:
        with opened_engine(workers) as engine, counting("studies") as tell:
            run_missing(partial(run_wide, population), kept, range(studies), tell, engine)
    except FailedError as error:
        print(*error.lines, sep="\n", file=sys.stderr)
        if not all("the simulation stopped" in fault.text for fault in error.faults):
            sys.exit("a study failed otherwise than by its simulation; the others are kept")


def take_up(published: Path, promise: Registration, kept: Kept) -> None:
    """Keep what was published of this run, where it is not kept already."""
    if not published.exists():
        return
    for case in json.loads(published.read_text(encoding="utf-8"))["cases"]:
        same = (case["plan"], case.get("code")) == (kept.plan, promise.code)
        if same and case["index"] not in kept.cases:
            kept.add(case)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", help="of the registration")
    parser.add_argument("--register", action="store_true", help="promise a run")
    parser.add_argument("--studies", type=int, default=240)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--note", default="", help="a sentence for the page")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "wide_studies.md")
    parser.add_argument("--finished", action="store_true", help="publish, run nothing")
    parser.add_argument("--workers", type=int, default=2, help="processes that run the studies")
    return parser.parse_args()


def _publish(promise: Registration, kept: Kept, output: Path) -> None:
    report = WideReport(promise.seed, tuple(kept.first(promise.studies)))
    origin = Origin.now(f".venv/bin/python validation/wide.py {shlex.join(sys.argv[1:])}", ROOT)
    write_whole(output, wide_page(report, promise, origin).encode())
    write_json(output.with_suffix(".json"), report.as_dict())
    print(output)


if __name__ == "__main__":
    main()
