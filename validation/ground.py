"""Compare what was hidden with what is answered, away from the paper's rig.

`--make FOLDER` simulates the pads; `--run FOLDER --package TREE -o FILE.json` lets the `qlvbayes`
of a source tree answer on all of them; `--page BEFORE.json AFTER.json` prints both as a table.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from ground_cases import make

_LIMIT_S = 3600.0
_MAIN = "from qlvbayes.cli.main import run; run()"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--make", type=Path, metavar="FOLDER")
    parser.add_argument("--run", type=Path, metavar="FOLDER")
    parser.add_argument("--package", type=Path, help="source tree that answers")
    parser.add_argument("--only", default="", help="pads whose name holds this")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--page", type=Path, nargs=2, metavar=("BEFORE", "AFTER"))
    options = parser.parse_args()
    if options.make:
        make(options.make)
    if options.run:
        if not (options.package and options.output):
            parser.error("--run needs --package and --output")
        answer_all(options.run, options.package, options.output, options.only)
    if options.page:
        before, after = (json.loads(path.read_text(encoding="utf-8")) for path in options.page)
        print(page(before, after))


def answer_all(folder: Path, package: Path, output: Path, only: str = "") -> None:
    """Answers of one source tree, written after each pad; those already there are kept."""
    found = json.loads(output.read_text(encoding="utf-8")) if output.exists() else {}
    for file in sorted(folder.glob("*.csv")):
        if file.stem in found or only not in file.stem:
            continue
        truth = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))
        found[file.stem] = truth | answer(
            file, package.resolve(), truth["exact"], truth.get("options", ())
        )
        output.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def answer(file: Path, package: Path, exact: bool, options: Sequence[str]) -> dict:
    """Return what `diagnose` says of one pad; of an exact record, what `fit` says."""
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as results:
        words = ["fit" if exact else "diagnose", str(file), "-o", results, *options]
        command = [sys.executable, "-c", _MAIN, *words]
        environment = os.environ | {"PYTHONPATH": str(package)}
        try:
            ran = subprocess.run(
                command, cwd=results, env=environment, capture_output=True, text=True,
                timeout=_LIMIT_S, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return {"status": None, "error": f"no answer in {_LIMIT_S:g} s"}
        found: dict = {"status": ran.returncode, "seconds": time.perf_counter() - begun}
        if ran.returncode:
            lines = ran.stderr.strip().splitlines()
            return found | {"error": lines[-1] if lines else ""}
        return found | _read(Path(results) / "pad", exact)


def _read(folder: Path, exact: bool) -> dict:
    if exact:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        return {"verdict": "fitted", "converged": summary["converged"], "effects": []}
    diagnosis = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    keys = ("verdict", "effects", "group", "worst", "noise_N", "remainder", "base")
    last = diagnosis["steps"][-1]
    found = {key: diagnosis[key] for key in keys if key in diagnosis}
    return found | {"rmse_N": last["rmse_N"], "ranking": diagnosis["ranking"][:3]}


def page(before: dict, after: dict) -> str:
    """Markdown: one line a row of the table, what each of the two trees said."""
    lines = ["| given | hidden | before | after |", "|---|---|---|---|"]
    every = before | after
    rows: dict[str, list[str]] = {}
    for name, found in every.items():
        rows.setdefault(found["row"], []).append(name)
    for row, names in rows.items():
        hidden = sorted({" + ".join(every[name]["hidden"]) or "nothing" for name in names})
        said = [_said([tree[n] for n in names if n in tree]) for tree in (before, after)]
        lines.append(f"| {row} ({len(names)}) | {', '.join(hidden)} | {said[0]} | {said[1]} |")
    return "\n".join(lines) + "\n"


def _said(answers: Sequence[dict]) -> str:
    """Each answer in a few words, equal ones counted."""
    words = [_one(answer) for answer in answers]
    return "; ".join(f"{words.count(w)} x {w}" for w in dict.fromkeys(words)) or "-"


def _one(answer: dict) -> str:
    if answer.get("status", 0) is None:
        return str(answer["error"])
    if "verdict" not in answer:
        return f"status {answer['status']}: {answer['error']}"
    laws = _laws(answer.get("base"))
    if answer["verdict"] in ("adequate", "unexplained", "fitted"):
        return f"{answer['verdict']}{laws if answer['verdict'] == 'adequate' else ''}"
    wrong = "" if set(answer["effects"]) == set(answer["hidden"]) else " (wrong)"
    if answer["verdict"] == "ambiguous":
        return f"ambiguous: {', '.join(answer['group'])}"
    rest = ", and something unlisted" * (answer["verdict"] == "partly_explained")
    return f"{' + '.join(answer['effects'])}{rest}{laws}{wrong}"


def _laws(base: dict | None) -> str:
    """Base laws that are not those chosen."""
    named = [(base or {}).get("elastic"), (base or {}).get("relaxation")]
    other = [law for law in named if law not in (None, "exponential", "prony:2")]
    return f" by {' and '.join(other)}" if other else ""


if __name__ == "__main__":
    main()
