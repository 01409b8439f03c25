"""Keep worker processes, and exchange calls and answers with them over their pipes, a line each.

A call is a line of JSON with its ``number``, ``call`` and ``arguments``, and whether it ``reports``
its progress. What comes back are lines of ``NUMBER KIND JSON``: one ``answer`` or ``error``, and
before that any ``progress``. The process (`worker`) is a new interpreter, never a fork, and ends
when its standard input does. One is kept warm for the page, and started anew where it dies.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
from collections.abc import Callable
from itertools import count
from typing import Any

from qlvbayes.app.failures import RefusedError, refused

OnProgress = Callable[[dict[str, Any]], None]
"""Receiver of the progress of one call."""
_LONGEST = 2**26  # most bytes of a line
_ENDS_WITHIN = 2.0  # s that a process has to end by itself
_QUICKLY = 5.0  # s: a warm worker that dies within this time is restarted after a pause
_PAUSE = 2.0  # s before such a restart


class Worker:
    """Process that answers the calls of one module of the package."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._numbers = count(1)
        self._calls: dict[int, tuple[asyncio.Future[bytes], OnProgress | None]] = {}
        self.ended = asyncio.create_task(self._listen())

    @classmethod
    async def spawn(cls, module: str) -> Worker:
        """Start it in a session of its own, so that signals reach the right process."""
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "qlvbayes.app.worker", module,
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
            start_new_session=True, limit=_LONGEST,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        return cls(process)

    async def call(
        self, name: str, on_progress: OnProgress | None = None, /, **arguments: Any
    ) -> bytes:
        """Return the answer to a call, as JSON; raise RefusedError where it is an error."""
        number, future = next(self._numbers), asyncio.get_running_loop().create_future()
        line = {"number": number, "call": name, "arguments": arguments}
        line["reports"] = on_progress is not None
        self._calls[number] = future, on_progress
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(line).encode() + b"\n")
            await self._process.stdin.drain()
            return bytes(await future)
        except ConnectionError:
            raise gone() from None
        finally:
            self._calls.pop(number, None)

    async def _listen(self) -> None:
        """Pass on all that the process writes, until it ends; then no call waits any longer."""
        assert self._process.stdout is not None
        while line := await self._process.stdout.readline():
            number, kind, content = line.split(b" ", 2)
            future, on_progress = self._calls.get(int(number), (None, None))
            if future is None or future.done():
                continue
            if kind == b"answer":
                future.set_result(content)
            elif kind == b"error":
                error = json.loads(content)
                future.set_exception(RefusedError(error["status"], error["error"]))
            elif on_progress is not None:
                on_progress(json.loads(content))
        self.give_up()

    def give_up(self) -> None:
        """Answer all waiting calls with an error."""
        for future, _ in self._calls.values():
            if not future.done():
                future.set_exception(gone())

    async def kill(self) -> None:
        """End it at once, with all processes that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        await self._process.wait()

    async def close(self) -> None:
        """Let it end by itself, for a moment, then kill it."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            await asyncio.wait_for(self._process.wait(), _ENDS_WITHIN)
        except TimeoutError:
            await self.kill()


def gone() -> RefusedError:
    """Return the error of a call to a process that has ended."""
    return refused(503, "the process that computes this has stopped", "ask again in a moment")


class WarmWorker:
    """The worker that computes what the page shows.

    ``status`` is ``starting``, ``ready`` or ``restarting``; ``changed`` is called with each change.
    """

    def __init__(self, changed: Callable[[str], None]) -> None:
        self.status = "starting"
        self._changed = changed
        self._worker: Worker | None = None
        self._task: asyncio.Task[None] | None = None
        self._up = asyncio.Event()

    def start(self) -> None:
        """Spawn the worker; calls made meanwhile wait."""
        self._task = asyncio.create_task(self._run())

    async def close(self) -> None:
        """End the worker."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    def give_up(self) -> None:
        """Answer all waiting calls with an error."""
        if self._worker is not None:
            self._worker.give_up()

    async def call(self, name: str, /, **arguments: Any) -> bytes:
        """Return the answer of the worker, as JSON; raise RefusedError where there is none."""
        if self._worker is None:
            raise gone()
        return await self._worker.call(name, **arguments)

    async def patient_call(self, name: str, /, **arguments: Any) -> bytes:
        """Return the answer to a call for which no page waits: it is made again where one died."""
        for last in (False, True):
            await self._up.wait()
            try:
                return await self.call(name, **arguments)
            except RefusedError as error:
                if error.status != 503 or last:
                    raise
        raise AssertionError

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            begun = loop.time()
            worker = self._worker = await Worker.spawn("computations")
            self._up.set()
            try:
                with contextlib.suppress(RefusedError):
                    await worker.call("ready")
                    self._set("ready")
                await asyncio.shield(worker.ended)
            except asyncio.CancelledError:
                await worker.close()
                raise
            await worker.kill()
            self._up.clear()
            self._worker = None
            self._set("restarting")
            if loop.time() - begun < _QUICKLY:
                await asyncio.sleep(_PAUSE)

    def _set(self, status: str) -> None:
        self.status = status
        self._changed(status)
