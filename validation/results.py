"""Tables of what runs found, with their origin, and the running of what is missing.

A script runs what is missing with `finished`, makes one `Table`, and writes it. The page
docs/reliability.md is made of these tables alone (`reliability.py`).
"""

from __future__ import annotations

import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from blind.counting import Case
from blind.store import Store, code_digest, run_missing

from qlvbayes.cli.console import counting
from qlvbayes.io.files import write_json
from qlvbayes.parallel.engines import opened_engine
from qlvbayes.parallel.running import FailedError

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).parent / "results"
BUILD = ROOT / "build" / "validation"
JOBS = 2  # processes


@dataclass(frozen=True)
class Origin:
    """Where numbers come from: a command, and the date, commit and machine of its run."""

    command: str
    date: str
    commit: str
    machine: str

    @classmethod
    def now(cls) -> Origin:
        """Return the origin of this run; one of code that is not committed is refused."""
        code = ("qlvbayes", "validation", ":!validation/results")
        if _git("status", "--porcelain", "--untracked-files=no", "--", *code):
            sys.exit("qlvbayes/ or validation/ has changes: commit them before a run that is kept")
        machine = (
            f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()}"
        )
        command = shlex.join(["python", os.path.relpath(sys.argv[0], ROOT), *sys.argv[1:]])
        return cls(command, cls.today(), _git("rev-parse", "--short=8", "HEAD"), machine)

    @staticmethod
    def today() -> str:
        """Return the date."""
        return datetime.now(UTC).strftime("%Y-%m-%d")


def _git(*words: str) -> str:
    found = subprocess.run(("git", *words), cwd=ROOT, capture_output=True, text=True, check=False)
    return found.stdout.strip()


@dataclass(frozen=True)
class Table:
    """A table of what was found.

    size: pads, pairs or files that were counted; notes: lines that have its numbers.
    """

    origin: Origin
    size: int
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    @classmethod
    def read(cls, name: str) -> Table:
        """Return the table of validation/results/NAME.json."""
        kept = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
        return cls(**kept | {"origin": Origin(**kept["origin"])})

    def write(self, name: str) -> None:
        """Write validation/results/NAME.json and print the table.

        One that is smaller than what is published is kept next to it, in the folder `again`.
        """
        print(self.markdown())
        again = RESULTS / "again" / f"{name}.json"
        again.unlink(missing_ok=True)
        published = (RESULTS / f"{name}.json").exists() and Table.read(name).size > self.size
        path = again if published else RESULTS / f"{name}.json"
        path.parent.mkdir(exist_ok=True)
        write_json(path, asdict(self), indent=1)

    def markdown(self) -> str:
        """Return the table, its notes, and a line with its origin."""
        made = f"*`{self.origin.command}`, {self.origin.date}, commit {self.origin.commit}.*"
        lines = [*grid(self.columns, self.rows), "", *self.notes, *([""] if self.notes else [])]
        return "\n".join([*lines, made, ""])


def grid(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    lines = [columns, ["---"] * len(columns), *rows]
    return [f"| {' | '.join(cells)} |" for cells in lines]


def share(hits: int, n: int) -> str:
    """Return a count with its share."""
    return f"{hits} of {n} ({hits / n:.0%})" if n else "-"


def stored(name: str, code: str | None = None) -> Store:
    """Return the store in build/validation of this name and code, the present one if None."""
    return Store(BUILD / f"{name}-{code or code_digest()}.jsonl")


def commits_of(cases: Sequence[Case]) -> str:
    """Return the commits that ran studies, first to last: a long run may go on with later code."""
    return ", ".join(dict.fromkeys(case["commit"][:8] for case in cases))


def finished(
    name: str, study: Callable[[Any], Case], indices: Sequence[Any], jobs: int = JOBS
) -> list[Case]:
    """Return the studies of these indices, after running those that are not stored.

    A pad that the simulator cannot make is reported and left out.

    Parameters
    ----------
    name
        Of the store in build/validation, which only the same code adds to.
    study
        Runs the study of an index; it can be pickled, and its answer has the key ``index``.
    indices
        The studies that are wanted.
    jobs
        Processes.
    """
    store = stored(name)
    try:
        with opened_engine(jobs) as engine, counting(name) as report:
            run_missing(study, store, indices, report, engine)
    except FailedError as error:
        print(*error.lines, sep="\n", file=sys.stderr)
        if not all("the simulation stopped" in fault.text for fault in error.faults):
            sys.exit("a study failed otherwise than by its simulation; the others are stored")
    return [store.cases[index] for index in indices if index in store.cases]
