"""A worker's order, what long work reports to the server, and with which model it works."""

import threading
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("msgspec")

from qlvbayes.app import steps
from qlvbayes.app.steps import ProgressReporter, choices_of
from qlvbayes.app.worker import serve
from qlvbayes.diagnosis.decision import Decision
from qlvbayes.diagnosis.diagnose import SearchProgress, StopSearch
from qlvbayes.inference.forward.hypothesis import Hypothesis

PATIENCE = 60.0  # s, for a thread to be heard
BASE = {("hertz", "prony:2"): 0.6, ("hertz", "fung"): 0.3, ("linear", "fung"): 0.1}
KNOWN = Decision("ambiguous", (), (), {"friction": 0.2, "viscous_drag": 0.7}, BASE, 0.0, 0)
STANDING = SearchProgress("effects", 3, Hypothesis("hertz", "prony:2"), KNOWN)


class Server:
    """Stands in for the server: hears answers in their order."""

    def __init__(self):
        self.heard, self.changed = [], threading.Condition()

    def listen(self, heard):
        self.ask = lambda number, call: heard(
            {"number": number, "call": call, "arguments": {}, "reports": call == "told"}
        )

    def send(self, number, kind, content):
        with self.changed:
            self.heard.append((number, kind))
            self.changed.notify_all()

    def until(self, *answer):
        with self.changed:
            assert self.changed.wait_for(lambda: answer in self.heard, PATIENCE)


def test_a_move_is_answered_while_a_fit_goes_on():
    server, begun, go = Server(), threading.Event(), threading.Event()

    def change():
        begun.set()
        assert go.wait(PATIENCE)

    def told(report):
        report({"text": "half"})

    calls = {"change": change, "curves": dict, "told": told, "pieces": lambda: iter([None, {}])}
    parent = SimpleNamespace(send=server.send, listen=server.listen)
    threading.Thread(target=serve, args=(parent, calls, {"curves"}), daemon=True).start()
    while not hasattr(server, "ask"):
        time.sleep(0.01)
    server.ask(1, "change")
    assert begun.wait(PATIENCE)
    for number, call in ((2, "pieces"), (3, "told"), (4, "none"), (5, "curves")):
        server.ask(number, call)
    server.until(5, "answer")
    assert server.heard == [(5, "answer")]
    go.set()
    server.until(2, "answer")
    others = [(1, "answer"), (3, "progress"), (3, "answer"), (4, "error"), (2, "answer")]
    assert server.heard[1:] == others  # what is done in pieces comes last


@pytest.fixture
def reporter():
    lines = []
    watcher = ProgressReporter(lines.append)
    with watcher.reporting():
        yield watcher, lines


def test_a_chain_tells_how_far_it_is_and_what_is_left(reporter):
    watcher, lines = reporter
    with watcher.sampling("pad B: emcee") as progress:
        progress(200, 100)  # more is found to be done
        while not any(line["done"] for line in lines):
            time.sleep(0.05)
    line = next(line for line in lines if line["done"])
    assert (line["text"], line["done"], line["total"]) == ("pad B: emcee", 200, 200)
    assert line["left_s"] == 0.0


def test_a_search_tells_the_probabilities_so_far_and_ends_once_when_that_is_enough(reporter):
    """The probabilities of a law are summed over the other law of each pair."""
    watcher, lines = reporter
    watcher.searched("B", STANDING)
    found = next(line["probabilities"] for line in lines if "probabilities" in line)
    assert [one["effect"] for one in found["ranking"]] == ["viscous_drag", "friction"]
    assert found["laws"]["elastic"] == pytest.approx({"hertz": 0.9, "linear": 0.1})
    assert found["laws"]["relaxation"] == pytest.approx({"prony:2": 0.6, "fung": 0.4})
    steps.enough()
    with pytest.raises(StopSearch):
        watcher.searched("B", STANDING)
    watcher.searched("B", STANDING)
    assert sum("probabilities" in line for line in lines) == 3


def test_a_job_samples_the_model_on_the_bench():
    model = {"elastic": "hertz", "relaxation": "prony:3", "effects": ["friction"]}
    choices = choices_of(model, True, None)
    found = choices.elastic, choices.relaxing, choices.effects, choices.bonded
    assert found == ("hertz", "prony:3", ("friction",), True)
    assert choices_of({**model, "relaxation": "fung"}, False, None).relaxing == "fung"
