"""What the worker can be asked: names of calls, and answers as they go to the page."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from qlvbayes.app.bench.bench import Bench
from qlvbayes.app.bench.model import ByHand
from qlvbayes.app.intake import opened, read_in
from qlvbayes.app.tables import constants_csv, residuals_csv
from qlvbayes.diagnosis.protocol import protocol_of
from qlvbayes.diagnosis.result import CellError
from qlvbayes.fitting.pad_check import Curves
from qlvbayes.fitting.prediction import representative_rows
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.io.runtime import forget_compiled
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment, prepare

_STUDIES = 4  # kept
_BENCHES = 6  # kept: some ten MB each
_DIGITS = 6  # significant, of a curve's numbers
_SMALL = 0.5  # of the error: a mean error below it does not tell which way

Answer = dict[str, Any]


T = TypeVar("T")


class Shelf(Generic[T]):
    """Things that were used last, at most so many; each is made once, whoever asks."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: OrderedDict[Any, T] = OrderedDict()
        self._looking = threading.Lock()
        self._making = threading.Lock()

    def get(self, key: Any, make: Callable[[], T]) -> T:
        """What was made for a key; who finds it waits for nobody."""
        found = self._find(key)
        if found is None:
            with self._making:
                found = self._find(key)  # made by who came first
                if found is None:
                    found = make()
                    self._put(key, found)
        return found

    def _find(self, key: Any) -> T | None:
        with self._looking:
            if key in self._kept:
                self._kept.move_to_end(key)
            return self._kept.get(key)

    def _put(self, key: Any, made: T) -> None:
        with self._looking:
            self._kept[key] = made
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)


_studies: Shelf[Measurements] = Shelf(_STUDIES)
_experiments: Shelf[Experiment] = Shelf(_BENCHES)
_benches: Shelf[Bench] = Shelf(_BENCHES)


def _study(data: str) -> Measurements:
    """The measurements in a file."""
    return _studies.get(_version(data), lambda: read_measurements(data))


def _experiment(data: str, pad: str) -> Experiment:
    """One pad of them, prepared."""
    key = (*_version(data), pad)
    return _experiments.get(key, lambda: prepare(_study(data).pad(pad)))


def _bench(data: str, pad: str, effects_file: str | None) -> Bench:
    """One pad of them, laid on the bench."""

    def make() -> Bench:
        experiment = _experiment(data, pad)
        bonded = experiment.units.bonded_default
        forget_compiled()
        return Bench.of(experiment, Choices(bonded=bonded, effects_file=effects_file))

    return _benches.get((*_version(data), pad, effects_file), make)


def _version(data: str) -> tuple[str, int]:
    return data, Path(data).stat().st_mtime_ns


def model_of(model: Answer) -> ByHand:
    """A model as the page writes it; InputError where it is none."""
    try:
        return msgspec.convert(model, _Model).by_hand()
    except msgspec.ValidationError as error:
        raise InputError(f"this is no model ({error})", remedy="see docs/app_api.md") from error


class _Model(msgspec.Struct):
    elastic: str
    relaxation: str
    effects: list[str] = []
    values: dict[str, float] = {}

    def by_hand(self) -> ByHand:
        return ByHand(self.elastic, self.relaxation, tuple(self.effects), self.values)


def _written(model: ByHand) -> Answer:
    return {
        "elastic": model.elastic,
        "relaxation": model.relaxation,
        "effects": list(model.effects),
        "values": dict(model.values),
    }


def read(folder: str, uploads: list[str], answers: dict[str, str]) -> Answer:
    """Uploaded files into a session's folder, as one tidy file; or what they leave open."""
    return read_in(Path(folder), [Path(one) for one in uploads], answers)


def unpack(folder: str, archive: str) -> Answer:
    """A saved session into a folder."""
    return opened(Path(folder), Path(archive))


def pads(data: str) -> Answer:
    """The pads of a file, and what was noticed in it."""
    study = _study(data)
    return {"pads": [pad.name for pad in study.pads], "notices": list(study.notices)}


def lay(data: str, pad: str, effects_file: str | None, first: bool) -> Answer:
    """Lay a pad on the bench: what is known of it, and the usual model fitted if ``first``."""
    bench = _bench(data, pad, effects_file)
    experiment = bench.experiment
    found: Answer = {
        "units": _units(experiment),
        "noise": bench.noise,
        "peak": experiment.scales.force,
        "tests": [
            {"name": t.name, "role": t.role, "rate": _real(t.rate), "start_s": t.test.start_s}
            for t in experiment.trials
        ],
        "notices": [
            *experiment.notices,
            *(f"pad {pad}: {text}" for text in experiment.floor.notices),
        ],
    }
    if first:
        model = bench.first()
        found["model"] = _written(model)
        found["curves"] = _look(bench, model)
    return found


