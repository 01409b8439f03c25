"""Execution of one task for every item of many, or of a part of them, in order, by any engine.

Failures of a task are one line each, which travels between processes.
"""

from __future__ import annotations

import errno
import hashlib
import os
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import qlvbayes
from qlvbayes.io.checks import InputError
from qlvbayes.io.runtime import forget_compiled, one_blas_thread
from qlvbayes.io.wording import listed, visible
from qlvbayes.parallel.engines import Engine, KilledError

Item = TypeVar("Item")
Found = TypeVar("Found")
Tried = tuple[Any, "Fault | None"]
"""The answer of a task, or its fault."""

_WAITING = 1000  # outcomes kept at most while that of an item before them is not there
_IN_TURN = threading.Lock()  # figures have settings of the whole process: one task at a time


@dataclass(frozen=True)
class Fault:
    """A failure: one line with its file, line and remedy."""

    text: str
    # whether the user can mend it (exit status 2), or it is an error of the program (1)
    mendable: bool = True
    of: str = ""  # the pad, or the file, that it happened to

    @property
    def status(self) -> int:
        """Exit status of a command that ends with it."""
        return 2 if self.mendable else 1


def fault_of(error: BaseException) -> Fault:
    """Return the fault of an exception; with ``QLVBAYES_DEBUG`` its traceback is printed too."""
    if os.environ.get("QLVBAYES_DEBUG"):
        traceback.print_exception(error)
    if isinstance(error, InputError):
        return Fault(str(error))
    if isinstance(error, OSError):
        prefix = f"{error.filename}: " if error.filename else ""
        full = error.errno == errno.ENOSPC
        remedy = "free some space" if full else "check the path and its rights"
        return Fault(visible(f"{prefix}{error.strerror or error}; {remedy}"))
    if isinstance(error, MemoryError):
        return Fault("not enough memory; read fewer pads with --pads, or use fewer --jobs")
    text = visible(" ".join(str(error).split())[:300])
    kind, remedy = type(error).__name__, "set QLVBAYES_DEBUG=1 for the traceback and report it"
    return Fault(f"internal error ({kind}: {text}); {remedy}", mendable=False)


class FailedError(InputError):
    """Exception raised after some of many pads failed; the others were finished.

    faults: why, one each; total: how many pads there were; results: of those that did not fail,
    where they are returned. Several that failed alike are one line.
    """

    def __init__(self, faults: Sequence[Fault], total: int, results: Sequence[Any] = ()) -> None:
        self.faults = tuple(faults)
        self.total = total
        self.results = list(results)
        self.status = min(fault.status for fault in faults)
        super().__init__("; ".join(self.lines))

    @property
    def lines(self) -> list[str]:
        """Return one line for each reason, with the pads that it holds for."""
        reasons: dict[str, list[str]] = {}
        for fault in self.faults:
            reasons.setdefault(fault.text, []).append(fault.of)
        if len(reasons) == 1 and len(self.faults) == self.total:
            return list(reasons)
        lines = [f"{listed(names)}: {text}" for text, names in reasons.items()]
        rest = self.total - len(self.faults)
        return [*lines, f"{len(self.faults)} of {self.total} failed; {rest} are done"]


@dataclass(frozen=True)
class Shard:
    """One part of many, each run by itself: ``3/200`` is the third of two hundred."""

    index: int = 1  # from 1
    count: int = 1

    @classmethod
    def from_text(cls, text: str) -> Shard:
        """Read ``3/200``, or ``slurm``: the index of this job in an array of SLURM."""
        index, slash, count = (part.strip() for part in text.partition("/"))
        if index.lower() == "slurm":
            job = cls._from_slurm()
            if not slash:
                return job
            index = str(job.index)  # of an array that is smaller than the number of parts
        if not (slash and index.isdecimal() and count.isdecimal()):
            raise InputError(f"no part {text!r}", remedy="write it as 3/200, or as slurm")
        if not 1 <= int(index) <= int(count):
            remedy = f"use 1/{count} to {count}/{count}"
            raise InputError(f"no part {index} of {count}", remedy=remedy)
        return cls(int(index), int(count))

    @classmethod
    def _from_slurm(cls) -> Shard:
        values = [os.environ.get(f"SLURM_ARRAY_TASK_{x}", "") for x in ("ID", "MIN", "COUNT")]
        if not all(text.isdecimal() for text in values):
            raise InputError(
                "this is no job of a SLURM array: SLURM_ARRAY_TASK_ID is not set",
                remedy="run it by sbatch --array=1-200, or write the part as 3/200",
            )
        task, first, count = map(int, values)
        if not 1 <= task - first + 1 <= count:
            what = f"the SLURM array has gaps: task {task} of {count} that begin with {first}"
            remedy = "number it without gaps, as --array=1-200, or write the part as 3/200"
            raise InputError(what, remedy=remedy)
        return cls(task - first + 1, count)

    def part(self, items: Sequence[Item]) -> Sequence[Item]:
        """Return every ``count``-th item, from the index on."""
        return items[self.index - 1 :: self.count]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of one item: the task's answer, or its fault."""

    item: Any
    answer: Any
    fault: Fault | None = None


