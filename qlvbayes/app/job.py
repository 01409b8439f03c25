"""Run a job in its process: wait, warm, for an order, carry it out, and report progress.

It leaves the files that the commands leave, so that any command can continue from there.
"""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from qlvbayes.app.failures import content_of
from qlvbayes.app.pipes import Parent
from qlvbayes.diagnosis.decision import Decision
from qlvbayes.diagnosis.progress import SearchProgress, StopSearch
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.fitting.ensemble import Progress, Settings
from qlvbayes.fitting.results import Saved, load
from qlvbayes.fitting.runs import record_run
from qlvbayes.io.data import read_measurements
from qlvbayes.io.escaping import as_typed
from qlvbayes.model.choices import Choices
from qlvbayes.pipeline.comparing import CompareStep
from qlvbayes.pipeline.source import alone
from qlvbayes.pipeline.steps import CheckStep, DiagnoseStep, FitStep
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.report.page import write_report
from qlvbayes.simulate import (
    HIDDEN,
    NOISES,
    PAPER_RATES,
    PROTOCOLS,
    draw_constants,
    parse_effect,
    simulate_file,
)

_METHOD = "emcee"  # the default of the commands
_BEAT = 0.4  # s between lines of progress: more than two a second
_NICE = 5  # added to the niceness, as the page's own worker has priority
NOTHING = 0.1  # share of pads in which nothing is hidden
_ROWS = 500  # rows of a test
_NEED_RETRACTION = {"adhesion", "permanent_set", "stress_softening"}
"""Effects that only a full retraction of the platen shows."""

Spec = dict[str, Any]


class ProgressReporter(Watcher):
    """Watcher that reports progress to the server at regular intervals."""

    def __init__(self, parent: Parent) -> None:
        self._parent = parent
        self._began = time.monotonic()
        self._label = "starting"
        self._detail = ""
        self._sampling: tuple[float, int, int] | None = None
        self._over = threading.Event()
        self._enough = threading.Event()
        threading.Thread(target=self._beat, daemon=True).start()

    def end(self) -> None:
        """Stop reporting."""
        self._over.set()

    def enough(self) -> None:
        """End a search at its next step, with the results so far."""
        self._enough.set()

    @contextmanager
    def doing(self, label: str) -> Iterator[Callable[[str], None]]:
        """Report a step that takes a while."""
        self._label, self._detail = label, ""
        yield self._set_detail

    @contextmanager
    def sampling(self, label: str) -> Iterator[Progress]:
        """Report the progress of a chain."""
        self._label, self._detail = label, ""
        began = time.monotonic()

        def progress(done: int, total: int) -> None:
            self._sampling = began, done, max(done, total)  # the total may grow

        yield progress
        self._sampling = None

    def searched(self, pad: str, progress: SearchProgress) -> None:
        """Report the probabilities so far, of effects and of base laws."""
        decision = progress.decision
        ranking = [
            {"effect": name, "probability": share, "heldout": None}
            for name, share in sorted(decision.inclusion.items(), key=lambda x: -x[1])
        ]
        laws = {
            kind: [{"name": name, "probability": p} for name, p in shares.items()]
            for kind, shares in (
                ("elastic", _shares(decision, 0)),
                ("relaxation", _shares(decision, 1)),
            )
        }
        self._parent.send({"probabilities": {"pad": pad, "ranking": ranking, "laws": laws}})
        if self._enough.is_set():
            self._enough.clear()  # the search ends once
            raise StopSearch

    def _set_detail(self, text: str) -> None:
        self._detail = text

    def _beat(self) -> None:
        while not self._over.wait(_BEAT):
            now = time.monotonic()
            text = f"{self._label}: {self._detail}" if self._detail else self._label
            line: dict[str, Any] = {"text": text, "elapsed_s": round(now - self._began, 1)}
            line |= {"done": None, "total": None, "left_s": None}
            if self._sampling is not None:
                began, done, total = self._sampling
                left = (now - began) * (total - done) / done if done else None
                line |= {"done": done, "total": total}
                line["left_s"] = None if left is None else round(left, 1)
            self._parent.send(line)


def _shares(decision: Decision, part: int) -> dict[str, float]:
    """Return the probability of each elastic law, or of each relaxation law."""
    shares: dict[str, float] = {}
    for base, share in decision.base.items():
        shares[base[part]] = shares.get(base[part], 0.0) + share
    return shares


def diagnosed(spec: Spec, watcher: Watcher) -> dict[str, Any]:
    """Diagnose one pad."""
    study = read_measurements(spec["data"])
    (name,) = spec["pads"]
    choices = Choices(bonded=study.units.bonded_default, effects_file=spec["effects_file"])
    out = Path(spec["out"])
    thresholds = DiagnosisSettings()
    step = DiagnoseStep(choices, 0, thresholds)
    step.run(out / name, alone(study, study.pad(name)), watcher)
    command = _command("diagnose", spec, choices, [name])
    settings = {"thresholds": thresholds}
    record_run(out, "diagnose", command, study, choices, 0, settings)
    return {}


