"""How often the diagnosis finds what is hidden in simulated pads; writes a page with a figure.

Interrupted, it goes on where it was: finished studies lie in build/validation.
"""

from __future__ import annotations

import argparse
import os
import shlex
from functools import partial
from pathlib import Path

from blind_page import blind_page
from page import Origin

from qlvbayes.cli.console import counting
from qlvbayes.evaluation.case import run_case
from qlvbayes.evaluation.keeping import Kept, kept_file, run_missing
from qlvbayes.evaluation.plan import NOISES, Plan
from qlvbayes.evaluation.report import Report
from qlvbayes.io.files import write_json, write_whole
from qlvbayes.parallel.engines import opened_engine
from qlvbayes.plots.benchmark import plot_benchmark
from qlvbayes.plots.files import save_figure

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    options = _options()
    plan = Plan(options.seed, options.noise)
    file = options.kept or kept_file(ROOT / "build" / "validation", plan.key)
    origin = Origin.now(_command(options), ROOT)
    kept = Kept(file, plan.key)
    if kept.missing(options.studies):
        with opened_engine(options.workers) as engine, counting("studies") as tell:
            run_missing(partial(run_case, plan), kept, range(options.studies), tell, engine)
    _write(Report.of(plan, kept.first(options.studies)), origin, options)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=400, help="pads")
    parser.add_argument("--seed", type=int, default=1, help="decides all pads and their noise")
    parser.add_argument("--noise", choices=NOISES, default=NOISES[0], help="simulated and fitted")
    parser.add_argument("--workers", type=int, default=2, help="processes that run them")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "blind_studies.md")
    parser.add_argument("--kept", type=Path, help="file of finished studies, whatever their code")
    parser.add_argument("--note", default="", help="a sentence for the page")
    return parser.parse_args()


def _command(options: argparse.Namespace) -> str:
    """What repeats the page: its note, which stands on it, and the workers decide nothing."""
    words = ["validation/blind.py", *_given(options, "studies", "seed", "noise")]
    for key, path in (("kept", options.kept), ("output", options.output)):
        words += [f"--{key}", os.path.relpath(path, ROOT)] if path else []
    return f".venv/bin/python {shlex.join(words)}"


def _given(options: argparse.Namespace, *keys: str) -> list[str]:
    """The options of these names, as on a command line."""
    return [word for key in keys for word in (f"--{key}", str(getattr(options, key)))]


def _write(report: Report, origin: Origin, options: argparse.Namespace) -> None:
    pictures = options.output.parent / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    picture = save_figure(plot_benchmark(report), pictures / options.output.stem)
    text = blind_page(report, origin, f"pictures/{picture.name}", options.note)
    write_whole(options.output, text.encode())
    write_json(options.output.with_suffix(".json"), report.as_dict())
    print(options.output)


if __name__ == "__main__":
    main()
