"""Do the long work: diagnose, sample, write the report, with the files that the commands leave.

Any command can therefore continue where the bench ends.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from qlvbayes.app.workers import OnProgress
from qlvbayes.diagnosis.diagnose import SearchProgress, StopSearch
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.fitting.ensemble import Progress, Settings
from qlvbayes.fitting.results import record_run
from qlvbayes.io.catalogue import METHODS
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.io.wording import as_typed
from qlvbayes.model.choices import Choices
from qlvbayes.pipeline.source import alone
from qlvbayes.pipeline.steps import CheckStep, DiagnoseStep, FitStep, Step, Watcher
from qlvbayes.report.page import write_report

NICE = 5
"""Added to the niceness, as the page's own worker has priority."""
_BEAT = 0.4  # s between lines of progress: more than two a second
_ENOUGH = threading.Event()  # the search shall end at its next step


class ProgressReporter(Watcher):
    """Watcher that reports progress to the server at regular intervals."""

    def __init__(self, report: OnProgress) -> None:
        self._report = report
        self._began = time.monotonic()
        self._text = "starting"
        self._sampling: tuple[float, int, int] | None = None
        self._over = threading.Event()

    @contextmanager
    def reporting(self) -> Iterator[None]:
        """Report until the work is over."""
        beating = threading.Thread(target=self._beat, daemon=True)
        beating.start()
        try:
            yield
        finally:
            self._over.set()
            beating.join()

    @contextmanager
    def doing(self, label: str) -> Iterator[Callable[[str], None]]:
        """Report a step that takes a while."""
        self._text = label

        def detail(text: str) -> None:
            self._text = f"{label}: {text}"

        yield detail

    @contextmanager
    def sampling(self, label: str) -> Iterator[Progress]:
        """Report the progress of a chain."""
        self._text = label
        began = time.monotonic()

        def progress(done: int, total: int) -> None:
            self._sampling = began, done, max(done, total)  # the total may grow

        yield progress
        self._sampling = None

    def searched(self, pad: str, progress: SearchProgress) -> None:
        """Report the probabilities so far, of effects and of base laws."""
        decision = progress.decision
        ranking = [
            {"effect": name, "probability": share}
            for name, share in sorted(decision.inclusion.items(), key=lambda x: -x[1])
        ]
        laws: dict[str, dict[str, float]] = {"elastic": {}, "relaxation": {}}
        for base, share in decision.base.items():
            for kind, name in zip(laws.values(), base, strict=True):
                kind[name] = kind.get(name, 0.0) + share
        self._report({"probabilities": {"pad": pad, "ranking": ranking, "laws": laws}})
        if _ENOUGH.is_set():
            _ENOUGH.clear()  # the search ends once
            raise StopSearch

    def _beat(self) -> None:
        while not self._over.wait(_BEAT):
            now = time.monotonic()
            done = total = left = None
            if self._sampling is not None:
                began, done, total = self._sampling
                left = round((now - began) * (total - done) / done, 1) if done else None
            event = {"text": self._text, "elapsed_s": round(now - self._began, 1)}
            self._report(event | {"done": done, "total": total, "left_s": left})


def diagnose(
    watcher: Watcher, out: str, data: str, pad: str, effects_file: str | None, **model: Any
) -> None:
    """Diagnose a pad of the measurements ``data`` into the folder of results ``out``."""
    study, thresholds = read_measurements(data), DiagnosisSettings()
    choices = choices_of(None, study.units.bonded_default, effects_file)
    steps = (DiagnoseStep(choices, 0, thresholds),)
    _run(watcher, out, study, pad, steps, choices, [], {"thresholds": thresholds})


def sample(
    watcher: Watcher, out: str, data: str, pad: str, effects_file: str | None,
    model: dict[str, Any] | None,
) -> None:  # fmt: skip
    """Sample the posterior of a model on the bench, by default the commands' own, and check it."""
    study, settings = read_measurements(data), Settings()
    choices = choices_of(model, study.units.bonded_default, effects_file)
    steps = (FitStep(choices, all_tests=True, settings=settings), CheckStep())
    chosen = ["--elastic", choices.elastic, "--relaxation", choices.relaxing, "--all-tests"]
    chosen += [word for effect in choices.effects for word in ("--add", effect)]
    used = {"method": METHODS[0], "all_tests": True, "sampler": settings}
    _run(watcher, out, study, pad, steps, choices, chosen, used)


def _run(
    watcher: Watcher,
    out: str,
    study: Measurements,
    pad: str,
    steps: Sequence[Step],
    choices: Choices,
    chosen: Sequence[str],
    used: dict[str, Any],
) -> None:
    """Run steps of a pad, and record the command line that does the same."""
    for step in steps:
        step.run(Path(out) / pad, alone(study, study.pad(pad)), watcher)
    words = ["qlvbayes", steps[0].name, Path(study.source).name, "--pads", pad, *chosen]
    words += ["--effects-file", choices.effects_file] if choices.effects_file else []
    command = as_typed(*words, "-o", ".")
    record_run(Path(out), steps[0].name, command, study, choices, 0, used)


def report(watcher: Watcher, out: str) -> None:
    """Write the report."""
    with watcher.doing("report"):
        write_report(out)


def choices_of(model: dict[str, Any] | None, bonded: bool, effects_file: str | None) -> Choices:
    """Return the choices of a model on the bench, by default those of the commands."""
    default = Choices(bonded=bonded, effects_file=effects_file)
    if model is None:
        return default
    relaxation, _, modes = model["relaxation"].partition(":")
    return replace(
        default, elastic=model["elastic"], relaxation=relaxation,
        modes=int(modes) if modes else default.modes, effects=tuple(model["effects"]),
    )  # fmt: skip


def _call(do: Callable[..., None]) -> Callable[..., dict[str, Any]]:
    def call(report: OnProgress, **order: Any) -> dict[str, Any]:
        reporter = ProgressReporter(report)
        with reporter.reporting():
            do(reporter, **order)
        return {}

    return call


def enough() -> None:
    """End the running search at its next step, with the results so far."""
    _ENOUGH.set()


CALLS: dict[str, Callable[..., Any]] = {
    "diagnose": _call(diagnose),
    "sample": _call(sample),
    "report": _call(report),
    "enough": enough,
}
"""The calls by name."""
FIRST = frozenset({"enough"})
"""Calls that precede the others."""
