"""Work on threads: in order, nested work one after the other, errors raised."""

import threading

import pytest

from qlvbayes.inference import together as module
from qlvbayes.inference.together import alone, together


@pytest.fixture(autouse=True)
def two_processors(monkeypatch):
    monkeypatch.setattr(module, "_processors", lambda: 2)


def test_results_come_in_the_order_of_the_items():
    assert together(lambda x: x * x, range(20)) == [x * x for x in range(20)]
    assert together(lambda x: x, []) == []


def test_two_items_are_worked_on_at_once():
    meeting = threading.Barrier(2, timeout=20.0)
    assert sorted(together(lambda _: meeting.wait(), range(2))) == [0, 1]


def test_work_within_work_stays_on_its_thread():
    def outer(_):
        return {threading.get_ident(), *together(lambda _: threading.get_ident(), range(3))}

    assert all(len(threads) == 1 for threads in together(outer, range(2)))


def test_a_thread_that_is_to_be_alone_starts_no_others():
    found = []

    def work():
        alone()
        found.extend(together(lambda _: threading.get_ident(), range(3)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert set(found) == {thread.ident}


def test_an_error_reaches_the_caller():
    def work(x):
        if x == 3:
            raise ValueError("three")
        return x

    with pytest.raises(ValueError, match="three"):
        together(work, range(6))
