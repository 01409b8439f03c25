"""A process of our own kind, spawned: a new interpreter, never a fork, JSON lines over its pipes.

It ends when its standard input does, so that nothing outlives the server.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
from typing import Any

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
