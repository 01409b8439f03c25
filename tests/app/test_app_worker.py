"""The worker's order: who moves a slider does not wait for a fit."""

import threading

import pytest

pytest.importorskip("msgspec")

from qlvbayes.app.worker import Worker

PATIENCE = 60.0  # s, for a thread to be heard


class Server:
    """Stands in for the server: hears answers in their order."""

    def __init__(self):
        self.heard, self.changed = [], threading.Condition()

    def listen(self, heard):
        self.ask = heard

    def send(self, line, payload=b""):
        with self.changed:
            self.heard.append(line.get("number", "ready"))
            self.changed.notify_all()

    def until(self, number):
        with self.changed:
            assert self.changed.wait_for(lambda: number in self.heard, PATIENCE)


@pytest.fixture
def busy():
    """A worker in the middle of a fit, which ends when it is let go."""
    server, begun, go = Server(), threading.Event(), threading.Event()

    def change():
        begun.set()
        assert go.wait(PATIENCE)
        return {}

    calls = {"change": change, "curves": lambda tab=None: {"rmse": 1.0}, "signature": dict}
    worker = Worker(server, calls, first={"curves"})
    threading.Thread(target=worker.run, daemon=True).start()
    server.until("ready")
    server.ask({"number": 1, "call": "change", "arguments": {}})
    assert begun.wait(PATIENCE)
    yield server, go
    go.set()


def test_a_move_is_answered_while_a_fit_goes_on(busy):
    server, go = busy
    server.ask({"number": 2, "call": "signature", "arguments": {}})
    server.ask({"number": 3, "call": "curves", "arguments": {}})
    server.until(3)
    assert server.heard == ["ready", 3]
    go.set()
    server.until(2)
    assert server.heard == ["ready", 3, 1, 2]
