"""One task for many: the same whatever works; what fails or dies costs the others nothing."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import count, islice, product

import pytest
from support.work import always_killed, killed_once, process_of, squared

from qlvbayes.io.checks import InputError
from qlvbayes.parallel import running
from qlvbayes.parallel.engines import engine_of, opened_engine
from qlvbayes.parallel.running import FailedError, Fault, Outcome, Shard, fault_of, run_all


@pytest.fixture(scope="module")
def processes():
    with opened_engine(2) as engine:
        yield engine


def answers(outcomes):
    return [(one.answer, one.fault) for one in outcomes]


def test_outcomes_come_in_order_whatever_works(processes):
    alone = answers(run_all(squared, range(8)))
    assert [answer for answer, _ in alone] == [0, 1, 4, None, 16, None, 36, 49]
    assert alone[3][1] == Fault("numbers.csv, line 7: three cannot be used; use another")
    assert alone[5][1].text.startswith("internal error (ValueError: five is odd)")
    assert alone[5][1].status == 1
    kept = []
    assert answers(run_all(squared, range(8), processes, keep=kept.append)) == alone
    assert sorted(one.item for one in kept) == list(range(8))
    with ThreadPoolExecutor(2) as executor:
        assert answers(run_all(squared, range(8), engine_of(executor))) == alone
    items = [1, Fault("cannot be read"), 2, Outcome("known", 7), 4]
    for engine in (None, processes):
        found = answers(run_all(squared, items, engine))
        assert [answer for answer, _ in found] == [1, None, 4, 7, 16]
        assert found[1][1] == Fault("cannot be read")


def test_items_are_taken_as_they_are_needed(processes):
    taken = []

    def endless():
        for number in count(10):
            taken.append(number)
            yield number

    found = list(islice(run_all(squared, endless(), processes), 5))
    assert [one.answer for one in found] == [100, 121, 144, 169, 196]
    # outcomes wait for that of an item before them, but no more than so many
    assert len(taken) <= 5 + processes.ahead() + running._WAITING


def test_a_worker_killed_loses_nothing_and_an_item_that_kills_its_workers_is_named(
    processes, tmp_path
):
    items = [(number, str(tmp_path)) for number in range(6)]
    found = answers(run_all(killed_once, items, processes))
    assert found == [(number, None) for number in range(6)]
    assert (tmp_path / "was killed").exists()
    found = list(run_all(always_killed, range(5), processes))
    assert [one.answer for one in found] == [0, 1, None, 3, 4]
    assert "was killed, again and again" in found[2].fault.text


BEGIN = """
import signal, time
from support.work import lasting, process_of
from qlvbayes.parallel.engines import opened_engine
from qlvbayes.parallel.running import run_all
if __name__ == "__main__":
"""


def script_of(lines, **options):
    """A process that runs these lines, which may use an engine of two processes."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.Popen(
        [sys.executable, "-c", BEGIN + lines],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, **options,
    )  # fmt: skip


def test_processes_are_spawned_and_end_with_their_parent():
    """Also where it is killed, so that nothing is left to end them."""
    parent = script_of("""
    with opened_engine(2) as engine:
        print(*[one.answer for one in run_all(process_of, range(1), engine)], flush=True)
        time.sleep(600)
""")
    with parent:
        worker = int(parent.stdout.readline())
        assert worker not in (parent.pid, os.getpid())
        parent.send_signal(signal.SIGKILL)
    until = time.monotonic() + 30.0
    while alive(worker) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(worker)


def test_ctrl_c_ends_all_at_once_and_is_quiet():
    # what is begun in the background of a shell ignores it, and so would its processes
    lines = """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with opened_engine(2) as engine:
            list(run_all(lasting, range(2), engine))
    except KeyboardInterrupt:
        print('stopped')
"""
    parent = script_of(lines, start_new_session=True)
    with parent:
        assert [parent.stdout.readline() for _ in range(2)] == ["begun\n"] * 2
        os.killpg(parent.pid, signal.SIGINT)  # as a terminal does: workers hear it too
        out, err = parent.communicate(timeout=60.0)
    assert (out, err, parent.returncode) == ("stopped\n", "", 0)


def alive(process):
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_one_process_does_it_here_and_a_list_does_not():
    assert process_of(0) == os.getpid()
    with opened_engine(1) as engine:
        assert engine is None
        assert [one.answer for one in run_all(process_of, range(2), engine)] == [os.getpid()] * 2
    with pytest.raises(InputError, match="a list takes no work"):
        engine_of([])


def test_shards_are_everything_once_and_written_or_slurms(monkeypatch):
    for total, parts in product((0, 1, 7, 12), (1, 3, 5)):
        found = [Shard(place, parts).part(range(total)) for place in range(1, parts + 1)]
        assert sorted(item for part in found for item in part) == list(range(total))
        assert max(map(len, found)) - min(map(len, found)) <= 1
    assert Shard.from_text(" 3/200 ") == Shard(3, 200)
    for text in ("0/2", "3/2", "a/2", "3", "3/", "1/0", "-1/2"):
        with pytest.raises(InputError):
            Shard.from_text(text)
    with pytest.raises(InputError, match="SLURM_ARRAY_TASK_ID is not set"):
        Shard.from_text("slurm")
    for name, value in (("ID", "7"), ("MIN", "5"), ("COUNT", "4")):
        monkeypatch.setenv(f"SLURM_ARRAY_TASK_{name}", value)
    assert Shard.from_text("slurm") == Shard(3, 4)
    assert Shard.from_text("slurm/200") == Shard(3, 200)
    monkeypatch.setenv("SLURM_ARRAY_TASK_ID", "20")
    with pytest.raises(InputError, match="has gaps"):
        Shard.from_text("slurm")


def test_faults_are_lines_and_those_alike_are_one():
    alike = [Fault("no space", of=f"pad {name}") for name in "AB"]
    assert FailedError(alike, 2).lines == ["no space"]
    assert FailedError(alike, 5).lines == ["pad A, pad B: no space", "2 of 5 failed; 3 are done"]
    mixed = [*alike, fault_of(KeyError("x"))]
    assert FailedError(mixed, 3).status == 1
    assert FailedError(alike, 3).status == 2
    many = [Fault("no", of=str(k)) for k in range(30)]
    assert "19 and 10 more: no" in FailedError(many, 40).lines[0]
    assert fault_of(OSError(28, "No space left", "x.csv")).text == (
        "x.csv: No space left; free some space"
    )
