"""Run the worker: one warm process that computes what the page asks for.

Two threads answer. Calls that a slider or a first view waits for precede all others: running fits
and compilations leave Python free meanwhile. All other calls are answered in turn, and long ones
(held-out errors) continue between the calls, a piece at a time. Of several waiting calls for curves
from one tab only the last is computed.
"""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterator
from typing import Any, NoReturn

import msgspec

from qlvbayes.app.computations import CALLS, FIRST
from qlvbayes.app.failures import RefusedError, content_of, refused
from qlvbayes.app.pipes import Parent
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
        self._arrived: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._waiting: deque[Request] = deque()
        self._pieces: deque[tuple[Request, Pieces]] = deque()

    def put(self, request: Request) -> None:
        """Append a request to those that wait."""
        self._arrived.put(request)

    def run(self) -> NoReturn:
        """Answer until the server has ended."""
        while True:
            self._gather(block=not self._waiting and not self._pieces)
            if self._waiting:
                self._answer(self._waiting.popleft())
            elif self._pieces:
                self._go_on(*self._pieces.popleft())

    def _gather(self, *, block: bool) -> None:
        """Take over all requests that have arrived meanwhile."""
        while True:
            try:
                self._waiting.append(self._arrived.get(block=block))
            except queue.Empty:
                return
            block = False

    def _answer(self, request: Request) -> None:
        if self._overtaken(request):
            self._fail(request, refused(409, "overtaken"))
            return
        try:
            answer = self._calls[request["call"]](**request["arguments"])
        except Exception as error:  # one bad call must not end the worker
            self._fail(request, error)
            return
        if isinstance(answer, Iterator):
            self._pieces.append((request, answer))
        else:
            self._succeed(request, answer)

    def _go_on(self, request: Request, pieces: Pieces) -> None:
        try:
            answer = next(pieces)
        except Exception as error:
            self._fail(request, error)
            return
        if answer is None:
            self._pieces.append((request, pieces))
        else:
            self._succeed(request, answer)

    def _overtaken(self, request: Request) -> bool:
        """Return whether a later call of the same tab for curves waits."""
        tab = request["arguments"].get("tab")
        return bool(tab) and any(
            other["call"] == request["call"] and other["arguments"].get("tab") == tab
            for other in self._waiting
        )

    def _succeed(self, request: Request, answer: Any) -> None:
        payload = _ENCODER.encode(answer)
        self._parent.send({"number": request["number"], "bytes": len(payload)}, payload)

    def _fail(self, request: Request, error: Exception) -> None:
        line = {"number": request["number"], "bytes": 0, "status": 500}
        if isinstance(error, RefusedError):
            line |= {"status": error.status, "error": error.content}
        else:
            status = 422 if isinstance(error, InputError) else 500
            line |= {"status": status, "error": content_of(error)}
        self._parent.send(line)


class Worker:
    """Worker with two threads for requests; calls in ``first`` precede the others."""

    def __init__(
        self, parent: Parent, calls: dict[str, Callable[..., Any]], first: Collection[str]
    ) -> None:
        self._parent = parent
        self._first = first
        self._threads = {True: RequestThread(parent, calls), False: RequestThread(parent, calls)}

    def run(self) -> None:
        """Answer until the server has ended."""
        threading.Thread(target=self._threads[True].run, daemon=True).start()
        self._parent.listen(self._sort)
        self._parent.send({"ready": True})
        self._threads[False].run()

    def _sort(self, request: Request) -> None:
        self._threads[request["call"] in self._first].put(request)


def main() -> None:
    """Answer until the server has ended."""
    parent = Parent()
    with one_blas_thread():
        Worker(parent, CALLS, FIRST).run()


if __name__ == "__main__":
    main()
