"""Engines that run tasks: spawned processes, a Dask cluster, any executor with ``submit``."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, Protocol

from qlvbayes.io.checks import InputError
from qlvbayes.io.runtime import THREADS, cores

_WAIT_S = 10.0  # for a scheduler to answer: one that is there answers within a second
_LEAST = 16  # tasks that wait on a cluster, so that one that grows sees that there is work
_LOOK_S = 5.0  # between two looks at how many workers there are


class EngineLostError(InputError):
    """Exception for an engine that has stopped; finished work is kept."""


class Engine(Protocol):
    """Interface of an engine that takes tasks."""

    @property
    def workers(self) -> int:
        """Number of workers."""
        ...

    @property
    def ahead(self) -> int:
        """Largest number of submitted tasks, waiting ones included."""
        ...

    @property
    def shares_disk(self) -> bool:
        """True if its workers are sure to see the files that this process sees."""
        ...

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit one call."""
        ...

    def renew(self) -> None:
        """Restart after a worker has died and stopped the others."""
        ...


class Processes:
    """Spawned interpreters, never forked ones, because JAX has threads."""

    shares_disk = True

    def __init__(self, count: int) -> None:
        self.workers = count
        self.ahead = count + 1  # one waits, so that no process does
        self._pool: ProcessPoolExecutor | None = None
        self._lifeline: Connection | None = None

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit one call; processes are started when they are needed."""
        if self._pool is None:
            # idle threads of BLAS, as many as there are cores in each process, take memory
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
            ours, self._lifeline = multiprocessing.Pipe(duplex=False)
            threads = max(1, cores() // self.workers)
            self._pool = ProcessPoolExecutor(
                self.workers,
                mp_context=multiprocessing.get_context("spawn"),
                initializer=_begin,
                initargs=(ours, threads),
            )
        return self._pool.submit(function, *arguments)

    def renew(self) -> None:
        """Stop the remaining processes; the next call starts new ones."""
        pool, lifeline = self._pool, self._lifeline
        self._pool = self._lifeline = None
        if lifeline is not None:
            lifeline.close()
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)


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


class UserExecutor:
    """An executor that the user passes: anything whose ``submit`` returns futures."""

    def __init__(self, executor: Any) -> None:
        self._executor = executor
        self.workers = int(getattr(executor, "_max_workers", None) or cores())
        self.ahead = 2 * self.workers
        self.shares_disk = False

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit one call."""
        future: Future[Any] = self._executor.submit(function, *arguments)
        return future

    def renew(self) -> None:
        """Raise EngineLostError, as only the owner can restart it."""
        raise EngineLostError(
            "a worker of the executor has died and the executor with it",
            remedy="make a new one and call again: what is finished is kept",
        )


class Cluster:
    """Workers of a Dask scheduler, by a ``distributed.Client``; they may come and go."""

    shares_disk = False

    def __init__(self, client: Any) -> None:
        self._client = client
        self._executor = client.get_executor(pure=False)
        self._address = getattr(client.scheduler, "address", "")
        self._looked, self._count = -_LOOK_S, 1

    @property
    def workers(self) -> int:
        """Number of threads of all workers, at most a few seconds old."""
        if time.monotonic() - self._looked > _LOOK_S:
            self._looked = time.monotonic()
            try:
                self._count = sum(self._client.nthreads().values())
            except Exception as error:  # Dask raises several, as its connection is when asked
                raise self._lost() from error
        return max(1, self._count)

    @property
    def ahead(self) -> int:
        """Twice the number of workers, so that the next task waits when one is done."""
        return max(_LEAST, 2 * self.workers)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit one call."""
        try:
            future: Future[Any] = self._executor.submit(function, *arguments)
        except Exception as error:
            raise self._lost() from error
        return future

    def renew(self) -> None:
        """Raise EngineLostError: Dask itself replaces a worker that died."""
        raise self._lost()

    def _lost(self) -> EngineLostError:
        return EngineLostError(
            f"the Dask scheduler at {self._address} is lost",
            remedy="start it and give the same command again: what is finished is kept",
        )


def engine_of(client: Any) -> Engine | None:
    """Return the engine of a Dask client or of an executor; None for this process."""
    if client is None or isinstance(client, Processes | Cluster | UserExecutor):
        return client
    if hasattr(client, "get_executor") and hasattr(client, "nthreads"):
        return Cluster(client)
    if callable(getattr(client, "submit", None)):
        return UserExecutor(client)
    raise InputError(
        f"a {type(client).__name__} takes no work",
        remedy="give a distributed.Client or an executor of concurrent.futures",
    )


@contextmanager
def opened_engine(jobs: int = 1, cluster: str | None = None) -> Iterator[Engine | None]:
    """Open the engine of ``--jobs`` and ``--cluster``; None where this process does all."""
    if cluster is not None:
        if jobs > 1:
            raise InputError("--jobs and --cluster are two ways to work", remedy="give one")
        with _client(cluster) as client:
            yield Cluster(client)
    elif jobs > 1:
        engine = Processes(jobs)
        try:
            yield engine
        finally:
            engine.renew()
    else:
        yield None


@contextmanager
def _client(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "--cluster needs the package distributed", remedy="pip install 'qlvbayes[cluster]'"
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
