"""A Dask scheduler and two workers on loopback, each a process of its own."""

import json
import os
import signal
import subprocess
import sys
import time

import h5py
import pytest
from support.endtoend import PADS, Listener, call, one_line, with_tests
from support.work import SlowStep, always_killed, killed_once, pads, squared

from qlvbayes.io.checks import InputError
from qlvbayes.parallel.engines import EngineLostError, opened_engine
from qlvbayes.parallel.running import run_all
from qlvbayes.pipeline.many import run_pads

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.integration,
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning"),
]
QUICK = ("--method", "least-squares", "--modes", "1", "--noise", "white", "--pads", "B,C")


class Dask:
    """A scheduler, and workers that a nanny starts again where they die."""

    def __init__(self, place, workers):
        note = place / "scheduler.json"
        path = os.pathsep.join(filter(None, sys.path))
        self.environment = {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"}
        self.scheduler = self._start(
            "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
            "--scheduler-file", note,
        )  # fmt: skip
        self.workers = self._start(
            "dask_worker", "--scheduler-file", note, "--nworkers", workers, "--nthreads", 1,
            "--no-dashboard", "--local-directory", place,
        )  # fmt: skip
        until = time.monotonic() + 300.0
        while not note.exists() and time.monotonic() < until:
            time.sleep(0.05)
        self.address = json.loads(note.read_text())["address"]

    def _start(self, module, *words):
        line = [sys.executable, "-m", f"distributed.cli.{module}", *map(str, words)]
        return subprocess.Popen(
            line, env=self.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def end(self):
        for process in (self.workers, self.scheduler):
            process.terminate()
            process.wait(60)


@pytest.fixture(scope="module")
def dask(tmp_path_factory):
    found = Dask(tmp_path_factory.mktemp("dask"), 2)
    yield found
    found.end()


@pytest.fixture
def engine(dask):
    with opened_engine(cluster=dask.address) as engine:
        yield engine


def answers(outcomes):
    return [(one.answer, one.fault) for one in outcomes]


def test_outcomes_are_those_of_one_process_and_a_killed_worker_loses_nothing(engine, tmp_path):
    alone = answers(run_all(squared, range(40)))
    assert answers(run_all(squared, range(40), engine)) == alone
    items = [(number, str(tmp_path)) for number in range(6)]
    assert answers(run_all(killed_once, items, engine)) == [(number, None) for number in range(6)]
    assert (tmp_path / "was killed").exists()


@pytest.mark.slow
def test_an_item_that_kills_every_worker_is_named(engine):
    found = list(run_all(always_killed, range(4), engine))
    assert [one.answer for one in found] == [0, 1, None, 3]
    assert "was killed, again and again" in found[2].fault.text


def content(path):
    """Return the content of a file: HDF5 leaves bytes of memory between its numbers."""
    if path.suffix == ".nc":
        with h5py.File(path) as file:
            names = []
            file.visit(names.append)
            sets = [name for name in names if isinstance(file[name], h5py.Dataset)]
            return {name: file[name][()].tobytes() for name in sets}
    if ".finished" in path.parts:  # with the digests of those files
        return json.loads(path.read_bytes())["key"]
    return path.read_bytes()


def test_a_fit_is_that_of_one_process(dask, tmp_path):
    file = with_tests(tmp_path / "some.csv", "B-20", "C-20")
    for place, words in (("one", ()), ("two", ("--cluster", dask.address))):
        out = tmp_path / place
        status, output, err = call("fit", file, "-o", out, *QUICK, *words, drawn=True)
        assert (status, err) == (0, "")
        assert f"results in {out}" in output
    one, two = (
        {path.relative_to(out).as_posix(): content(path)
         for path in out.rglob("*") if path.is_file() and path.name != "run.json"}
        for out in (tmp_path / "one", tmp_path / "two")
    )  # fmt: skip
    assert len([name for name in one if name.endswith("posterior.nc")]) == 2
    assert {name for name in one.keys() | two.keys() if one.get(name) != two.get(name)} == set()


def run_slowly(seconds, out, **options):
    step = SlowStep(seconds)
    run_pads(out, pads("A", "B", "slow"), lambda study: [step], size=3, **options)


def test_a_lost_scheduler_is_one_line_and_what_is_done_stays(tmp_path):
    own = Dask(tmp_path, 1)
    out = tmp_path / "out"
    listener = Killer(own.scheduler)
    try:
        with opened_engine(cluster=own.address) as engine, pytest.raises(EngineLostError) as failed:
            run_slowly(600.0, out, engine=engine, watcher=listener)
        assert str(failed.value).startswith(f"the Dask scheduler at {own.address} is lost; start")
        told = ("A: done", "A: there", "B: done", "B: there")
        assert listener.notices == [f"pad {x}" for x in told]
        assert not [path for path in out.iterdir() if path.name.startswith(".shared")]
        # a worker at work keeps its pad's folder locked until it has ended
        own.workers.terminate()
        own.workers.wait(120)
        again = Listener()  # as if the same command were given
        run_slowly(0.0, out, watcher=again)
        told = ("A: there", "B: there", "slow: done", "slow: there")
        assert again.notices == [f"pad {x}" for x in told]
    finally:
        for process in (own.workers, own.scheduler):
            process.send_signal(signal.SIGKILL)
            process.wait(60)


class Killer(Listener):
    """Kills the scheduler when two pads are done."""

    def __init__(self, scheduler):
        super().__init__()
        self.scheduler = scheduler

    def notice(self, *texts):
        super().notice(*texts)
        if len(self.notices) == 4:
            self.scheduler.send_signal(signal.SIGKILL)


def test_no_scheduler_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr("qlvbayes.parallel.engines._WAIT_S", 1.0)
    words = ("fit", PADS, "-o", tmp_path, *QUICK, "--cluster", "tcp://127.0.0.1:9")
    status, _, err = call(*words)
    assert status == 2
    assert one_line(err).startswith("no Dask scheduler answers at tcp://127.0.0.1:9; start it")
    with pytest.raises(InputError, match="no Dask scheduler answers"), opened_engine(cluster="?"):
        pass
    assert not list(tmp_path.iterdir())
