"""Engines that run tasks: spawned processes, a Dask cluster, any executor with ``submit``."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from qlvbayes.io.checks import InputError
from qlvbayes.io.runtime import THREADS, cores

_WAIT_S = 10.0  # for a scheduler to answer: one that is there answers within a second
_LEAST = 16  # tasks that wait on a cluster, so that one that grows sees that there is work
_DEATHS = 2  # of processes at work on one task: one may be chance, two are not


class EngineLostError(InputError):
    """Exception for an engine that has stopped; finished work is kept."""


class KilledError(InputError):
    """Exception for a task whose processes were killed, again and again."""

    def __init__(self) -> None:
        super().__init__(
            "the process that worked on it was killed, again and again",
            remedy="it may need more memory: use fewer --jobs, or a machine with more",
        )


@dataclass(frozen=True, eq=False)
class Engine:
    """Receiver of tasks: processes, a cluster or an executor of the user."""

    submit: Callable[..., Future[Any]]  # of one call
    ahead: Callable[[], int]  # most tasks that are submitted, waiting ones included
    lost: EngineLostError  # says that it has stopped, and the remedy
    shares_disk: bool = False  # whether its workers are sure to see the files of this process


class Processes:
    """Spawned interpreters, never forked ones, because JAX has threads.

    Each is the only one of its pool, so that one that dies takes no other task with it. A thread
    waits for each and starts it when it is needed. It ends when its parent does or closes its pipe.
    """

    def __init__(self, count: int) -> None:
        self._threads, self._own = ThreadPoolExecutor(count), threading.local()
        self._share = max(1, cores() // count)
        self._all: list[tuple[Connection, ProcessPoolExecutor]] = []
        self._closed = False

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit one call."""
        return self._threads.submit(self._run, function, *arguments)

    def _run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the answer of the thread's process; if that dies another does the task again."""
        for _ in range(_DEATHS):
            if getattr(self._own, "pool", None) is None:
                self._own.pool = self._spawned()
            try:
                return self._own.pool.submit(function, *arguments).result()
            except BrokenExecutor as error:
                self._own.pool = None
                if self._closed:
                    raise CancelledError from error
        raise KilledError

    def _spawned(self) -> ProcessPoolExecutor:
        # idle threads of BLAS, as many as there are cores in each process, take memory
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        theirs, ours = multiprocessing.Pipe(duplex=False)
        spawning = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(1, spawning, _begin, (theirs, self._share))
        self._all.append((ours, pool))
        return pool

    def close(self) -> None:
        """Stop all processes at once, whatever they are doing."""
        self._closed = True
        self._threads.shutdown(wait=False, cancel_futures=True)
        for lifeline, _ in list(self._all):
            lifeline.close()
        for _, pool in list(self._all):
            pool.shutdown(cancel_futures=True)
        self._threads.shutdown()


def _begin(lifeline: Connection, threads: int) -> None:
    """Initialise a process: Ctrl-C is its parent's to answer, and it ends when its parent does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ[THREADS] = str(threads)

    def wait() -> None:
        try:
            lifeline.recv_bytes()  # as nothing is ever sent, it returns when the pipe closes
        except (EOFError, OSError):
            os._exit(0)

    threading.Thread(target=wait, daemon=True).start()


def engine_of(client: Any) -> Engine | None:
    """Return the engine of a Dask client or of an executor; None for this process."""
    if client is None or isinstance(client, Engine):
        return client
    if hasattr(client, "get_executor") and hasattr(client, "nthreads"):
        # Dask itself replaces a worker that died, and gives up a task that kills several
        lost = EngineLostError(
            f"the Dask scheduler at {getattr(client.scheduler, 'address', '')} is lost",
            remedy="start it and give the same command again: what is finished is kept",
        )

        def ahead() -> int:  # workers come and go; the next task waits when one is done
            return max(_LEAST, 2 * sum(client.nthreads().values()))

        return Engine(client.get_executor(pure=False).submit, ahead, lost)
    if callable(getattr(client, "submit", None)):
        count = 2 * int(getattr(client, "_max_workers", None) or cores())
        lost = EngineLostError(
            "a worker of the executor has died and the executor with it",
            remedy="make a new one and call again: what is finished is kept",
        )
        return Engine(client.submit, lambda: count, lost)
    remedy = "give a distributed.Client or an executor of concurrent.futures"
    raise InputError(f"a {type(client).__name__} takes no work", remedy=remedy)


@contextmanager
def opened_engine(jobs: int = 1, cluster: str | None = None) -> Iterator[Engine | None]:
    """Open an engine of processes or of a cluster; None where this process does all."""
    if cluster is not None:
        client = _client(cluster)
        try:
            yield engine_of(client)
        finally:
            client.close(timeout=2.0)
    elif jobs > 1:
        processes = Processes(jobs)
        remedy = "give the same command again"
        stopped = EngineLostError("the processes were stopped", remedy=remedy)
        try:
            # one task waits, so that no process does
            yield Engine(processes.submit, lambda: jobs + 1, stopped, shares_disk=True)
        finally:
            processes.close()
    else:
        yield None


def _client(address: str) -> Any:
    """Return a Dask client of the scheduler at an address, or raise InputError."""
    try:
        from distributed import Client
    except ImportError as error:
        remedy = "pip install 'qlvbayes[cluster]'"
        raise InputError("a cluster needs the package distributed", remedy=remedy) from error
    for name in ("distributed.client", "distributed.core", "distributed.comm", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # one line says it: ours
    try:
        return Client(address, timeout=_WAIT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        remedy = "start it with 'dask scheduler', and give its address as tcp://HOST:PORT"
        raise InputError(f"no Dask scheduler answers at {address}", remedy=remedy) from error
