"""How often the diagnosis finds what is hidden in simulated pads; writes a page with a figure.

Interrupted, it goes on where it was: finished studies lie in build/validation.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
import time
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
from qlvbayes.plots.benchmark import plot_benchmark
from qlvbayes.plots.files import save_figure

ROOT = Path(__file__).resolve().parents[1]
MOST_WORKERS = 2
_LOOK_S = 5.0


def main() -> None:
    options = _options()
    plan = Plan(options.seed, options.noise)
    file = options.kept or kept_file(ROOT / "build" / "validation", plan.key)
    if options.part is not None:
        places = range(options.part, options.studies, options.workers)
        run_missing(partial(run_case, plan), Kept(file, plan.key, options.part), places)
        return
    origin = Origin.now(_command(options), ROOT)
    if Kept(file, plan.key).missing(options.studies):
        _work(options, file, plan)
    _write(Report.of(plan, Kept(file, plan.key).first(options.studies)), origin, options)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=400, help="pads")
    parser.add_argument("--seed", type=int, default=1, help="decides all pads and their noise")
    parser.add_argument("--noise", choices=NOISES, default=NOISES[0], help="simulated and fitted")
    parser.add_argument(
        "--workers", type=int, default=MOST_WORKERS, choices=range(1, MOST_WORKERS + 1)
    )
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "blind_studies.md")
    parser.add_argument("--kept", type=Path, help="file of finished studies, whatever their code")
    parser.add_argument("--note", default="", help="a sentence for the page")
    parser.add_argument("--part", type=int, help=argparse.SUPPRESS)  # what a worker does
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


def _work(options: argparse.Namespace, file: Path, plan: Plan) -> None:
    """Run what is missing in processes of their own; all end with this one."""
    command = [sys.executable, str(Path(__file__).resolve()), "--kept", str(file)]
    command += _given(options, "studies", "seed", "noise", "workers")
    workers = [subprocess.Popen([*command, "--part", str(part)]) for part in range(options.workers)]
    try:
        with counting("studies") as tell:
            while any(worker.poll() is None for worker in workers):
                done = options.studies - len(Kept(file, plan.key).missing(options.studies))
                tell(done, options.studies)
                time.sleep(_LOOK_S)
    finally:
        for worker in workers:
            worker.terminate()
            worker.wait()
    if any(worker.returncode for worker in workers):
        sys.exit("a worker stopped; the same command goes on where it was")


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
