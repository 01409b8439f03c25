"""``qlvbayes benchmark``: how often the diagnosis finds what is hidden in simulated pads."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from qlvbayes.cli.console import counting, out
from qlvbayes.cli.groups import with_groups
from qlvbayes.cli.options import Seed, Style, WorkOptions, split_names
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import results_folder, write_json

if TYPE_CHECKING:
    from qlvbayes.evaluation.counting import Case
    from qlvbayes.evaluation.population import Population
    from qlvbayes.evaluation.report import Report


@with_groups
def benchmark(
    studies: Annotated[int, typer.Option(min=1, help="How many pads.")] = 40,
    seed: Seed = 0,
    effects: Annotated[
        str, typer.Option(help="Hide only these where one is hidden alone, as 'friction,inertia'.")
    ] = "",
    noise: Annotated[str, typer.Option(help="Kind of noise, correlated or white.")] = "correlated",
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")] = Path(
        "benchmark"
    ),
    population: Annotated[
        str, typer.Option(help="paper, or wide: other protocols, laws, noise and loggers too.")
    ] = "paper",
    *,
    work: WorkOptions,
    style: Style = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Diagnose simulated pads in which something known is hidden, or nothing, and score it.

    Equally many pads hide nothing, one effect of the list, two, another form of one, something
    outside the list, or that together with a listed effect. Finished pads are kept; the same
    command goes on where it stopped.

    The paper's population has the paper's rig and laws. With --population wide, protocols, laws,
    histories, kinds of noise and loggers vary too, every level of each equally often. Rates are of
    the pads whose hidden effects the tests can show, with one-sided 95 % bounds.

    Leaves OUT/benchmark.json, .png and .pdf. Of parts (--shard) the studies are kept; the same
    command without it then scores all of them.
    """
    if population not in ("paper", "wide"):
        raise InputError(f"no population {population!r}", remedy="use paper or wide")
    if population == "wide" and (effects or noise != "correlated"):
        raise InputError(
            "the wide population decides effects and noise itself",
            remedy="leave --effects and --noise out",
        )
    # imported here, so that the other commands do not wait for what only this one needs
    from qlvbayes.evaluation.lists import PRESENT
    from qlvbayes.evaluation.population import Population
    from qlvbayes.evaluation.report import Report
    from qlvbayes.plots.benchmark import plot_benchmark
    from qlvbayes.plots.files import save_figure

    hidden = tuple(split_names(effects)) if effects else PRESENT.listed
    simulated = Population(seed, paper=population == "paper", noise=noise, effects=hidden)
    folder = results_folder(output)
    cases = _run(simulated, folder, studies, work)
    if cases is None:
        return
    report = Report(simulated, tuple(cases))
    write_json(folder / "benchmark.json", report.as_dict())
    picture = save_figure(plot_benchmark(report), folder / "benchmark")
    if as_json:
        print(json.dumps(report.as_dict(), allow_nan=False))
        return
    out.print(rates_table(report), constants_table(report))
    out.print(f"figure: {picture}")


def _run(
    population: Population, folder: Path, studies: int, work: WorkOptions
) -> list[Case] | None:
    """Run what is missing; return all studies, or None after one part of many."""
    from qlvbayes.evaluation.case import run_case
    from qlvbayes.evaluation.store import Store, run_missing, store_path

    shard = work.part
    part = shard.index if shard.count > 1 else None
    store = Store(store_path(folder / "studies", population.key), population.key, part)
    indices = shard.part(range(studies))
    with work.engine() as engine, counting("studies") as report:
        run_missing(partial(run_case, population), store, indices, report, engine)
    if part is None:
        return store.first(studies)
    out.print(f"{len(indices)} studies in {folder}; the same command without --shard scores all")
    return None


def rates_table(report: Report) -> Table:
    """Return every rate over the studies whose effect is visible, with its one-sided 95 % bound."""
    from qlvbayes.evaluation.counting import COUNTS, bound

    name = f"the {'paper' if report.population.paper else 'wide'} population"
    title = f"{len(report.cases)} blind studies of {name}, seed {report.population.seed}"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("hidden: verdict")
    for column in ("share", "95 % bound", "n"):
        table.add_column(column, justify="right")
    for count in COUNTS:
        rate = report.rate(count)
        if rate.share is not None:
            sign = ">" if count.good else "<"
            limit = f"{sign} {100 * bound(rate, count.good):.1f} %"
            table.add_row(count.words, f"{100 * rate.share:.1f} %", limit, str(rate.n))
    table.add_section()
    for kind, medians in report.heldout().items():
        if medians["plain"] is not None:
            words = f"left-out tests, error/noise, median ({kind}): first model, then last one"
            values = f"{medians['plain']:.2f}, {medians['final']:.2f}"
            table.add_row(words, values, "", str(medians["n"]))
    if report.seconds is not None:
        table.add_row("seconds for a study, median", f"{report.seconds:.1f}")
    return table


def constants_table(report: Report) -> Table:
    """Return the coverage of the pad's constants without the effect and with it."""
    from qlvbayes.evaluation.constants import coverage

    title = "one effect that could be seen: pads whose 90 % interval holds the true constant"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("constant")
    for name in ("first model", "last model", "n", "|error|/sd, first", "last"):
        table.add_column(name, justify="right")
    for c in coverage(report.cases).values():
        table.add_row(
            c.name, str(c.before), str(c.after), str(c.after.n),
            f"{c.error_before:.1f}", f"{c.error_after:.1f}",
        )  # fmt: skip
    return table
