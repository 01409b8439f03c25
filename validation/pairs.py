"""Count how often a comparison of two pads is right, on simulated pairs; write a page.

Interrupted, it goes on where it was: finished pairs lie in build/validation.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path

from blind.store import Store, code_digest
from coverage import progress
from page import Origin
from pairs_page import pairs_page
from simulated_pairs import run_pair

from qlvbayes.io.files import write_whole

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    options = _options()
    origin = Origin.now(f".venv/bin/python {shlex.join([_name(), *sys.argv[1:]])}", ROOT)
    folder = ROOT / "build" / "validation" / code_digest()
    store = Store(folder / f"pairs-seed{options.seed}.jsonl")
    missing = [index for index in range(options.pairs) if index not in store.cases]
    with progress() as bar:
        task = bar.add_task("pairs", total=len(missing))
        for index in missing:
            store.add(run_pair(options.seed, index))
            bar.advance(task)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    write_whole(options.output, pairs_page(store.first(options.pairs), origin).encode())
    print(options.output)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=40, help="half of them equal")
    parser.add_argument("--seed", type=int, default=1, help="decides all pads and their noise")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "pairs.md")
    return parser.parse_args()


def _name() -> str:
    return os.path.relpath(sys.argv[0], ROOT)


if __name__ == "__main__":
    main()