def _units(experiment: Experiment) -> Answer:
    units = experiment.units
    return {
        "force": units.force,
        "displacement": units.displacement,
        "speed": units.speed,
        "time": "s",
        "names": {"force": units.force_name, "displacement": units.displacement_name},
    }


def warm(data: str, pad: str, effects_file: str | None) -> Iterator[Any]:
    """Compile what most effects need, when nothing else is asked."""
    _bench(data, pad, effects_file).warm()
    yield {}


def measured(data: str, pad: str, effects_file: str | None) -> Answer:
    """The samples that are looked at, and the units: what can be shown before there is a model."""
    experiment = _experiment(data, pad)
    tests = []
    for trial in experiment.trials:
        rows = representative_rows(trial)
        time = trial.test.time[rows]
        tests.append(
            {
                "name": trial.name,
                "role": trial.role,
                "rate": _real(trial.rate),
                "phases": [
                    {"kind": p.kind, "start": float(p.start), "stop": float(p.stop)}
                    for p in trial.phases
                ],
                "time": [round(t, 6) for t in time.tolist()],
                "phase": trial.phase_of(time).tolist(),
                "displacement": _short(trial.test.displacement[rows]),
                "force": _short(trial.test.force[rows]),
            }
        )
    return {"units": _units(experiment), "tests": tests}


def catalogue(data: str, pad: str, effects_file: str | None) -> Answer:
    """Laws and effects that can be chosen."""
    bench = _bench(data, pad, effects_file)
    space = bench.space
    protocol = protocol_of(bench.experiment, bonded=bench.choices.bonded)
    listed = {kind.name for kind in bench.choices.candidates}
    return {
        "elastic": [_law(name, law) for name, law in space.elastic.items()],
        "relaxation": [_law(name, law) for name, law in space.relaxation.items()],
        "effects": [
            {
                **_law(name, effect),
                "seen": effect.seen,
                "family": effect.family(),
                "listed": name in listed,
                "blind": type(effect).blind(protocol),
            }
            for name, effect in sorted(space.effects.items(), key=lambda x: x[0] not in listed)
        ],
    }


def _law(name: str, law: Any) -> Answer:
    return {"name": name, "law": law.law, "reference": law.reference}


def parameters(data: str, pad: str, effects_file: str | None, model: Answer) -> Answer:
    """A model's sliders."""
    found = _bench(data, pad, effects_file).sliders(model_of(model))
    return {"parameters": [msgspec.to_builtins(one) for one in found]}


def curves(
    data: str, pad: str, effects_file: str | None, model: Answer, tab: str | None = None
) -> Answer:
    """A model's force and errors; ``tab``: whose later calls overtake this one."""
    bench = _bench(data, pad, effects_file)
    return _look(bench, model_of(model))


def signature(data: str, pad: str, effects_file: str | None, model: Answer, effect: str) -> Answer:
    """What an effect would look like."""
    found = _bench(data, pad, effects_file).signature(model_of(model), effect)
    trials = _bench(data, pad, effects_file).samples.trials
    return {
        "effect": found.effect,
        "amplitude": {"name": found.amplitude, "value": found.size, "unit": found.unit},
        "takes": _real(found.takes),
        "rmse": _real(found.error),
        "tests": [
            {"name": trial.name, "alone": _short(alone), "with_constants": _short(moved)}
            for trial, alone, moved in zip(trials, found.alone, found.with_constants, strict=True)
        ],
    }


def change(
    data: str, pad: str, effects_file: str | None, model: Answer, how: str, name: str = ""
) -> Answer:
    """A model changed as a page asks for it, and fitted unless it is only to be kept."""
    bench, given = _bench(data, pad, effects_file), model_of(model)
    changes: dict[str, Callable[[], ByHand]] = {
        "keep": lambda: ByHand(
            given.elastic, given.relaxation, given.effects, bench.look(given).values
        ),
        "fit": lambda: bench.fit(given),
        "add": lambda: bench.add(given, name),
        "remove": lambda: bench.remove(given, name),
        "elastic": lambda: bench.rebase(given, elastic=name),
        "relaxation": lambda: bench.rebase(given, relaxation=name),
    }
    found = changes[how]()
    return {"model": _written(found), "curves": _look(bench, found)}


