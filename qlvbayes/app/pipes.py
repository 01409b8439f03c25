"""Spawn a Python process, and exchange JSON lines with it over its pipes.

The server has a `Process`; the process has its `Parent`. It is a new interpreter, never a fork. It
ends when its standard input does, so that no process outlives the server.
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

_LONGEST = 2**26  # most bytes of a line from a process: a long error, never a curve
_ENDS_WITHIN = 2.0  # s that a process has to end by itself


class Process:
    """Process that runs a module of the package in a Python interpreter of its own."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def spawn(cls, module: str, *arguments: str) -> Process:
        """Start it in a session of its own, so that signals reach the right process."""
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
        """Return the process id."""
        return self._process.pid

    async def write(self, content: Any) -> None:
        """Write one line of JSON; raise ConnectionError where the process has ended."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(content).encode() + b"\n")
        await self._process.stdin.drain()

    async def read(self) -> dict[str, Any] | None:
        """Return the next line, or None at the end."""
        assert self._process.stdout is not None
        line = await self._process.stdout.readline()
        content: dict[str, Any] | None = json.loads(line) if line else None
        return content

    async def take(self, size: int) -> bytes:
        """Return the bytes that follow a line."""
        assert self._process.stdout is not None
        return await self._process.stdout.readexactly(size)

    async def kill(self) -> None:
        """End it at once, with all processes that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        await self._process.wait()

    async def close(self) -> None:
        """Let it end by itself, for a moment, then kill it."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            await asyncio.wait_for(self._process.wait(), _ENDS_WITHIN)
        except TimeoutError:
            await self.kill()

    async def wait(self) -> int:
        """Wait until it has ended; return its exit status, negative for a signal."""
        return await self._process.wait()


class Parent:
    """Connection of a process to the server that started it."""

    def __init__(self) -> None:
        self._in: BinaryIO = os.fdopen(os.dup(0), "rb")
        self._out: BinaryIO = os.fdopen(os.dup(1), "wb")
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(2, 1)
        self._lock = threading.Lock()

    def send(self, content: dict[str, Any], payload: bytes = b"") -> None:
        """Write one line of JSON, and bytes that follow it; end the process where nobody reads."""
        line = json.dumps(content, allow_nan=False).encode() + b"\n"
        try:
            with self._lock:
                self._out.write(line + payload)
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
