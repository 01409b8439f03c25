"""Work for processes of their own: they import it by name."""

import json
import os
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.pipeline.steps import Step


def squared(number):
    if number == 3:
        raise InputError("three cannot be used", file="numbers.csv", line=7, remedy="use another")
    if number == 5:
        raise ValueError("five\nis odd")
    return number * number


def killed_once(item):
    """The process dies the first time that this item is worked on."""
    number, place = item
    mark = Path(place) / "was killed"
    if number == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def always_killed(number):
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def lasting(number):
    os.write(1, b"begun\n")  # in one piece, as two processes share the pipe
    time.sleep(600.0)


def process_of(number):
    return os.getpid()


@dataclass(frozen=True)
class MeanStep(Step):
    """Leaves the mean force of a pad; refuses the pad called bad."""

    name, needs, leaves, code = "mean", ("before.txt",), ("mean.json",), ("io",)

    shift: float = 0.0

    def run(self, folder, study, watcher):
        pad = study.pads[0]
        folder.mkdir(parents=True, exist_ok=True)
        if pad.name == "bad":
            raise InputError("no force", file=study.source, line=3, remedy="measure it")
        before = folder / "before.txt"
        more = before.read_text() if before.exists() else ""
        content = {"mean": float(np.mean(pad.tests[0].force)) + self.shift, "more": more}
        (folder / "mean.json").write_text(json.dumps(content))
        (folder / "deep").mkdir(exist_ok=True)
        (folder / "deep" / "who.txt").write_text(pad.name)
        watcher.starting([f"pad {pad.name}: done"])

    def report(self, folder, watcher):
        watcher.notice(f"pad {folder.name}: there")


def pads(*names):
    """A study of one pad each, as a source gives them."""
    time = np.arange(5.0)
    for place, name in enumerate(names):
        test = Test("t", name, time, time, time * 0.1 + place)
        yield Measurements((Pad(name, (test,), PAD),), PAD, "some.csv", "digest", ())


@dataclass(frozen=True)
class SlowStep(Step):
    """Leaves a file, pads called slow only after a while."""

    name, leaves, code = "slow", ("done.txt",), ("io",)

    seconds: float = field(repr=False)  # what is left does not depend on it

    def run(self, folder, study, watcher):
        if study.pads[0].name.startswith("slow"):
            time.sleep(self.seconds)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "done.txt").write_text(study.pads[0].name)
        watcher.starting([f"pad {folder.name}: done"])

    def report(self, folder, watcher):
        watcher.notice(f"pad {folder.name}: there")
