"""``qlvbayes benchmark --population wide``: rates over the wide population, with their bounds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from qlvbayes.cli.console import out
from qlvbayes.io.files import write_json

if TYPE_CHECKING:
    from qlvbayes.evaluation.run import Tell
    from qlvbayes.evaluation.widereport import WideReport


def run_wide_benchmark(studies: int, seed: int, folder: Path, as_json: bool, tell: Tell) -> None:
    """Run what is missing, write OUT/benchmark.json, show the rates."""
    from qlvbayes.evaluation.keeping import Kept, code_digest
    from qlvbayes.evaluation.population import Population
    from qlvbayes.evaluation.widereport import WideReport
    from qlvbayes.evaluation.widerun import run_population

    population = Population(seed)
    path = folder / "studies" / f"{population.key}-{code_digest()}.jsonl"
    kept = Kept(path, population.key)
    run_population(population, kept, range(studies), tell)
    report = WideReport(seed, tuple(kept.first(studies)))
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