def sampled(spec: Spec, watcher: Watcher) -> dict[str, Any]:
    """Sample the posterior of each pad's model, and check it."""
    study, out = read_measurements(spec["data"]), Path(spec["out"])
    all_tests, settings = spec["all_tests"], Settings()
    for name in spec["pads"]:
        model = spec["models"].get(name)
        choices = _choices(model, study.units.bonded_default, spec["effects_file"])
        pad = alone(study, study.pad(name))
        for step in (FitStep(choices, _METHOD, all_tests, settings), CheckStep()):
            step.run(out / name, pad, watcher)
        command = _command("fit", spec, choices, [name])
        recorded = {"method": _METHOD, "all_tests": all_tests, "sampler": settings}
        record_run(out, "fit", command, study, choices, 0, recorded)
    return {"sampled": list(spec["pads"])}


def compared(spec: Spec, watcher: Watcher) -> dict[str, Any]:
    """Compare two pads; a pad that was not sampled yet is sampled first."""
    out, study = Path(spec["out"]), read_measurements(spec["data"])
    missing = [name for name in spec["pads"] if not _has_model(spec, name)]
    result = sampled({**spec, "pads": missing}, watcher) if missing else {"sampled": []}
    pads = [load(out / name / "posterior.nc") for name in spec["pads"]]
    first, second = ((saved.pad, [saved]) for saved in pads)
    CompareStep().run(out, first, second, watcher)
    names = ",".join(spec["pads"])
    command = as_typed("qlvbayes", "compare", out.name, "--pads", names)
    record_run(out, "compare", command, study, pads[0].choices, 0)
    return result


def _has_model(spec: Spec, name: str) -> bool:
    """Return whether a pad was sampled with the model that it has on the bench."""
    file = Path(spec["out"]) / name / "posterior.nc"
    if not file.is_file():
        return False
    model, saved = spec["models"].get(name), load(file)
    return model is None or _same_model(model, saved)


def _same_model(model: dict[str, Any], saved: Saved) -> bool:
    own = saved.choices
    names = own.elastic, own.relaxing, set(own.effects)
    return names == (model["elastic"], model["relaxation"], set(model["effects"]))


def reported(spec: Spec, watcher: Watcher) -> dict[str, Any]:
    """Write the report."""
    with watcher.doing("report"):
        write_report(spec["out"])
    return {}


def simulate_pad(spec: Spec, watcher: Watcher) -> dict[str, Any]:
    """Simulate a new pad."""
    with watcher.doing("simulating"):
        write_pad(Path(spec["data"]), Path(spec["truth"]), spec["seed"])
    return {}


def write_pad(data: Path, truth: Path, seed: int) -> None:
    """Write measurements, and in another file what is hidden; both depend on the seed alone."""
    rng = np.random.default_rng(seed)
    constants = draw_constants(rng)
    # the pad lies loose: what only a held specimen does is left out
    names = [kind.name for kind in EFFECTS if not HIDDEN[kind.name].slides]
    chosen = names[int(rng.integers(len(names)))]
    # at times without need, or the motion would give the effect away
    retracted = rng.random() < 0.5 or chosen in _NEED_RETRACTION
    protocol = "retraction" if retracted else "paper"
    effects = []
    if rng.random() >= NOTHING:
        effects = [parse_effect(chosen, constants, PROTOCOLS[protocol], max(PAPER_RATES), rng)]
    data.parent.mkdir(parents=True, exist_ok=True)
    simulate_file(
        data, {"pad": constants}, PAPER_RATES, NOISES["correlated"], seed, _ROWS, "",
        effects, protocol, truth,
    )  # fmt: skip


KINDS: dict[str, Callable[[Spec, Watcher], dict[str, Any]]] = {
    "diagnose": diagnosed,
    "sample": sampled,
    "compare": compared,
    "report": reported,
    "deal": simulate_pad,
}


def _choices(model: dict[str, Any] | None, bonded: bool, effects_file: str | None) -> Choices:
    default = Choices(bonded=bonded, effects_file=effects_file)
    if model is None:
        return default
    relaxation, _, modes = model["relaxation"].partition(":")
    return replace(
        default,
        elastic=model["elastic"],
        relaxation=relaxation,
        modes=int(modes) if modes else default.modes,
        effects=tuple(model["effects"]),
    )


def _command(step: str, spec: Spec, choices: Choices, pads: Sequence[str]) -> str:
    """Return the command line that does the same."""
    words = ["qlvbayes", step, Path(spec["data"]).name, "--pads", ",".join(pads)]
    if step == "fit":
        words += ["--elastic", choices.elastic, "--relaxation", choices.relaxing]
        words += ["--all-tests"] if spec["all_tests"] else []
        words += [word for name in choices.effects for word in ("--add", name)]
    words += ["--effects-file", spec["effects_file"]] if spec["effects_file"] else []
    return as_typed(*words, "-o", ".")


def _await_stop(orders: queue.SimpleQueue[Spec], watcher: ProgressReporter) -> None:
    """Wait for the order to stop: any message after the first one is that."""
    orders.get()
    watcher.enough()


def main() -> None:
    """Carry out one order."""
    parent = Parent()
    os.nice(_NICE)
    orders: queue.SimpleQueue[Spec] = queue.SimpleQueue()
    parent.listen(orders.put)
    spec = orders.get()
    watcher = ProgressReporter(parent)
    threading.Thread(target=_await_stop, args=(orders, watcher), daemon=True).start()
    try:
        result = KINDS[spec["kind"]](spec, watcher)
    except Exception as error:  # whatever it is, the page shows it
        watcher.end()
        parent.send({"error": content_of(error)})
    else:
        watcher.end()
        parent.send({"result": result})


if __name__ == "__main__":
    main()
