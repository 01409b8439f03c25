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
import subprocess
import sys
import time
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

_WORKERS = 2
_LOOK_S = 5.0


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
    if options.part is None:
        take_up(options.output.with_suffix(".json"), promise, Kept(file, population.key))
    if options.part is not None:
        kept = Kept(file, population.key, options.part)
        _run_part(population, kept, range(options.part, promise.studies, _WORKERS))
        return
    if not options.finished and Kept(file, population.key).missing(promise.studies):
        _work(options.name, file, population, promise.studies)
    _publish(promise, Kept(file, population.key), options.output)


def _run_part(population: Population, kept: Kept, indices: range) -> None:
    """Run what is missing; a pad that the simulator cannot make is told and stays missing."""
    for index in indices:
        try:
            run_missing(partial(run_wide, population), kept, [index])
        except RuntimeError as error:
            if "the simulation stopped" not in str(error):
                raise
            print(f"study {index} is not made: {error}", file=sys.stderr, flush=True)


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
    parser.add_argument("--part", type=int, help=argparse.SUPPRESS)  # what a worker does
    return parser.parse_args()


def _work(name: str, file: Path, population: Population, studies: int) -> None:
    """Run what is missing in processes of their own; all end with this one."""
    command = [sys.executable, str(Path(__file__).resolve()), name]
    workers = [subprocess.Popen([*command, "--part", str(part)]) for part in range(_WORKERS)]
    try:
        with counting("studies") as tell:
            while any(worker.poll() is None for worker in workers):
                tell(studies - len(Kept(file, population.key).missing(studies)), studies)
                time.sleep(_LOOK_S)
    finally:
        for worker in workers:
            worker.terminate()
            worker.wait()
    if any(worker.returncode for worker in workers):
        sys.exit("a worker stopped; the same command goes on where it was")


def _publish(promise: Registration, kept: Kept, output: Path) -> None:
    report = WideReport(promise.seed, tuple(kept.first(promise.studies)))
    origin = Origin.now(f".venv/bin/python validation/wide.py {shlex.join(sys.argv[1:])}", ROOT)
    write_whole(output, wide_page(report, promise, origin).encode())
    write_json(output.with_suffix(".json"), report.as_dict())
    print(output)


if __name__ == "__main__":
    main()
