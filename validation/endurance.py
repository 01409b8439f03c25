"""Give damaged files to every reader and kill runs, and count what survives.

`endurance.py inputs --count 100000` damages files of every layout and of the package's own kinds at
random, and gives each to the reader, to `convert` and to the first look. An answer, or one plain
refusal, is right; any other exception, more than five seconds of CPU, or the death of the process
is counted as a failure and its input is kept in build/endurance. `endurance.py kills --count 50`
kills `fit`, `study` and a run of two processes with SIGKILL at random moments, up to four times in
a row, runs the same command again, and compares all that is left with what a calm run leaves.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import json
import os
import random
import select
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType

import h5py
import numpy as np
from mutations import mutated
from results import ROOT, Origin, Table

from qlvbayes.pipeline.steps import digest_of

KEPT = ROOT / "build" / "endurance"
SLOW_S = 5.0
"""Of CPU time: a damaged file of a few hundred kilobytes that takes longer is a failure."""
_DEAD_S = 60.0  # without a word from the worker: it hangs in a library that no signal interrupts
_QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
_LOOKED = 5  # every so many inputs that were read are also prepared and looked at


class SlowError(BaseException):
    """More than five seconds of CPU: no ``except Exception`` may catch it."""


def seeds() -> list[tuple[str, bytes]]:
    """Return the names and contents of the sound files: a layout each, and the bundled data."""
    sys.path.insert(0, str(ROOT / "tests"))
    from support.machine_files import FIXTURES  # two files of each layout and more

    files = [(fixture.path.name, fixture.path.read_bytes()) for fixture in FIXTURES]
    rows = (ROOT / "data" / "pads.csv").read_bytes().splitlines(keepends=True)
    tidy = b"".join([rows[0], *rows[1::40]])
    return [*files, ("tidy.csv", tidy), ("tidy.csv.gz", gzip.compress(tidy, mtime=0))]


def input_of(number: int, files: list[tuple[str, bytes]]) -> tuple[str, bytes]:
    """Return the name and content of a damaged file: the same for the same number."""
    rng = np.random.default_rng(number)
    name, data = files[int(rng.integers(len(files)))]
    return name, mutated(data, rng)


def attempt(path: Path, number: int) -> str:
    """Give one file to all readers, and return what became of it."""
    from qlvbayes.io.checks import InputError
    from qlvbayes.io.conversion import convert
    from qlvbayes.io.data import read_measurements
    from qlvbayes.io.loading import Answers
    from qlvbayes.motion.experiment import prepare
    from qlvbayes.report.firstlook import look_at

    outcomes = []
    try:
        study = read_measurements(path)
        outcomes.append("read")
        if number % _LOOKED == 0:
            for pad in study.pads[:2]:
                look_at(prepare(pad), bonded=False)
            outcomes[-1] = "looked at"
    except InputError:
        outcomes.append("refused")
    try:
        convert([path], Answers())
        outcomes.append("converted")
    except InputError:
        outcomes.append("refused")
    return ", ".join(outcomes)


def work(start: int, stop: int) -> None:
    """Try inputs in this process, and say of each what became of it, a JSON line each."""
    files = seeds()

    def slow(signum: int, frame: FrameType | None) -> None:
        raise SlowError

    signal.signal(signal.SIGPROF, slow)
    with TemporaryDirectory() as folder:
        for number in range(start, stop):
            name, data = input_of(number, files)
            path = Path(folder) / name
            path.write_bytes(data)
            begun = time.process_time()
            signal.setitimer(signal.ITIMER_PROF, SLOW_S)
            try:
                outcome, detail = attempt(path, number), ""
            except SlowError:
                outcome, detail = "slow", "".join(traceback.format_exc(limit=-6))
            except Exception as error:
                outcome, detail = type(error).__name__, "".join(traceback.format_exc(limit=-4))
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
            took = time.process_time() - begun
            line = {"number": number, "name": name, "outcome": outcome, "s": took}
            print(json.dumps(line | {"detail": detail}), flush=True)
            left = [other.name for other in Path(folder).iterdir() if other != path]
            if left:
                print(json.dumps(line | {"outcome": "left files", "detail": str(left)}), flush=True)
            shutil.rmtree(folder)
            Path(folder).mkdir()


_RIGHT = ("read", "looked at", "refused", "converted")


def is_right(outcome: str) -> bool:
    """Return whether every part of an outcome is an answer or a plain refusal."""
    return all(part in _RIGHT for part in outcome.split(", "))


def attempts(start: int, stop: int) -> Iterator[dict]:
    """Run a worker over inputs; where it dies or hangs, say so and go on behind that input."""
    while start < stop:
        command = [sys.executable, __file__, "work", str(start), str(stop)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                              start_new_session=True) as worker:  # fmt: skip
            assert worker.stdout is not None
            try:
                for line in _lines(worker.stdout.fileno()):
                    result = json.loads(line)
                    start = result["number"] + 1
                    yield result
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(worker.pid, signal.SIGKILL)
        if start < stop:
            died = {"number": start, "name": "", "outcome": "died or hung", "s": _DEAD_S}
            yield died | {"detail": ""}
            start += 1


def _lines(pipe: int) -> Iterator[bytes]:
    """Yield lines of a pipe until it ends or is silent for too long."""
    rest = b""
    while select.select([pipe], [], [], _DEAD_S)[0]:
        if not (more := os.read(pipe, 1 << 16)):
            return
        *lines, rest = (rest + more).split(b"\n")
        yield from lines


INPUTS = ("damaged files", "refused in one line", "read", "ended otherwise", "slowest, s of CPU")
KILLS = ("command", "kills", "runs that ended after them", "runs that left the same files")


def run_inputs(first: int, count: int, origin: Origin) -> None:
    """Try so many inputs and keep their counts, and the files that failed.

    Where it is stopped (SIGTERM, Ctrl-C) it keeps those of the inputs tried until then.
    """
    counts: Counter[str] = Counter()
    slowest = 0.0
    files = seeds()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        for result in attempts(first, first + count):
            counts[result["outcome"]] += 1
            slowest = max(slowest, result["s"])
            if not is_right(result["outcome"]):
                _keep_failed(result, files)
            if sys.stderr.isatty():
                print(f"\r{counts.total()} of {count}", end="", file=sys.stderr)
    refused = sum(n for outcome, n in counts.items() if outcome.startswith("refused"))
    wrong = sum(n for outcome, n in counts.items() if not is_right(outcome))
    tried = counts.total(), refused, counts.total() - refused - wrong, wrong
    Table(origin, counts.total(), INPUTS, [[*map(str, tried), f"{slowest:.1f}"]]).write(
        "endurance_inputs"
    )


def _keep_failed(result: dict, files: list[tuple[str, bytes]]) -> None:
    KEPT.mkdir(parents=True, exist_ok=True)
    name, data = input_of(result["number"], files)
    (KEPT / f"{result['number']}_{name}").write_bytes(data)
    print(f"{result['number']} {name}: {result['outcome']}\n{result['detail']}", flush=True)


def contents_of(folder: Path) -> dict[str, str]:
    """Return a digest of every file of a run by name; notes of what is finished by name alone."""
    return {
        path.relative_to(folder).as_posix(): _digest(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _digest(path: Path) -> str:
    if ".finished" in path.parts:
        return ""
    return _draws_in(path) if path.suffix == ".nc" else digest_of(path)


def _draws_in(path: Path) -> str:
    """Return a digest of all arrays and attributes of a results file."""
    digest = hashlib.sha256()

    def add(name: str, node: h5py.Dataset | h5py.Group) -> None:
        digest.update(name.encode())
        if isinstance(node, h5py.Dataset):
            values = np.asarray(node[()])
            text = values.dtype.kind == "O"
            digest.update(repr(values.tolist()).encode() if text else values.tobytes())

    with h5py.File(path) as file:
        facts = {key: str(value) for key, value in file.attrs.items() if key[0] != "_"}
        digest.update(json.dumps(facts, sort_keys=True).encode())
        file.visititems(add)
    return digest.hexdigest()


_FIT = ("--seed", "1", "--max-steps", "600", "--modes", "1", "--noise", "white")
_KILLED = {
    "fit": (("fit", *_FIT), 1, 0.5),
    "fit by two processes": (("fit", *_FIT, "--jobs", "2"), 2, 0.3),
    "study": (("study", *_FIT), 1, 0.2),
}
"""Commands that are killed: their words, pads in the file, and their share of all kills."""
_IN_A_ROW = 4  # kills of one run before it may end: what goes on is killed too


def small_file(path: Path, pads: int) -> None:
    """Write two tests of so many of the bundled pads, every third reading."""
    lines = (ROOT / "data" / "pads.csv").read_text(encoding="utf-8").splitlines()
    head, *rows = (line for line in lines if not line.startswith("#"))
    tests = {f"{pad}-{rate}" for pad in "ABC"[:pads] for rate in (1, 20)}
    kept = [row for row in rows if row.split(",")[1] in tests]
    path.write_text("\n".join([head, *kept[::3]]) + "\n", encoding="utf-8")


def run_kills(count: int, seed: int, commands: Sequence[str], origin: Origin) -> None:
    """Kill commands at random moments, run them again, and compare all files with a calm run's."""
    rows = []
    with TemporaryDirectory() as base:
        os.environ["QLVBAYES_CACHE"] = str(Path(base) / "cache")  # what a kill leaves in it counts
        for name in commands:
            words, pads, share = _KILLED[name]
            folder = Path(base) / name.replace(" ", "_")
            folder.mkdir()
            small_file(folder / "pads.csv", pads)
            number = round(count * share)
            found = _killed(folder, words, number, random.Random(seed))
            rows.append([f"`{name}`", *(str(found[key]) for key in ("kills", "runs", "equal"))])
    Table(origin, count, KILLS, rows).write("endurance_kills")


