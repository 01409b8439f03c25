"""A store of finished studies as JSON lines, from which an interrupted run resumes."""

from __future__ import annotations

import ast
import hashlib
import json
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import Any

import qlvbayes
from qlvbayes.parallel.engines import Engine
from qlvbayes.parallel.running import FailedError, Fault, Outcome, run_all

PACKAGE = Path(qlvbayes.__file__).parent

Case = dict[str, Any]
"""A finished study, plain values for JSON; ``index`` is what it is stored under."""

# parts of the package that no diagnosis computes with
_WITHOUT_EFFECT = (
    "cli/", "guess/", "parallel/", "plots/", "evaluation/store.py", "evaluation/table.py"
)  # fmt: skip


class Store:
    """Finished studies in a file, one a line, and in its parts 'FILE.1', 'FILE.2' in the folder.

    New studies are appended to the file, or to one part, so that several processes may write at
    once. A line that a kill has cut short is removed.

    path: The file; plan: Only studies whose key ``plan`` has this value count; None counts all;
    part: Number of the part that new studies are written to; None writes to the file.
    """

    def __init__(self, path: Path, plan: str | None = None, part: int | None = None) -> None:
        self.plan = plan
        self.path = path if part is None else path.with_name(f"{path.name}.{part}")
        _remove_cut_line(self.path)
        self.cases: dict[Any, Case] = {}
        for file in [path, *sorted(path.parent.glob(f"{path.name}.*"))]:
            self.cases |= {
                case["index"]: case for case in _read(file) if plan in (None, case.get("plan"))
            }

    def add(self, case: Case) -> None:
        """Append one study."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(case) + "\n")
        self.cases[case["index"]] = case

    def first(self, count: int) -> list[Case]:
        """Return the stored studies with an index below ``count``, in order."""
        return [self.cases[k] for k in sorted(self.cases) if k < count]

    def missing(self, count: int) -> list[int]:
        """Return the indices below ``count`` that are not stored."""
        return [k for k in range(count) if k not in self.cases]


def store_path(folder: Path, name: str, code: str | None = None) -> Path:
    """Return the file for the studies of this name that the present code runs."""
    return folder / f"{name}-{code or code_digest()}.jsonl"


def run_missing(
    study: Callable[[Any], Case],
    store: Store,
    indices: Iterable[Any],
    report: Callable[[int, int], None] = lambda done, total: None,
    engine: Engine | None = None,
    key: Callable[[Any], Any] = lambda study: study,
    code: str | None = None,
) -> None:
    """Run the studies that are not stored, and store each as soon as it is finished."""
    digest = code or code_digest()
    missing = [index for index in indices if key(index) not in store.cases]
    faults: list[Fault] = []
    done = count(1)
    report(0, len(missing))

    def keep(outcome: Outcome) -> None:
        if outcome.answer is not None:
            store.add(outcome.answer | {"code": digest})
        if outcome.fault is not None:
            faults.append(replace(outcome.fault, of=f"study {key(outcome.item)}"))
        report(next(done), len(missing))

    deque(run_all(study, missing, engine, keep=keep), maxlen=0)
    if faults:
        raise FailedError(faults, len(missing))


def _read(path: Path) -> list[Case]:
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").split("\n")[:-1]]


def _remove_cut_line(path: Path) -> None:
    """Remove a last line that was cut short, so that the next one begins its own."""
    if path.exists():
        whole, _, rest = path.read_text(encoding="utf-8").rpartition("\n")
        if rest:
            path.write_text(f"{whole}\n" if whole else "", encoding="utf-8")


def code_digest(*roots: Path, without: tuple[str, ...] = ()) -> str:
    """Return the digest of all code that the result of a study may depend on."""
    out = (*_WITHOUT_EFFECT, *without)
    files = [(path, root) for root in roots or (PACKAGE,) for path in sorted(root.rglob("*.py"))]
    names = ((path.relative_to(root).as_posix(), path) for path, root in files)
    return _digest(
        tuple(
            (name, path.read_text(encoding="utf-8"))
            for name, path in names
            if not name.startswith(out)
        )
    )


@lru_cache(maxsize=1)  # a run asks several times, and to parse the package takes 2 s
def _digest(texts: tuple[tuple[str, str], ...]) -> str:
    digest = hashlib.sha256()
    for name, text in texts:
        tree = _without_docstrings(ast.parse(text))
        digest.update(f"{name}\n{ast.dump(tree)}\n".encode())
    return digest.hexdigest()[:12]


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            match node.body:
                case [ast.Expr(ast.Constant(str())), *rest]:
                    node.body = list(rest)
    return tree