def run_all(
    task: Callable[[Any], Any],
    items: Iterable[Any],
    engine: Engine | None = None,
    *,
    keep: Callable[[Outcome], None] = lambda outcome: None,
) -> Iterator[Outcome]:
    """Run ``task`` for every item; yield what became of each, in the order of the items.

    ``keep`` receives each outcome as soon as it is there. An item that is a fault, or an outcome
    already, needs no work and passes in its place.
    """
    if engine is None:
        for one in items:
            outcome = _passed(one) or Outcome(one, *_tried(task, one))
            keep(outcome)
            yield outcome
        return
    numbered = enumerate(items)
    working: dict[Future[Any], tuple[int, Any]] = {}
    done: dict[int, Outcome] = {}
    following, more = 0, True
    while more or working:
        while more and len(done) < _WAITING and len(working) < _asked(engine, engine.ahead):
            index, item = next(numbered, (-1, None))
            if index < 0:
                more = False
            elif (passed := _passed(item)) is not None:
                keep(passed)
                done[index] = passed
            else:
                call = partial(engine.submit, _tried_elsewhere, package_digest(), task, item)
                working[_asked(engine, call)] = index, item
        for future in wait(working, return_when=FIRST_COMPLETED).done if working else ():
            index, item = working.pop(future)
            done[index] = _outcome(engine, item, future)
            keep(done[index])
        while following in done:
            yield done.pop(following)
            following += 1


@cache
def package_digest(folders: tuple[str, ...] = ()) -> str:
    """Return the digest of the source of some folders of the package, by default of all of it.

    Modules that lie in no folder belong to each.
    """
    digest = hashlib.sha256()
    root = Path(qlvbayes.__file__).parent
    for file in sorted(root.rglob("*.py")):
        name = file.relative_to(root)
        if not folders or len(name.parts) == 1 or name.parts[0] in folders:
            digest.update(name.as_posix().encode() + file.read_bytes())
    return digest.hexdigest()


def _passed(item: Any) -> Outcome | None:
    """Return the outcome of an item that needs no work: a fault, or a known outcome."""
    if isinstance(item, Outcome):
        return item
    return Outcome(item, None, item) if isinstance(item, Fault) else None


def _asked(engine: Engine, call: Callable[[], Found]) -> Found:
    try:
        return call()
    except Exception as error:  # each engine raises its own when it has stopped
        raise engine.lost from error


def _outcome(engine: Engine, item: Any, future: Future[Any]) -> Outcome:
    """Return what a worker sent back; raise EngineLostError where there are none any more."""
    try:
        return Outcome(item, *future.result())
    except (BrokenExecutor, CancelledError) as error:
        raise engine.lost from error
    except Exception as error:  # its arguments or its answer cannot travel, or workers died
        killed = type(error).__name__ == "KilledWorker"  # Dask's own
        return Outcome(item, None, fault_of(KilledError() if killed else error))


def _tried(task: Callable[[Any], Any], item: Any) -> Tried:
    """Return the task's answer, or its fault; both can be pickled, an exception may not."""
    # numbers must not depend on how many threads there are
    with _IN_TURN, one_blas_thread(), ExitStack() as stack:
        if "distributed" in sys.modules:  # or xarray asks the scheduler for locks on files
            import dask

            stack.enter_context(dask.config.set(scheduler="synchronous"))
        try:
            return task(item), None
        except Exception as error:  # one bad item must not stop the others
            return None, fault_of(error)
        finally:
            forget_compiled()


def _tried_elsewhere(code: str, task: Callable[[Any], Any], item: Any) -> Tried:
    """Run `_tried` if the worker has the same package, so that results are not mixed."""
    if code != package_digest():
        version = f"the worker has another version of qlvbayes ({qlvbayes.__version__})"
        return None, Fault(f"{version}; install the same one where it runs")
    return _tried(task, item)
