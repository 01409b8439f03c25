"""Define the calls that the worker answers, with the answers that the page receives."""

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
from qlvbayes.app.specimens import pads_by
from qlvbayes.app.tables import constants_csv, residuals_csv
from qlvbayes.diagnosis.result import CellError
from qlvbayes.diagnosis.searchsetup import protocol_of
from qlvbayes.fitting.pad_check import Curves
from qlvbayes.fitting.prediction import representative_rows
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.io.runtime import forget_compiled
from qlvbayes.io.wording import plain
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment, prepare

_STUDIES = 4  # studies that are kept
_BENCHES = 6  # benches that are kept, some ten MB each
_DIGITS = 6  # significant digits of a curve's values
_SMALL = 0.5  # share of the error: a smaller mean error has no clear sign

Answer = dict[str, Any]


T = TypeVar("T")


class Cache(Generic[T]):
    """Cache of the objects used last, of limited size; each is made once for all threads."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: OrderedDict[Any, T] = OrderedDict()
        self._looking = threading.Lock()
        self._making = threading.Lock()

    def get(self, key: Any, make: Callable[[], T]) -> T:
        """Return the object for a key; a thread that finds it does not wait."""
        kept = self._find(key)
        if kept is None:
            with self._making:
                kept = self._find(key)  # made by who came first
                if kept is None:
                    kept = make()
                    self._put(key, kept)
        return kept

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


_studies: Cache[Measurements] = Cache(_STUDIES)
_experiments: Cache[Experiment] = Cache(_BENCHES)
_benches: Cache[Bench] = Cache(_BENCHES)


def _study(data: str) -> Measurements:
    """Return the measurements in a file."""
    return _studies.get(_version(data), lambda: read_measurements(data))


def _experiment(data: str, pad: str) -> Experiment:
    """Return one of its pads, prepared."""
    key = (*_version(data), pad)
    return _experiments.get(key, lambda: prepare(_study(data).pad(pad)))


def _bench(data: str, pad: str, effects_file: str | None) -> Bench:
    """Return the bench of one of its pads."""

    def make() -> Bench:
        experiment = _experiment(data, pad)
        bonded = experiment.units.bonded_default
        forget_compiled()
        return Bench.from_experiment(experiment, Choices(bonded=bonded, effects_file=effects_file))

    return _benches.get((*_version(data), pad, effects_file), make)


def _version(data: str) -> tuple[str, int]:
    return data, Path(data).stat().st_mtime_ns


def model_of(model: Answer) -> ByHand:
    """Return a model from the page's description; raise InputError where it is invalid."""
    try:
        return msgspec.convert(model, _Model).by_hand()
    except msgspec.ValidationError as error:
        raise InputError(f"this is no model ({error})", remedy="see docs/app.md") from error


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
    """Convert uploaded files to one tidy file in a session's folder, or to questions."""
    return read_in(Path(folder), [Path(one) for one in uploads], answers)


def specimens(names: list[str], pattern: str) -> Answer:
    """Return the pads that a pattern finds in the names of tests."""
    return {"pads": pads_by(names, pattern)}


def unpack(folder: str, archive: str) -> Answer:
    """Unpack a saved session into a folder."""
    return opened(Path(folder), Path(archive))


def pads(data: str) -> Answer:
    """Return the pads of a file, and the notices about it."""
    study = _study(data)
    return {"pads": [pad.name for pad in study.pads], "notices": list(study.notices)}


