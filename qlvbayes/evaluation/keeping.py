"""Studies run and kept as JSON lines, so that an interrupted run goes on."""

from __future__ import annotations

import ast
import hashlib
import json
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import count
from pathlib import Path

import qlvbayes
from qlvbayes.evaluation.rate import Case
from qlvbayes.parallel.engines import Engine
from qlvbayes.parallel.faults import FailedError, Fault
from qlvbayes.parallel.running import Outcome, run_all

Tell = Callable[[int, int], None]

_PACKAGE = Path(qlvbayes.__file__).parent

_SCORING = (
    "rate",
    "scores",
    "reliability",
    "constants",
    "report",
    "counting",
    "widereport",
)
_ONLY_LOOKS = (  # parts of the package that only look at finished studies
    "cli/",
    "parallel/",
    "plots/",
    *(f"evaluation/{name}.py" for name in ("keeping", *_SCORING)),
)


class Kept:
    """Studies of one plan: a file, a line each, and its parts 'FILE.1', 'FILE.2' beside it.

    New ones go to the file, or to one part, so that several processes may write at once. Lines of
    other plans do not count, nor does one that a kill has cut short.
    """

    def __init__(self, path: Path, plan: str, part: int | None = None) -> None:
        self.plan = plan
        self._own = path if part is None else path.with_name(f"{path.name}.{part}")
        _mend(self._own)
        self.cases: dict[int, dict] = {}
        for file in [path, *sorted(path.parent.glob(f"{path.name}.*"))]:
            self.cases |= {case["index"]: case for case in _read(file) if case["plan"] == plan}

    def add(self, case: dict) -> None:
        """Write one study."""
        self._own.parent.mkdir(parents=True, exist_ok=True)
        with self._own.open("a", encoding="utf-8") as file:
            file.write(json.dumps(case) + "\n")
        self.cases[case["index"]] = case

    def first(self, count: int) -> list[dict]:
        """The studies at the first ``count`` places, in order."""
        return [self.cases[k] for k in sorted(self.cases) if k < count]

    def missing(self, count: int) -> list[int]:
        """Which of the first ``count`` are not there."""
        return [k for k in range(count) if k not in self.cases]


def kept_file(folder: Path, key: str) -> Path:
    """Where the studies of a plan or population, and of this code, are kept."""
    return folder / f"{key}-{code_digest()}.jsonl"


def run_missing(
    study: Callable[[int], Case],
    kept: Kept,
    indices: Iterable[int],
    tell: Tell = lambda done, total: None,
    engine: Engine | None = None,
) -> None:
    """Run the studies at some places; ``tell`` hears how many are done.

    Each is kept as soon as it is finished, with the digest of the code that it was run by. engine:
    what works, this process where it is None. Raises FailedError where some stopped by an error,
    after the others were done.
    """
    digest = code_digest()
    missing = [index for index in indices if index not in kept.cases]
    faults: list[Fault] = []
    done = count(1)
    tell(0, len(missing))

    def keep(outcome: Outcome[int, Case]) -> None:
        if outcome.answer is not None:
            kept.add(outcome.answer | {"code": digest})
        if outcome.fault is not None:
            faults.append(replace(outcome.fault, of=f"study {outcome.item}"))
        tell(next(done), len(missing))

    deque(run_all(study, missing, engine, keep=keep), maxlen=0)
    if faults:
        raise FailedError(faults, len(missing))


def _read(path: Path) -> list[dict]:
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").split("\n")[:-1]]


def _mend(path: Path) -> None:
    """Take off a line that was cut short, so that the next one begins its own."""
    if path.exists():
        whole, _, rest = path.read_text(encoding="utf-8").rpartition("\n")
        if rest:
            path.write_text(f"{whole}\n" if whole else "", encoding="utf-8")


def code_digest(root: Path = _PACKAGE) -> str:
    """Digest of all code that a study's outcome may depend on; comments, docstrings, layout aside.

    Studies of other code must not be mixed with new ones.
    """
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        name = path.relative_to(root).as_posix()
        if not name.startswith(_ONLY_LOOKS):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            digest.update(f"{name}\n{ast.dump(_bare(tree))}\n".encode())
    return digest.hexdigest()[:12]


def _bare(tree: ast.Module) -> ast.Module:
    """Without docstrings."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            match node.body:
                case [ast.Expr(ast.Constant(str())), *rest]:
                    node.body = list(rest)
    return tree
