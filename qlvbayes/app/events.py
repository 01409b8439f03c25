"""Send events of a session to every page that shows it (server-sent events)."""

from __future__ import annotations

import asyncio
import json
from collections import defaultdict
from collections.abc import AsyncIterator
from typing import Any

_WAITING = 1000  # events by which a page may lag before it is disconnected, and reconnects
_ALIVE = 15.0  # s between comments, which detect a dead connection


class Events:
    """Queues of events, one for each page that listens."""

    def __init__(self) -> None:
        self._listening: dict[str, set[asyncio.Queue[str | None]]] = defaultdict(set)

    def publish(self, session: str, event: str, data: Any) -> None:
        """Send an event to all pages of a session."""
        text = f"event: {event}\ndata: {json.dumps(data, allow_nan=False)}\n\n"
        for queue in list(self._listening[session]):
            if queue.qsize() < _WAITING:
                queue.put_nowait(text)
            else:
                self._listening[session].discard(queue)
                queue.put_nowait(None)

    def publish_all(self, event: str, data: Any) -> None:
        """Send an event to all pages."""
        for session in list(self._listening):
            self.publish(session, event, data)

    def close(self) -> None:
        """End every stream."""
        for queues in self._listening.values():
            for queue in queues:
                queue.put_nowait(None)

    async def stream(self, session: str) -> AsyncIterator[str]:
        """Yield the events for one page, until it leaves or the server ends."""
        queue: asyncio.Queue[str | None] = asyncio.Queue()
        self._listening[session].add(queue)
        try:
            yield "event: hello\ndata: {}\n\n"
            while True:
                try:
                    text = await asyncio.wait_for(queue.get(), _ALIVE)
                except TimeoutError:
                    yield ": still here\n\n"
                    continue
                if text is None:
                    return
                yield text
        finally:
            self._listening[session].discard(queue)
            if not self._listening[session]:
                del self._listening[session]
