"""A process of our own kind, spawned: a new interpreter, never a fork, JSON lines over its pipes.

The server has a `Process`; the process has its `Parent`.
It ends when its standard input does, so that nothing outlives the server.
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
from typing import Any, BinaryIO

_LONGEST = 2**26  # bytes of a line from a process: a long error, never a curve
_ENDS_WITHIN = 2.0  # s that a process has to go by itself


class Process:
    """One interpreter that runs a module of the package."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def spawn(cls, module: str, *arguments: str) -> Process:
        """In a session of its own, so that Ctrl-C and cancelling reach what they are meant for."""
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            module,
            *arguments,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            start_new_session=True,
            limit=_LONGEST,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
        return cls(process)

    @property
    def pid(self) -> int:
        """Of the interpreter."""
        return self._process.pid

    async def write(self, content: Any) -> None:
        """One line of JSON; ConnectionError where the process has gone."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(content).encode() + b"\n")
        await self._process.stdin.drain()

    async def read(self) -> dict[str, Any] | None:
        """The next line, None at the end."""
        assert self._process.stdout is not None
        line = await self._process.stdout.readline()
        found: dict[str, Any] | None = json.loads(line) if line else None
        return found

    async def take(self, size: int) -> bytes:
        """So many bytes that follow a line; IncompleteReadError where the process has gone."""
        assert self._process.stdout is not None
        return await self._process.stdout.readexactly(size)

    async def kill(self) -> None:
        """At once, with all that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        await self._process.wait()

    async def close(self) -> None:
        """Let it end by itself, for a moment."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            await asyncio.wait_for(self._process.wait(), _ENDS_WITHIN)
        except TimeoutError:
            await self.kill()

    async def wait(self) -> int:
        """Until it has gone; its exit status, negative by a signal."""
        return await self._process.wait()


class Parent:
    """The server, as its processes see it.

    Standard output becomes standard error, so that nothing printed is taken for an answer.
    """

    def __init__(self) -> None:
        self._in: BinaryIO = os.fdopen(os.dup(0), "rb")
        self._out: BinaryIO = os.fdopen(os.dup(1), "wb")
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(2, 1)
        self._lock = threading.Lock()

    def tell(self, content: dict[str, Any], payload: bytes = b"") -> None:
        """One line of JSON, and bytes that follow it; the process ends where nobody reads."""
        line = json.dumps(content, allow_nan=False).encode() + b"\n"
        try:
            with self._lock:
                self._out.write(line + payload)
                self._out.flush()
        except OSError:
            os._exit(0)

    def listen(self, heard: Callable[[dict[str, Any]], None]) -> None:
        """Hand over each line from a thread of its own; end the process where there are no more."""

        def loop() -> None:
            for line in self._in:
                heard(json.loads(line))
            sys.stderr.flush()
            os._exit(0)  # at once, whatever is being computed: the server has gone

        threading.Thread(target=loop, daemon=True).start()