def _killed(folder: Path, words: Sequence[str], count: int, rng: random.Random) -> dict[str, int]:
    """Kill one command so many times, up to four times in a row, and let it end after these."""
    run = _Command(folder, [words[0], "pads.csv", "-o", "out", *words[1:]])
    begun = time.monotonic()
    if (code := run.ended()) != 0:
        raise SystemExit(f"{run.words}: exit {code} without any kill")
    lasts, expected = time.monotonic() - begun, contents_of(folder / "out")
    kills = runs = equal = 0
    while kills < count:
        shutil.rmtree(folder / "out", ignore_errors=True)
        begun, row = time.monotonic(), 0
        while row < min(_IN_A_ROW, count - kills) and run.killed_after(rng.uniform(0.0, lasts)):
            row += 1
        if row == 0:  # the first run of all had to compile, and took longer than others do
            lasts = min(lasts, time.monotonic() - begun)
        code, mine = run.ended(), contents_of(folder / "out")
        kills, runs = kills + row, runs + 1
        print(f"{run.words[0]}: {kills} kills in {runs} runs", file=sys.stderr, flush=True)
        equal += code == 0 and mine == expected
        if code != 0 or mine != expected:
            off = sorted(n for n in {*mine, *expected} if mine.get(n) != expected.get(n))
            print(f"{run.words}: exit {code} after {row} kills, differs in {off}", flush=True)
            shutil.copytree(folder, KEPT / f"killed_{runs}", dirs_exist_ok=True)
    return {"kills": kills, "runs": runs, "equal": equal}


