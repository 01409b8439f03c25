"""Engines that run tasks: spawned processes, a Dask cluster, any executor with ``submit``."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
import time
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
from queue import SimpleQueue
from typing import Any

from qlvbayes.io.checks import InputError
from qlvbayes.io.runtime import THREADS, cores

_WAIT_S = 10.0  # for a scheduler to answer: one that is there answers within a second
_LEAST = 16  # tasks that wait on a cluster, so that one that grows sees that there is work
_LOOK_S = 5.0  # between two looks at how many workers there are
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
    """Receiver of tasks: processes, a cluster or an executor of the user.

    submit: Function that submits one call and returns its future; ahead: function of the largest
    number of submitted tasks, waiting ones included; lost: what has happened where it stops, and
    the remedy; shares_disk: whether its workers are sure to see the files that this process sees.
    """

    submit: Callable[..., Future[Any]]
    ahead: Callable[[], int]
    lost: tuple[str, str]
    shares_disk: bool = False

    def lost_error(self) -> EngineLostError:
        """Return the error that says that it has stopped."""
        return EngineLostError(self.lost[0], remedy=self.lost[1])


class Processes:
    """Spawned interpreters, never forked ones, because JAX has threads.

    Each is the only one of its pool, so that one that dies takes no other task with it. A thread
    waits for each; the processes are started when they are needed.
    """

    def __init__(self, count: int) -> None:
        self._threads = ThreadPoolExecutor(count)
        self._idle: SimpleQueue[_Process | None] = SimpleQueue()
        for _ in range(count):
            self._idle.put(None)
        self._share = max(1, cores() // count)
        self._all: list[_Process] = []
        self._closed = False

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit one call."""
        return self._threads.submit(self._run, function, *arguments)

    def _run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the answer of a process; one that dies is replaced, and its task done again."""
        for _ in range(_DEATHS):
            process: _Process | None = self._idle.get() or self._started()
            assert process is not None
            try:
                return process.run(function, *arguments)
            except BrokenExecutor as error:
                process.end()
                process = None
                if self._closed:
                    raise CancelledError from error
            finally:
                self._idle.put(process)
        raise KilledError

    def _started(self) -> _Process:
        process = _Process(self._share)
        self._all.append(process)
        return process

    def close(self) -> None:
        """Stop all processes at once, whatever they are doing."""
        self._closed = True
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in list(self._all):
            process.end()
        self._threads.shutdown()


class _Process:
    """One spawned interpreter, which ends when its parent does or closes its pipe."""

    def __init__(self, threads: int) -> None:
        # idle threads of BLAS, as many as there are cores in each process, take memory
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        ours, self._lifeline = multiprocessing.Pipe(duplex=False)
        self._ending, self._ended = threading.Lock(), False
        self._pool = ProcessPoolExecutor(
            1,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_begin,
            initargs=(ours, threads),
        )

    def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the answer to one call."""
        return self._pool.submit(function, *arguments).result()

    def end(self) -> None:
        """End the process; who closes all and who waits for this one may both ask for it."""
        with self._ending:
            if not self._ended:
                self._ended = True
                self._lifeline.close()
                self._pool.shutdown(cancel_futures=True)


def _begin(lifeline: Connection, threads: int) -> None:
    """Initialise a process: Ctrl-C is its parent's to answer, and it ends when its parent does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ[THREADS] = str(threads)
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    """Wait for the pipe to close, as nothing is ever sent, and exit."""
    try:
        lifeline.recv_bytes()
    except (EOFError, OSError):
        os._exit(0)


class _ClusterThreads:
    """Number of threads of all workers of a Dask client, who may come and go."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._looked, self._count = -_LOOK_S, 1

    def ahead(self) -> int:
        """Return twice their number, so that the next task waits when one is done."""
        if time.monotonic() - self._looked > _LOOK_S:
            self._looked = time.monotonic()
            self._count = sum(self._client.nthreads().values())
        return max(_LEAST, 2 * self._count)


def engine_of(client: Any) -> Engine | None:
    """Return the engine of a Dask client or of an executor; None for this process."""
    if client is None or isinstance(client, Engine):
        return client
    if hasattr(client, "get_executor") and hasattr(client, "nthreads"):
        # Dask itself replaces a worker that died, and gives up a task that kills several
        address = getattr(client.scheduler, "address", "")
        lost = (
            f"the Dask scheduler at {address} is lost",
            "start it and give the same command again: what is finished is kept",
        )
        return Engine(client.get_executor(pure=False).submit, _ClusterThreads(client).ahead, lost)
    if callable(getattr(client, "submit", None)):
        count = 2 * int(getattr(client, "_max_workers", None) or cores())
        lost = (
            "a worker of the executor has died and the executor with it",
            "make a new one and call again: what is finished is kept",
        )
        return Engine(client.submit, lambda: count, lost)
    raise InputError(
        f"a {type(client).__name__} takes no work",
        remedy="give a distributed.Client or an executor of concurrent.futures",
    )


@contextmanager
def opened_engine(jobs: int = 1, cluster: str | None = None) -> Iterator[Engine | None]:
    """Open an engine of processes or of a cluster; None where this process does all."""
    if cluster is not None:
        with _client(cluster) as client:
            yield engine_of(client)
    elif jobs > 1:
        processes = Processes(jobs)
        lost = ("the processes were stopped", "give the same command again")
        try:
            # one task waits, so that no process does
            yield Engine(processes.submit, lambda: jobs + 1, lost, shares_disk=True)
        finally:
            processes.close()
    else:
        yield None


@contextmanager
def _client(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "a cluster needs the package distributed", remedy="pip install 'qlvbayes[cluster]'"
        ) from error
    for name in ("distributed.client", "distributed.core", "distributed.comm", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # one line says it: ours
    try:
        client = Client(address, timeout=_WAIT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address}",
            remedy="start it with 'dask scheduler', and give its address as tcp://HOST:PORT",
        ) from error
    try:
        yield client
    finally:
        client.close(timeout=2.0)
