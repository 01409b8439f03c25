"""Compare what a proposed test brings with what was expected and with other tests; write a page.

`--register NAME --rounds N --seed S` writes validation/registered/design_NAME.json, to be committed
before the run. `--run NAME` does what is missing, in an order that is fixed: interrupted, it goes
on where it was (finished cases lie in build/validation), `--most N` does so many of them. `--page
NAME` writes the page of what is there.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shlex
import sys
from pathlib import Path

from coverage import progress
from design_cases import cause_case, constants_case, outside_case
from design_page import page
from page import Origin
from registration import FOLDER

from qlvbayes.evaluation.store import Store, code_digest
from qlvbayes.io.files import write_whole
from qlvbayes.io.runtime import forget_compiled

ROOT = Path(__file__).resolve().parents[1]
RULES = ("design_counting.py", "design_cases.py")
CASES = {"constants": (constants_case, 0), "cause": (cause_case, 1000),
         "outside": (outside_case, 2000)}  # fmt: skip
ROUND = (*("constants", "constants", "cause") * 2, "constants", "constants", "outside")
"""So that a run that is cut off has some of each kind."""


def main() -> None:
    options = _options()
    if options.register:
        path = FOLDER / f"design_{options.register}.json"
        with path.open("x", encoding="utf-8") as file:
            file.write(json.dumps(_registration(options), indent=2) + "\n")
        print(f"wrote {path}; commit it before the run")
        return
    name = options.run or options.page
    registered = json.loads((FOLDER / f"design_{name}.json").read_text(encoding="utf-8"))
    store = Store(ROOT / "build" / "validation" / registered["code"] / f"design_{name}.jsonl")
    work = _work(registered["rounds"])
    if options.run:
        if changed := [key for key in ("code", "rules") if registered[key] != _digests()[key]]:
            raise SystemExit(f"{' and '.join(changed)} changed since the registration: register")
        missing = [one for one in work if one[2] not in store.cases][: options.most]
        with progress() as bar:
            for case, k, _ in bar.track(missing, description="pads"):
                store.add(case(k, registered["seed"]))
                forget_compiled()
        return
    command = shlex.join([".venv/bin/python", "validation/design.py", "--run", name])
    cases = [store.cases[key] for *_, key in work if key in store.cases]
    written = page(cases, len(work), name, registered, Origin.now(command, ROOT))
    write_whole(options.output, written.encode())
    print(f"wrote {options.output}")


def _work(rounds: int) -> list[tuple]:
    """Function, number and key of every case, in order."""
    seen = dict.fromkeys(CASES, 0)
    found = []
    for kind in ROUND * rounds:
        case, first = CASES[kind]
        found.append((case, seen[kind], first + seen[kind]))
        seen[kind] += 1
    return found


def _registration(options: argparse.Namespace) -> dict:
    return {"seed": options.seed, "rounds": options.rounds, **_digests(), "note": options.note}


def _digests() -> dict[str, str]:
    """Return digests of the package's code, and of the files with the cases and their rules."""
    texts = [(Path(__file__).parent / name).read_bytes() for name in RULES]
    return {"code": code_digest(), "rules": hashlib.sha256(b"".join(texts)).hexdigest()[:12]}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    for name in ("--register", "--run", "--page"):
        what.add_argument(name, metavar="NAME")
    parser.add_argument("--rounds", type=int, default=4, help=f"of {len(ROUND)} pads")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--note", default="")
    parser.add_argument("--most", type=int)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "design_proof.md")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