@dataclass(frozen=True)
class _Command:
    """A command of the program that runs in a folder, so that it has the same words each time."""

    folder: Path
    words: list[str]

    def _started(self) -> subprocess.Popen[bytes]:
        line = [sys.executable, "-m", "qlvbayes", *self.words]
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(line, cwd=self.folder, env=env, start_new_session=True, **_QUIET)

    def ended(self) -> int:
        """Run to the end and return the exit status."""
        return self._started().wait()

    def killed_after(self, seconds: float) -> bool:
        """Kill it with all its processes; return False where it had ended before."""
        process = self._started()
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
        return process.wait() == -signal.SIGKILL


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parts = parser.add_subparsers(dest="part", required=True)
    one = parts.add_parser("inputs")
    one.add_argument("--first", type=int, default=0)
    one.add_argument("--count", type=int, default=100_000)
    two = parts.add_parser("kills")
    two.add_argument("--count", type=int, default=50)
    two.add_argument("--seed", type=int, default=1)
    two.add_argument("--commands", nargs="+", choices=_KILLED, default=[*_KILLED])
    three = parts.add_parser("work")
    three.add_argument("start", type=int)
    three.add_argument("stop", type=int)
    options = parser.parse_args()
    if options.part == "work":
        work(options.start, options.stop)
        return
    origin = Origin.now()
    if options.part == "inputs":
        run_inputs(options.first, options.count, origin)
    else:
        run_kills(options.count, options.seed, options.commands, origin)


if __name__ == "__main__":
    main()
