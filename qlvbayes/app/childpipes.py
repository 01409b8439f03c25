"""The other end of `pipes`: what a spawned process reads and writes."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable
from typing import Any, BinaryIO


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
