"""Blind studies: register a run, run it, keep its rates and its studies.

`--register NAME --studies N --seed S` writes validation/registered/NAME.json, to be committed;
`NAME` runs it, and keeps its line of validation/results/rates.csv and its studies. Interrupted, the
same command goes on where it was: finished studies lie in build/validation, whose files of several
machines may be put together. `--finished --commit HASH` keeps what that commit has run. With
`--again` the first studies of a seed are run by the present code without a registration, and only
their rates are kept.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial

from blind.case import run_case
from blind.counting import Case
from blind.population import KINDS, Population
from registration import Registration
from results import JOBS, Origin, finished, stored
from runs import Run, rates_of, write_cases, write_run


def main() -> None:
    options = _options()
    name, paper = options.name, options.paper
    if options.register:
        chosen = options.seed, options.studies, options.note, paper, options.kinds
        new = Registration.of_present(name, *chosen)
        print(f"{new.write()}: commit it before the run")
        return
    commit = options.commit or Origin.now().commit
    if options.again:
        population, size = Population(options.seed, paper), options.studies
        cases = _run(population, range(size), options.jobs)
        keep(name, population, size, cases, commit, options.note)
        return
    registered = Registration.read(name)
    if broken := registered.broken(options.finished):
        sys.exit(f"{', '.join(broken)} changed since '{name}' was registered: register anew")
    population = registered.population
    if options.finished:
        known = stored(population.key, registered.code).cases
        cases = [known[k] for k in registered.indices if k in known]
    else:
        cases = _run(population, registered.indices, options.jobs)
    keep(name, population, len(registered.indices), cases, commit, registered.note)
    write_cases(name, cases)


def _run(population: Population, indices: Sequence[int], jobs: int) -> list[Case]:
    return finished(population.key, partial(run_case, population), indices, jobs)


def keep(
    name: str, population: Population, size: int, cases: Sequence[Case], commit: str, note: str
) -> None:
    """Write the line of a run: its size, what of it could be seen, and its rates."""
    rig, seen = "paper" if population.paper else "wide", sum(case["seen"] for case in cases)
    date = Origin.today()
    rates = rates_of(cases)
    run = Run(name, rig, population.seed, size, len(cases), seen, date, commit, note, rates)
    write_run(run)
    print(f"{name}: {len(cases)} of {size} studies, {seen} could be seen")
    print(*(f"{key}: {rate.hits} of {rate.n}" for key, rate in rates.items()), sep="\n")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", help="of the run")
    parser.add_argument("--register", action="store_true", help="write the registration of a run")
    parser.add_argument("--again", action="store_true", help="run without a registration")
    parser.add_argument("--studies", type=int, default=240)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--paper", action="store_true", help="on the paper's rig")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, help="only studies that hide these")
    parser.add_argument("--note", default="", help="what is new, for the table of runs")
    parser.add_argument("--finished", action="store_true", help="keep what there is, run nothing")
    parser.add_argument("--commit", help="the commit that ran the studies, if not the present one")
    parser.add_argument("--jobs", type=int, default=JOBS, help="processes that run the studies")
    options = parser.parse_args()
    if options.finished and not options.commit:
        parser.error("--finished needs the --commit that ran the studies")
    return options


if __name__ == "__main__":
    main()
