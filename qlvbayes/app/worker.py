"""Run a worker: a process that answers the calls of one module, in order of their urgency.

Two threads answer. Calls in the module's ``FIRST``, for which a slider or a first view waits,
precede all others: running fits leave Python free meanwhile. All other calls are
answered in turn, and long ones (held-out errors) continue between the calls, a piece at a time. Of
several waiting calls for curves from one tab only the last is computed.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterator
from functools import partial
from importlib import import_module
from typing import Any, NoReturn

import msgspec

from qlvbayes.app.failures import RefusedError, content_of, refused
from qlvbayes.app.protocol import Parent
from qlvbayes.io.checks import InputError
from qlvbayes.io.runtime import one_blas_thread

Request = dict[str, Any]
Pieces = Iterator[Any]
"""A computation in pieces: None while there is more, at last its answer."""

_ENCODER = msgspec.json.Encoder(enc_hook=float)  # numbers of numpy; those not finite become null


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
                self._answer(self._waiting.popleft())
            else:
                request, pieces = self._pieces.popleft()
                self._reply(request, partial(next, pieces), pieces)

    def _answer(self, request: Request) -> None:
        arguments = request["arguments"]
        if request["reports"]:
            arguments["report"] = partial(self._send, request["number"], "progress")
        self._reply(request, lambda: self._calls[request["call"]](**arguments))

    def _reply(
        self, request: Request, work: Callable[[], Any], pieces: Pieces | None = None
    ) -> None:
        """Send the answer or the error of some work, or note the work as one to be continued."""
        try:
            if self._overtaken(request):
                raise refused(409, "overtaken")
            answer = work()
        except Exception as error:  # one bad call must not end the worker
            if not isinstance(error, RefusedError):
                status = 422 if isinstance(error, InputError) else 500
                error = RefusedError(status, content_of(error))
            self._send(request["number"], "error", {"status": error.status, "error": error.content})
            return
        if isinstance(answer, Iterator):
            self._pieces.append((request, answer))
        elif pieces is not None and answer is None:
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


class CallServer:
    """Worker with two threads for requests; calls in ``first`` precede the others."""

    def __init__(
        self, parent: Parent, calls: dict[str, Callable[..., Any]], first: Collection[str]
    ) -> None:
        self._parent = parent
        self._first = {"ready", *first}
        answers: dict[str, Callable[..., Any]] = {"ready": dict, **calls}
        self._threads = {urgent: RequestThread(parent, answers) for urgent in (True, False)}

    def run(self) -> None:
        """Answer until the server has ended."""
        threading.Thread(target=self._threads[True].run, daemon=True).start()
        self._parent.listen(lambda x: self._threads[x["call"] in self._first].arrived.put(x))
        self._threads[False].run()


def main() -> None:
    """Answer the calls of the module that is named, until the server has ended."""
    parent = Parent()
    module = import_module(f"qlvbayes.app.{sys.argv[1]}")
    os.nice(module.NICE)
    with one_blas_thread():
        CallServer(parent, module.CALLS, module.FIRST).run()


if __name__ == "__main__":
    main()
