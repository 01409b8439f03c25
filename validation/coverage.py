"""Count how often the 90 % credible intervals hold the truth, on simulated pads; write a page.

Interrupted, it goes on where it was: finished fits lie in build/validation.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path

from blind.store import Store, code_digest
from page import Origin, write_page
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from simulated_fits import Setting, run

ROOT = Path(__file__).resolve().parents[1]
MAIN = (Setting("white", 500), Setting("correlated", 500))
SIDE = (Setting("correlated", None), Setting("correlated", 500, (20.0,)))


def main() -> None:
    options = _options()
    origin = Origin.now(f".venv/bin/python {shlex.join([_name(), *sys.argv[1:]])}", ROOT)
    plan = dict.fromkeys(MAIN, options.fits) | dict.fromkeys(SIDE, options.side_fits)
    plan = {setting: count for setting, count in plan.items() if count > 0}
    folder = ROOT / "build" / "validation" / code_digest()
    results = _all_fits(plan, options.seed, folder)
    write_page(options.output, results, origin)
    print(options.output)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fits", type=int, default=200, help="pads of each kind of noise")
    parser.add_argument(
        "--side-fits", type=int, default=60, help="pads with 1 kHz records, and with one test"
    )
    parser.add_argument("--seed", type=int, default=1, help="decides all pads and their noise")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "validation.md")
    return parser.parse_args()


def _name() -> str:
    return os.path.relpath(sys.argv[0], ROOT)


def _all_fits(plan: dict[Setting, int], seed: int, folder: Path) -> dict[Setting, list[dict]]:
    """Fit what is not on disk yet; the longest part of the run."""
    store = {setting: Store(folder / f"{setting.name}-seed{seed}.jsonl") for setting in plan}
    missing = [
        (setting, index)
        for setting, count in plan.items()
        for index in range(count)
        if index not in store[setting].cases
    ]
    with progress() as bar:
        task = bar.add_task("", total=len(missing))
        for setting, index in missing:
            bar.update(task, description=setting.describe())
            store[setting].add(run(setting, seed, index))
            bar.advance(task)
    return {setting: store[setting].first(count) for setting, count in plan.items()}


def progress() -> Progress:
    """A bar on stderr; silent where that is no terminal."""
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("fits,"),
        TimeElapsedColumn(),
        TextColumn("gone,"),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        disable=not console.is_terminal,
    )


if __name__ == "__main__":
    main()
