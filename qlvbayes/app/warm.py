"""Keep one worker warm for the page: start it anew where it dies."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from qlvbayes.app.failures import RefusedError
from qlvbayes.app.protocol import Worker, gone

MODULE = "computations"
_QUICKLY = 5.0  # s: a worker that dies within this time is restarted after a pause
_PAUSE = 2.0  # s before such a restart


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
            worker = self._worker = await Worker.spawn(MODULE)
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
