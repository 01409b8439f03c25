"""Exchange calls and answers with a worker process over its pipes, a line each.

The server has a `Worker`, the process its `Parent`. A call is a line of JSON with its ``number``,
``call`` and ``arguments``, and whether it ``reports`` its progress. What comes back are lines of
``NUMBER KIND JSON``: one ``answer`` or ``error``, and before that any ``progress``. The process is
a new interpreter, never a fork, and ends when its standard input does.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Callable
from itertools import count
from typing import Any, BinaryIO

from qlvbayes.app.failures import RefusedError, refused

OnProgress = Callable[[dict[str, Any]], None]
"""Receiver of the progress of one call."""
_LONGEST = 2**26  # most bytes of a line
_ENDS_WITHIN = 2.0  # s that a process has to end by itself


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
        line = {
            "number": number,
            "call": name,
            "arguments": arguments,
            "reports": on_progress is not None,
        }
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


class Parent:
    """Connection of a process to the server that started it."""

    def __init__(self) -> None:
        self._in: BinaryIO = os.fdopen(os.dup(0), "rb")
        self._out: BinaryIO = os.fdopen(os.dup(1), "wb")
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(2, 1)
        self._lock = threading.Lock()

    def send(self, number: int, kind: str, content: bytes) -> None:
        """Write one line; end the process where nobody reads."""
        try:
            with self._lock:
                self._out.write(b"%d %s %s\n" % (number, kind.encode(), content))
                self._out.flush()
        except OSError:
            os._exit(0)

    def listen(self, heard: Callable[[dict[str, Any]], None]) -> None:
        """Pass on each line from a thread of its own; end the process where there are no more."""

        def loop() -> None:
            for line in self._in:
                heard(json.loads(line))
            sys.stderr.flush()
            os._exit(0)  # at once, whatever is being computed: the server has ended

        threading.Thread(target=loop, daemon=True).start()
