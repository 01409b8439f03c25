"""Independent work side by side: JAX lets go of the interpreter while it computes or compiles."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_here = threading.local()


def together(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """``[work(item) for item in items]``, on as many threads as this process may use processors.

    What is called from within such work is done one after the other. The first error is raised.
    """
    todo = list(items)
    threads = min(len(todo), _processors())
    if threads < 2 or getattr(_here, "busy", False):
        return [work(item) for item in todo]
    pool = ThreadPoolExecutor(threads, initializer=alone)
    try:
        return list(pool.map(work, todo))
    finally:
        pool.shutdown(cancel_futures=True)


def alone() -> None:
    """From now on, this thread does such work one after the other: others use the processors."""
    _here.busy = True


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):  # not on every system
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
