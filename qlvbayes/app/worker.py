"""Run a worker: a process that answers the calls of one module, in order of their urgency.

Two threads answer. Calls in the module's ``FIRST``, for which a slider or a first view waits,
precede all others: running fits leave Python free meanwhile. All other calls are
answered in turn, and long ones (held-out errors) continue between the calls, a piece at a time. Of
several waiting calls for curves from one tab only the last is computed.
"""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterator
from functools import partial
from importlib import import_module
from typing import Any, BinaryIO, NoReturn

import msgspec

from qlvbayes.app.failures import RefusedError, content_of, refused
from qlvbayes.io.checks import InputError
from qlvbayes.io.runtime import one_blas_thread

Request = dict[str, Any]
Pieces = Iterator[Any]
"""A computation in pieces: None while there is more, at last its answer."""

_ENCODER = msgspec.json.Encoder(enc_hook=float)  # numbers of numpy; those not finite become null


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


class RequestThread:
    """Thread of the worker that answers requests and does long work in pieces between them."""

    def __init__(self, parent: Parent, calls: dict[str, Callable[..., Any]]) -> None:
        self._parent = parent
        self._calls = calls
        self.arrived: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._waiting: deque[Request] = deque()
        self._pieces: deque[tuple[Request, Pieces]] = deque()

    def run(self) -> NoReturn:
        """Answer until the server has ended."""
        while True:
            block = not self._waiting and not self._pieces
            while block or not self.arrived.empty():
                self._waiting.append(self.arrived.get())
                block = False
            if self._waiting:
                request = self._waiting.popleft()
                self._go_on(request, self._work(request))
            else:
                self._go_on(*self._pieces.popleft())

    def _work(self, request: Request) -> Pieces:
        """Yield None while there is more to do, and at last the answer."""
        if self._overtaken(request):
            raise refused(409, "overtaken")
        arguments = request["arguments"]
        if request["reports"]:
            arguments["report"] = partial(self._send, request["number"], "progress")
        answer = self._calls[request["call"]](**arguments)
        if isinstance(answer, Iterator):
            yield None  # other calls come first
            yield from answer
        yield {} if answer is None else answer

    def _go_on(self, request: Request, pieces: Pieces) -> None:
        """Do a piece of some work; send the answer or the error, if it is the last."""
        try:
            answer = next(pieces)
        except Exception as error:  # one bad call must not end the worker
            if not isinstance(error, RefusedError):
                status = 422 if isinstance(error, InputError) else 500
                error = RefusedError(status, content_of(error))
            self._send(request["number"], "error", {"status": error.status, "error": error.content})
            return
        if answer is None:
            self._pieces.append((request, pieces))
        else:
            self._send(request["number"], "answer", answer)

    def _overtaken(self, request: Request) -> bool:
        """Return whether a later call of the same tab for curves waits."""
        tab = request["arguments"].get("tab")
        return bool(tab) and any(
            other["call"] == request["call"] and other["arguments"].get("tab") == tab
            for other in self._waiting
        )

    def _send(self, number: int, kind: str, content: Any) -> None:
        self._parent.send(number, kind, _ENCODER.encode(content))


def serve(parent: Parent, calls: dict[str, Callable[..., Any]], first: Collection[str]) -> None:
    """Answer calls until the server has ended, those in ``first`` before the others."""
    answers: dict[str, Callable[..., Any]] = {"ready": dict, **calls}
    urgent, other = (RequestThread(parent, answers) for _ in range(2))
    threading.Thread(target=urgent.run, daemon=True).start()
    at_once = {"ready", *first}
    parent.listen(lambda x: (urgent if x["call"] in at_once else other).arrived.put(x))
    other.run()


def main() -> None:
    """Answer the calls of the module that is named, until the server has ended."""
    parent = Parent()
    module = import_module(f"qlvbayes.app.{sys.argv[1]}")
    os.nice(module.NICE)
    with one_blas_thread():
        serve(parent, module.CALLS, module.FIRST)


if __name__ == "__main__":
    main()
