"""``qlvbayes benchmark``: how often the diagnosis finds what is hidden in simulated pads."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from qlvbayes.cli.console import counting, out
from qlvbayes.cli.options import Seed, Style, WorkOptions, split_names, with_groups
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import results_folder, write_json

if TYPE_CHECKING:
    from qlvbayes.evaluation.rate import Case
    from qlvbayes.evaluation.report import Report
    from qlvbayes.evaluation.widereport import WideReport


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

    Of 20 pads, 8 hide one effect of the list, 3 two, 3 another form of one, 2 something outside the
    list, and 4 nothing. Finished pads are kept; the same command goes on where it stopped.

    With --population wide, equally many hide nothing, one, two, another form, something outside
    the list, or that beside a listed effect, each over every protocol, law, history, kind of noise
    and logger; rates come with one-sided 95 % bounds.

    Leaves OUT/benchmark.json and, of the paper's population, OUT/benchmark.png and .pdf. Of parts
    (--shard) the studies are kept; the same command without it then scores all of them.
    """
    if population not in ("paper", "wide"):
        raise InputError(f"no population {population!r}", remedy="use paper or wide")
    if population == "wide":
        if effects or noise != "correlated":
            raise InputError(
                "the wide population decides effects and noise itself",
                remedy="leave --effects and --noise out",
            )
        run_wide_benchmark(studies, seed, results_folder(output), as_json, work)
        return
    # here, so that the other commands do not wait for what only this one needs
    from qlvbayes.evaluation.case import run_case
    from qlvbayes.evaluation.plan import Plan
    from qlvbayes.evaluation.report import Report

    names = tuple(split_names(effects))
    plan = Plan(seed, noise, names) if names else Plan(seed, noise)
    folder = results_folder(output)
    cases = _run(partial(run_case, plan), plan.key, folder, studies, work)
    if cases is None:
        return
    report = Report.of(plan, cases)
    write_json(folder / "benchmark.json", report.as_dict())
    picture = _figure(report, folder)
    if as_json:
        print(json.dumps(report.as_dict(), allow_nan=False))
        return
    out.print(rates_table(report), constants_table(report))
    out.print(f"figure: {picture}")


def _run(
    study: Callable[[int], Case], key: str, folder: Path, studies: int, work: WorkOptions
) -> list[Case] | None:
    """Run what is missing; all studies, or None after one part of many."""
    from qlvbayes.evaluation.keeping import Kept, kept_file, run_missing

    part = work.part
    own = part.place if part.count > 1 else None
    kept = Kept(kept_file(folder / "studies", key), key, own)
    places = part.part(range(studies))
    with work.engine() as engine, counting("studies") as tell:
        run_missing(study, kept, places, tell, engine)
    if own is None:
        return kept.first(studies)
    out.print(f"{len(places)} studies in {folder}; the same command without --shard scores all")
    return None


def rates_table(report: Report) -> Table:
    """Every rate, over all studies and over those that could be seen."""
    from qlvbayes.evaluation.scores import QUESTIONS

    title = f"{len(report.cases)} blind studies, seed {report.plan.seed}, {report.plan.noise} noise"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("hidden: verdict")
    for name in ("could be seen", "n", "all", "n"):
        table.add_column(name, justify="right")
    for question in QUESTIONS:
        found = report.rates[question.name]
        if found["all"].n:
            seen, every = found["seen"], found["all"]
            table.add_row(question.words, str(seen), str(seen.n), str(every), str(every.n))
    _add_medians(table, report)
    return table


def _add_medians(table: Table, report: Report) -> None:
    table.add_section()
    for kind, found in report.heldout.items():
        if found["plain"] is not None:
            words = f"left-out tests, error/noise, median ({kind}): plain model, then last one"
            table.add_row(words, f"{found['plain']:.2f}, {found['final']:.2f}", str(found["n"]))
    every, seen = report.reliability, report.reliability_seen
    if every.error is not None:
        table.add_row(
            "probability of the first-ranked: expected calibration error",
            "-" if seen.error is None else f"{seen.error:.3f}", str(seen.n),
            f"{every.error:.3f}", str(every.n),
        )  # fmt: skip
    if report.seconds is not None:
        table.add_row("seconds for a diagnosis, median", "", "", f"{report.seconds:.1f}", "")


def constants_table(report: Report) -> Table:
    """Coverage of the pad's constants without the effect and with it."""
    title = "one effect that could be seen: pads whose 90 % interval holds the true constant"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("constant")
    for name in ("plain model", "last model", "n", "|error|/sd, plain", "last"):
        table.add_column(name, justify="right")
    for c in report.constants.values():
        table.add_row(
            c.name, str(c.before), str(c.after), str(c.after.n),
            f"{c.off_before:.1f}", f"{c.off_after:.1f}",
        )  # fmt: skip
    return table


def _figure(report: Report, folder: Path) -> Path:
    from qlvbayes.plots.benchmark import plot_benchmark
    from qlvbayes.plots.files import save_figure

    return save_figure(plot_benchmark(report), folder / "benchmark")


def run_wide_benchmark(
    studies: int, seed: int, folder: Path, as_json: bool, work: WorkOptions
) -> None:
    """Run what is missing, write OUT/benchmark.json, show the rates."""
    from qlvbayes.evaluation.population import Population
    from qlvbayes.evaluation.widecase import run_wide
    from qlvbayes.evaluation.widereport import WideReport

    population = Population(seed)
    cases = _run(partial(run_wide, population), population.key, folder, studies, work)
    if cases is None:
        return
    report = WideReport(seed, tuple(cases))
    write_json(folder / "benchmark.json", report.as_dict())
    if as_json:
        print(json.dumps(report.as_dict(), allow_nan=False))
        return
    out.print(wide_table(report))


def wide_table(report: WideReport) -> Table:
    """Every rate over the studies that could be seen, with its one-sided 95 % bound."""
    from qlvbayes.evaluation.counting import COUNTS, bound

    title = f"{len(report.cases)} studies of the wide population, seed {report.seed}"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("hidden: verdict")
    for name in ("share", "95 % bound", "n"):
        table.add_column(name, justify="right")
    for count in COUNTS:
        rate = report.rate(count)
        if rate.share is not None:
            sign = ">" if count.good else "<"
            limit = f"{sign} {100 * bound(rate, count.good):.1f} %"
            table.add_row(count.words, f"{100 * rate.share:.1f} %", limit, str(rate.n))
    return table