def held_out(data: str, pad: str, effects_file: str | None, model: Answer) -> Iterator[Any]:
    """The error on what is left out, in pieces."""
    bench = _bench(data, pad, effects_file)
    for error in bench.held_out(model_of(model)):
        yield None if error is None else {"heldout": _real(error)}


def bands(data: str, pad: str, effects_file: str | None, folder: str) -> Answer:
    """Of a sampled fit: its bands at the samples looked at, and its summary."""
    samples = _bench(data, pad, effects_file).samples
    found = {test.test: test for test in Curves.read(Path(folder) / "curves.json").tests}
    summary = FitSummary.read(Path(folder) / "summary.json")
    tests = []
    for trial, rows in zip(samples.trials, samples.rows, strict=True):
        own = found[trial.name]
        places = np.searchsorted(np.array(own.time), trial.test.time[rows] - 5e-7)
        places = np.minimum(places, len(own.time) - 1)
        tests.append(
            {"name": trial.name}
            | {
                key: [values[k] for k in places]
                for key, values in (("mean", own.mean), ("low", own.low), ("high", own.high))
            }
        )
    return {"converged": summary.converged, "summary": summary.as_dict(), "tests": tests}


def residuals(data: str, pad: str, effects_file: str | None, model: Answer) -> str:
    """Every sample looked at, as CSV."""
    bench = _bench(data, pad, effects_file)
    return residuals_csv(bench, bench.look(model_of(model)))


def constants(
    data: str, pad: str, effects_file: str | None, model: Answer, begun: dict[str, float]
) -> str:
    """A model's constants as CSV; begun: those that its fit began from."""
    return constants_csv(_bench(data, pad, effects_file), model_of(model), begun)


CALLS: dict[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (
        read, unpack, pads, lay, warm, measured, catalogue, parameters, curves, signature, change,
        held_out, bands, residuals, constants,
    )
}  # fmt: skip
"""What can be asked, by name."""
FIRST = frozenset({"pads", "measured", "catalogue", "parameters", "curves"})
"""Those that take some milliseconds and are waited for: they go past the others."""


def _look(bench: Bench, model: ByHand) -> Answer:
    found = bench.look(model)
    return {
        "values": found.values,
        "rmse": _real(found.error),
        "tests": [
            {"name": trial.name, "model": _short(force)}
            for trial, force in zip(bench.samples.trials, found.forces, strict=True)
        ],
        "cells": [_cell(bench, cell) for cell in found.cells],
    }


def _cell(bench: Bench, cell: CellError) -> Answer:
    over = cell.rmse / bench.noise
    return {
        "test": cell.test,
        "phase": cell.phase,
        "n": cell.n,
        "rmse": _real(cell.rmse),
        "bias": _real(cell.bias),
        "over_noise": _real(over),
        "fails": not cell.rmse <= bench.limits[cell.test, cell.phase],
        "words": _words(cell, over, bench.experiment.units.force),
    }


def _words(cell: CellError, over: float, unit: str) -> str:
    """What is wrong in a cell."""
    place = f"in the {cell.phase} of {cell.test}"
    if not math.isfinite(over):
        return f"The model's force is no number {place}."
    size = f"{cell.rmse:.2g} {unit} off, {over:.2g} times the noise"
    if abs(cell.bias) < _SMALL * cell.rmse:
        return f"The model is {size}, {place}, now too low and now too high."
    way = "low" if cell.bias > 0.0 else "high"
    return f"The model is {size}, {place}: {abs(cell.bias):.2g} {unit} too {way} on average."


def _short(values: NDArray[np.float64] | Sequence[float]) -> list[float | None]:
    """To six digits; None for what is no number."""
    numbers = np.asarray(values, dtype=np.float64)
    finite = np.isfinite(numbers)
    size = np.abs(np.where(finite & (numbers != 0.0), numbers, 1.0))
    places = _DIGITS - 1 - np.floor(np.log10(size))
    # a power of ten beyond 1e22 is no exact number: what is so small is left as it is
    scale = 10.0 ** np.clip(places, 0.0, 22.0)
    with np.errstate(over="ignore", invalid="ignore"):
        rounded = np.where(places > 22.0, numbers, np.round(numbers * scale) / scale)
    return [
        x if known else None for x, known in zip(rounded.tolist(), finite.tolist(), strict=True)
    ]


def _real(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
