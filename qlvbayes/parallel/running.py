"""Execution of one task for every item of many, in order, by any engine."""

from __future__ import annotations

import hashlib
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Future
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Generic, TypeVar, cast

import qlvbayes
from qlvbayes.io.runtime import forget_compiled, one_blas_thread
from qlvbayes.parallel.engines import Engine, EngineLostError
from qlvbayes.parallel.faults import Fault, fault_of

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_DEATHS = 2  # of a process that works on one item alone: one may be chance, two are not
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
    """Run ``task`` for every item; yield what became of each, in the order of the items."""
    if engine is None:
        for item in items:
            outcome = _passed(item) or Outcome(cast(Item, item), *_tried(task, cast(Item, item)))
            keep(outcome)
            yield outcome
        return
    yield from _Run(task, engine, keep).through(cast(Iterator[Item], iter(items)))


@cache
def package_digest() -> str:
    """Return the digest of the package's source; results of other code are not reused."""
    digest = hashlib.sha256()
    root = Path(qlvbayes.__file__).parent
    for file in sorted(root.rglob("*.py")):
        digest.update(file.relative_to(root).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()


def _passed(item: Any) -> Outcome[Any, Any] | None:
    """Return the outcome of an item that needs no work: a fault, or a known outcome."""
    if isinstance(item, Outcome):
        return item
    return Outcome(item, None, item) if isinstance(item, Fault) else None


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


@dataclass(eq=False)
class _Run(Generic[Item, Answer]):
    """Items that pass through an engine.

    A process that dies takes all others of its pool with it. What was being worked on then is done
    again one by one, so that the item at fault is known and no other pays for it.
    ``alone``: the index of the item that was last submitted alone; ``deaths``: how often its
    process died.
    """

    task: Callable[[Item], Answer]
    engine: Engine
    keep: Callable[[Outcome[Item, Answer]], None]
    finished: SimpleQueue[tuple[int, Future[Any]]] = field(default_factory=SimpleQueue)
    handed: dict[int, Item] = field(default_factory=dict)
    done: dict[int, Outcome[Item, Answer]] = field(default_factory=dict)
    suspects: deque[tuple[int, Item]] = field(default_factory=deque)
    alone: int | None = None
    deaths: int = 0

    def through(self, items: Iterator[Item]) -> Iterator[Outcome[Item, Answer]]:
        """Yield all outcomes in order."""
        numbered, next_index = enumerate(items), 0
        more = True
        while True:
            more = self._hand_over(numbered) and more
            while next_index in self.done:
                yield self.done.pop(next_index)
                next_index += 1
            if self.handed:
                self._hear(*self.finished.get())
            elif not more and not self.suspects and next_index not in self.done:
                return

    def _hand_over(self, numbered: Iterator[tuple[int, Item]]) -> bool:
        """Submit as many items as the engine takes; return whether more may follow."""
        if self.suspects:
            if not self.handed:
                index, item = self.suspects.popleft()
                self.deaths = self.deaths if self.alone == index else 0
                self.alone = index
                self._submit(index, item)
            return True
        while len(self.handed) < self.engine.ahead and len(self.done) < _WAITING:
            entry = next(numbered, None)
            if entry is None:
                return False
            if (passed := _passed(entry[1])) is not None:
                self._end(entry[0], passed)
            else:
                self._submit(*entry)
            if self.suspects:
                break
        return True

    def _submit(self, index: int, item: Item) -> None:
        try:
            future = self.engine.submit(_tried_elsewhere, package_digest(), self.task, item)
        except BrokenExecutor:  # it broke while nobody listened
            self.suspects.append((index, item))
            if not self.handed:  # else the last of them does it
                self.engine.renew()
            return
        self.handed[index] = item
        future.add_done_callback(lambda done: self.finished.put((index, done)))

    def _hear(self, index: int, future: Future[Any]) -> None:
        item = self.handed.pop(index)
        try:
            answer, fault = future.result()
        except BrokenExecutor:
            self._died(index, item)
        except CancelledError:
            self.engine.renew()
        except EngineLostError:
            raise
        except Exception as error:  # its arguments or its answer cannot travel, or a worker died
            self._end(index, Outcome(item, None, _of_engine(error)))
        else:
            self._end(index, Outcome(item, answer, fault))

    def _died(self, index: int, item: Item) -> None:
        if not self.handed:  # the last of those that the pool took with it
            self.engine.renew()
        if index != self.alone:
            self.suspects.append((index, item))
            return
        self.deaths += 1
        if self.deaths < _DEATHS:
            self.suspects.appendleft((index, item))
        else:
            self._end(index, Outcome(item, None, _DIED))

    def _end(self, index: int, outcome: Outcome[Item, Answer]) -> None:
        self.keep(outcome)
        self.done[index] = outcome


_DIED = Fault(
    "the process that worked on it was killed, again and again; "
    "it may need more memory: use fewer --jobs, or a machine with more"
)


def _of_engine(error: Exception) -> Fault:
    """Return the fault of an error in the engine: Dask raises it when workers die."""
    return _DIED if type(error).__name__ == "KilledWorker" else fault_of(error)
