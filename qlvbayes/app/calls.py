"""Send calls to the worker and wait for their answers; restart the worker if it dies."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from itertools import count
from typing import Any

from qlvbayes.app.failures import RefusedError, refused
from qlvbayes.app.pipes import Process

MODULE = "qlvbayes.app.worker"
_QUICKLY = 5.0  # s: a worker that dies within this time is restarted after a pause
_PAUSE = 2.0  # s before such a restart


class Calls:
    """Calls to one warm worker process, which is started anew where it dies.

    ``status`` is ``starting``, ``ready`` or ``restarting``; ``changed`` is called with each change.
    """

    def __init__(self, changed: Callable[[str], None]) -> None:
        self.status = "starting"
        self._changed = changed
        self._process: Process | None = None
        self._numbers = count()
        self._waiting: dict[int, asyncio.Future[bytes]] = {}
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
        if self._process is not None:
            await self._process.close()

    def give_up(self) -> None:
        """Answer all waiting calls with an error, as there is no worker."""
        for future in self._waiting.values():
            if not future.done():
                future.set_exception(_gone())

    @property
    def pid(self) -> int | None:
        """Return the process id of the worker, while there is one."""
        return None if self._process is None else self._process.pid

    async def call(self, name: str, /, **arguments: Any) -> bytes:
        """Return the answer of the worker, as JSON."""
        if self._process is None:
            raise _gone()
        number = next(self._numbers)
        future: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        self._waiting[number] = future
        try:
            await self._process.write({"number": number, "call": name, "arguments": arguments})
            return await future
        except ConnectionError:
            raise _gone() from None
        finally:
            self._waiting.pop(number, None)

    async def up(self) -> None:
        """Wait until there is a worker, which may still be starting."""
        await self._up.wait()

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            begun = loop.time()
            self._process = await Process.spawn(MODULE)
            self._up.set()
            try:
                await self._listen(self._process)
            finally:
                await self._process.kill()
            self._up.clear()
            self._process = None
            self._set("restarting")
            self.give_up()
            if loop.time() - begun < _QUICKLY:
                await asyncio.sleep(_PAUSE)

    async def _listen(self, process: Process) -> None:
        """Read all that the worker writes, until it ends."""
        while True:
            line = await process.read()
            if line is None:
                return
            if line.get("ready"):
                self._set("ready")
                continue
            try:
                payload = await process.take(line["bytes"])
            except asyncio.IncompleteReadError:
                return
            future = self._waiting.get(line["number"])
            if future is None or future.done():
                continue
            if "error" in line:
                future.set_exception(RefusedError(line["status"], line["error"]))
            else:
                future.set_result(payload)

    def _set(self, status: str) -> None:
        self.status = status
        self._changed(status)


def _gone() -> RefusedError:
    return refused(503, "the worker has stopped and is being started anew", "ask again in a moment")
