"""Execution of one task for every item of many, in order, by any engine."""

from __future__ import annotations

import hashlib
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

import qlvbayes
from qlvbayes.io.runtime import forget_compiled, one_blas_thread
from qlvbayes.parallel.engines import Engine, KilledError
from qlvbayes.parallel.faults import Fault, fault_of

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_WAITING = 1000  # outcomes kept at most while that of an item before them is not there
_IN_TURN = threading.Lock()  # figures have settings of the whole process: one task at a time


@dataclass(frozen=True, eq=False)
class Outcome(Generic[Item, Answer]):
    """Result of one item: the task's answer, or its fault."""

    item: Item
    answer: Answer | None
    fault: Fault | None = None


def run_all(
    task: Callable[[Item], Answer],
    items: Iterable[Item | Fault | Outcome[Item, Answer]],
    engine: Engine | None = None,
    *,
    keep: Callable[[Outcome[Item, Answer]], None] = lambda outcome: None,
) -> Iterator[Outcome[Item, Answer]]:
    """Run ``task`` for every item; yield what became of each, in the order of the items.

    ``keep`` receives each outcome as soon as it is there. An item that is a fault, or an outcome
    already, needs no work and passes in its place.
    """
    if engine is None:
        for one in items:
            outcome = _passed(one) or Outcome(cast(Item, one), *_tried(task, cast(Item, one)))
            keep(outcome)
            yield outcome
        return
    numbered = enumerate(items)
    working: dict[Future[Any], tuple[int, Item]] = {}
    done: dict[int, Outcome[Item, Answer]] = {}
    following, more = 0, True
    while more or working:
        while more and len(working) < _ahead(engine) and len(done) < _WAITING:
            entry = next(numbered, None)
            if entry is None:
                more = False
            elif (passed := _passed(entry[1])) is not None:
                keep(passed)
                done[entry[0]] = passed
            else:
                item = cast(Item, entry[1])
                working[_submitted(engine, task, item)] = entry[0], item
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


def _passed(item: Any) -> Outcome[Any, Any] | None:
    """Return the outcome of an item that needs no work: a fault, or a known outcome."""
    if isinstance(item, Outcome):
        return item
    return Outcome(item, None, item) if isinstance(item, Fault) else None


def _submitted(engine: Engine, task: Callable[[Item], Any], item: Item) -> Future[Any]:
    try:
        return engine.submit(_tried_elsewhere, package_digest(), task, item)
    except Exception as error:  # each engine raises its own when it has stopped
        raise engine.lost_error() from error


def _ahead(engine: Engine) -> int:
    try:
        return engine.ahead()
    except Exception as error:  # Dask raises several, as its connection is when asked
        raise engine.lost_error() from error


def _outcome(engine: Engine, item: Item, future: Future[Any]) -> Outcome[Item, Any]:
    """Return what a worker sent back; raise EngineLostError where there are none any more."""
    try:
        return Outcome(item, *future.result())
    except (BrokenExecutor, CancelledError) as error:
        raise engine.lost_error() from error
    except Exception as error:  # its arguments or its answer cannot travel, or workers died
        killed = type(error).__name__ == "KilledWorker"  # Dask's own
        return Outcome(item, None, fault_of(KilledError() if killed else error))


def _tried(task: Callable[[Item], Answer], item: Item) -> tuple[Answer | None, Fault | None]:
    """Return the task's answer, or its fault; both can be pickled, an exception may not."""
    # numbers must not depend on how many threads there are
    with _IN_TURN, one_blas_thread(), _without_scheduler():
        try:
            answer = task(item)
        except Exception as error:  # one bad item must not stop the others
            return None, fault_of(error)
        finally:
            forget_compiled()
    return answer, None


def _tried_elsewhere(
    code: str, task: Callable[[Item], Answer], item: Item
) -> tuple[Answer | None, Fault | None]:
    """Run `_tried` if the worker has the same package, so that results are not mixed."""
    if code != package_digest():
        version = f"the worker has another version of qlvbayes ({qlvbayes.__version__})"
        return None, Fault(f"{version}; install the same one where it runs")
    return _tried(task, item)


def _without_scheduler() -> AbstractContextManager[object]:
    """Stop xarray, in a worker of Dask, from asking the scheduler for locks on files."""
    if "distributed" not in sys.modules:
        return nullcontext()
    import dask

    synchronous: AbstractContextManager[object] = dask.config.set(scheduler="synchronous")
    return synchronous
