"""Are adequacy p-values uniform on right models, whatever the noise? Writes a page.

Interrupted, it goes on where it was: finished pads lie in build/validation.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

from adequacy_pads import KINDS, Bench
from adequacy_page import write
from blind.store import Store, code_digest
from coverage import progress
from page import Origin

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    options = _options()
    command = shlex.join([".venv/bin/python", "validation/adequacy.py", *sys.argv[1:]])
    origin = Origin.now(command, ROOT)
    folder = ROOT / "build" / "validation" / code_digest()
    results = {kind: _of_kind(kind, options, folder) for kind in options.kinds.split(",")}
    write(options.output, results, origin)
    print(options.output)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, default=300, help="empty pads of each kind of noise")
    parser.add_argument("--seed", type=int, default=1, help="decides all pads and their noise")
    parser.add_argument("--kinds", default=",".join(KINDS), help="kinds of noise, by letter")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "adequacy.md")
    return parser.parse_args()


def _of_kind(kind: str, options: argparse.Namespace, folder: Path) -> list[dict]:
    """Test the pads that are not on disk yet."""
    store = Store(folder / f"adequacy-{kind}-seed{options.seed}.jsonl")
    pads = options.pads if KINDS[kind].noisy else min(options.pads, KINDS[kind].pads)
    missing = [index for index in range(pads) if index not in store.cases]
    if missing:
        bench = Bench(kind, options.seed)
        with progress() as bar:
            for index in bar.track(missing, description=KINDS[kind].words):
                store.add(bench.run(index))
    return store.first(pads)


if __name__ == "__main__":
    main()