def open_pad(data: str, pad: str, effects_file: str | None, first: bool) -> Answer:
    """Open a pad: return what is known of it, and its first fitted model if ``first``."""
    bench = _bench(data, pad, effects_file)
    experiment = bench.experiment
    facts: Answer = {
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
        facts["model"] = _written(model)
        facts["curves"] = _look(bench, model)
    return facts


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
    """Compile what most effects need, when there are no other calls."""
    _bench(data, pad, effects_file).warm()
    yield {}


def measured(data: str, pad: str, effects_file: str | None) -> Answer:
    """Return the samples and the units, which can be shown before there is a model."""
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
    """Return the laws and effects that can be chosen."""
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
    """Return the sliders of a model."""
    sliders = _bench(data, pad, effects_file).sliders(model_of(model))
    return {"parameters": [msgspec.to_builtins(slider) for slider in sliders]}


def curves(
    data: str, pad: str, effects_file: str | None, model: Answer, tab: str | None = None
) -> Answer:
    """Return a model's force and errors; a later call of the same ``tab`` supersedes this one."""
    bench = _bench(data, pad, effects_file)
    return _look(bench, model_of(model))


def signature(data: str, pad: str, effects_file: str | None, model: Answer, effect: str) -> Answer:
    """Return what an effect would add to a model."""
    added = _bench(data, pad, effects_file).signature(model_of(model), effect)
    trials = _bench(data, pad, effects_file).samples.trials
    return {
        "effect": added.effect,
        "amplitude": {"name": added.amplitude, "value": added.size, "unit": added.unit},
        "takes": _real(added.takes),
        "rmse": _real(added.error),
        "tests": [
            {"name": trial.name, "alone": _short(alone), "with_constants": _short(moved)}
            for trial, alone, moved in zip(trials, added.alone, added.with_constants, strict=True)
        ],
    }


def change(
    data: str, pad: str, effects_file: str | None, model: Answer, how: str, name: str = ""
) -> Answer:
    """Return a changed model, fitted unless it is only to be kept."""
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
    changed = changes[how]()
    return {"model": _written(changed), "curves": _look(bench, changed)}


def held_out(data: str, pad: str, effects_file: str | None, model: Answer) -> Iterator[Any]:
    """Yield the held-out error, computed in pieces."""
    bench = _bench(data, pad, effects_file)
    for error in bench.held_out(model_of(model)):
        yield None if error is None else {"heldout": _real(error)}


def bands(data: str, pad: str, effects_file: str | None, folder: str) -> Answer:
    """Return the bands of a sampled fit at the samples, and its summary."""
    samples = _bench(data, pad, effects_file).samples
    by_test = {test.test: test for test in Curves.read(Path(folder) / "curves.json").tests}
    summary = FitSummary.read(Path(folder) / "summary.json")
    tests = []
    for trial, rows in zip(samples.trials, samples.rows, strict=True):
        own = by_test[trial.name]
        indices = np.searchsorted(np.array(own.time), trial.test.time[rows] - 5e-7)
        indices = np.minimum(indices, len(own.time) - 1)
        tests.append(
            {"name": trial.name}
            | {
                key: [values[k] for k in indices]
                for key, values in (("mean", own.mean), ("low", own.low), ("high", own.high))
            }
        )
    return {"converged": summary.converged, "summary": summary.as_dict(), "tests": tests}


def residuals(data: str, pad: str, effects_file: str | None, model: Answer) -> str:
    """Return a row for every sample, as CSV."""
    bench = _bench(data, pad, effects_file)
    return residuals_csv(bench, bench.look(model_of(model)))


def constants(
    data: str, pad: str, effects_file: str | None, model: Answer, begun: dict[str, float]
) -> str:
    """Return a model's constants as CSV; ``begun`` are those that its fit began from."""
    return constants_csv(_bench(data, pad, effects_file), model_of(model), begun)


CALLS: dict[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (
        read, specimens, unpack, pads, open_pad, warm, measured, catalogue, parameters, curves,
        signature, change, held_out, bands, residuals, constants,
    )
}  # fmt: skip
"""The calls by name."""
FIRST = frozenset({"pads", "specimens", "measured", "catalogue", "parameters", "curves"})
"""Calls that take some milliseconds and that the page waits for; they precede the others."""


def _look(bench: Bench, model: ByHand) -> Answer:
    look = bench.look(model)
    return {
        "values": look.values,
        "rmse": _real(look.error),
        "tests": [
            {"name": trial.name, "model": _short(force)}
            for trial, force in zip(bench.samples.trials, look.forces, strict=True)
        ],
        "cells": [_cell(bench, cell) for cell in look.cells],
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
    """Return a sentence on what is wrong in a cell."""
    location = f"in the {cell.phase} of {cell.test}"
    if not math.isfinite(over):
        return f"The model's force is no number {location}."
    size = f"{plain(cell.rmse, 2)} {unit} off, {plain(over, 2)} times the noise"
    if abs(cell.bias) < _SMALL * cell.rmse:
        return f"The model is {size}, {location}, now too low and now too high."
    direction = "low" if cell.bias > 0.0 else "high"
    return (
        f"The model is {size}, {location}: {plain(abs(cell.bias), 2)} {unit} too {direction} "
        "on average."
    )


def _short(values: NDArray[np.float64] | Sequence[float]) -> list[float | None]:
    """Return values to six digits, and None for those that are not finite."""
    given = np.asarray(values, dtype=np.float64)
    finite = np.isfinite(given)
    size = np.abs(np.where(finite & (given != 0.0), given, 1.0))
    decimals = _DIGITS - 1 - np.floor(np.log10(size))
    # a power of ten beyond 1e22 is not exact: such small values are left unchanged
    scale = 10.0 ** np.clip(decimals, 0.0, 22.0)
    with np.errstate(over="ignore", invalid="ignore"):
        rounded = np.where(decimals > 22.0, given, np.round(given * scale) / scale)
    return [
        x if known else None for x, known in zip(rounded.tolist(), finite.tolist(), strict=True)
    ]


def _real(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
