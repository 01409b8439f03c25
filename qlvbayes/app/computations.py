"""Define the calls that the worker answers, with the answers that the page receives.

Numbers that are not finite become null on their way.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from qlvbayes.app.bench.bench import Bench
from qlvbayes.app.bench.model import ByHand
from qlvbayes.app.intake import read_in
from qlvbayes.diagnosis.result import CellError
from qlvbayes.diagnosis.searchsetup import protocol_of
from qlvbayes.fitting.prediction import representative_rows
from qlvbayes.fitting.results import load
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.wording import plain
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment, Trial, prepare

_STUDIES = 4  # studies that are kept
_BENCHES = 6  # benches that are kept, some ten MB each
_DIGITS = 6  # significant digits of a curve's values
_SMALL = 0.5  # share of the error: a smaller mean error has no clear sign

Answer = dict[str, Any]
Made = TypeVar("Made")


def _kept(most: int) -> Callable[[Callable[..., Made]], Callable[..., Made]]:
    """Keep what a function made of a file last, with its other arguments, while that is as it was.

    Each is made once, by the first thread that asks for it; no thread waits for another object.
    """

    def keeping(make: Callable[..., Made]) -> Callable[..., Made]:
        @lru_cache(most)
        def once(changed: int, *key: str | None) -> tuple[threading.Lock, list[Made]]:
            return threading.Lock(), []

        @wraps(make)
        def kept(data: str, *key: str | None) -> Made:
            making, made = once(Path(data).stat().st_mtime_ns, data, *key)
            with making:
                if not made:
                    made.append(make(data, *key))
                return made[0]

        return kept

    return keeping


_study = _kept(_STUDIES)(read_measurements)


@_kept(_BENCHES)
def _experiment(data: str, pad: str) -> Experiment:
    return prepare(_study(data).pad(pad))


@_kept(_BENCHES)
def _bench(data: str, pad: str, effects_file: str | None) -> Bench:
    experiment = _experiment(data, pad)
    bonded = experiment.units.bonded_default
    return Bench.from_experiment(experiment, Choices(bonded=bonded, effects_file=effects_file))


class _Model(msgspec.Struct):
    elastic: str
    relaxation: str
    effects: tuple[str, ...] = ()
    values: dict[str, float] = {}


def model_of(model: Answer) -> ByHand:
    """Return a model from the page's description; raise InputError where it is invalid."""
    try:
        return ByHand(*msgspec.structs.astuple(msgspec.convert(model, _Model)))
    except msgspec.ValidationError as error:
        raise InputError(f"this is no model ({error})", remedy="see docs/app.md") from error


def read(folder: str, uploads: list[str], answers: dict[str, str]) -> Answer:
    """Convert uploaded files to one tidy file in a session's folder, or to questions."""
    return read_in(Path(folder), [Path(one) for one in uploads], answers)


def pads(data: str) -> Answer:
    """Return the pads of a file, and the notices about it."""
    study = _study(data)
    return {"pads": [pad.name for pad in study.pads], "notices": list(study.notices)}


def open_pad(data: str, pad: str, effects_file: str | None, first: bool) -> Answer:
    """Open a pad: return what is known of it, and its first fitted model if ``first``."""
    bench = _bench(data, pad, effects_file)
    experiment = bench.experiment
    notices = [*experiment.notices, *(f"pad {pad}: {text}" for text in experiment.floor.notices)]
    opened: Answer = {
        "facts": {"units": _units(experiment), "noise": bench.noise, "notices": notices}
    }
    if first:
        model = bench.first()
        opened |= {"model": msgspec.to_builtins(model), "curves": _look(bench, model)}
    return opened


def _units(experiment: Experiment) -> Answer:
    units = experiment.units
    names = {"force": units.force_name, "displacement": units.displacement_name}
    shown = {name: getattr(units, name) for name in ("force", "displacement", "speed")}
    return shown | {"names": names}


def measured(data: str, pad: str, effects_file: str | None) -> Answer:
    """Return the samples and the units, which can be shown before there is a model."""
    experiment = _experiment(data, pad)
    return {"units": _units(experiment), "tests": list(map(_measured, experiment.trials))}


def _measured(trial: Trial) -> Answer:
    rows = representative_rows(trial)
    time = trial.test.time[rows]
    return {
        "name": trial.name,
        "rate": trial.rate,
        "phases": [(p.kind, float(p.start), float(p.stop)) for p in trial.phases],
        "time": [round(t, 6) for t in time.tolist()],
        "phase": trial.phase_of(time).tolist(),
        "displacement": _short(trial.test.displacement[rows]),
        "force": _short(trial.test.force[rows]),
    }


def catalogue(bench: Bench) -> Answer:
    """Return the laws and effects that can be chosen, those of the list first."""
    space = bench.space
    protocol = protocol_of(bench.experiment, bonded=bench.choices.bonded)
    listed = {kind.name for kind in bench.choices.candidates}
    effects = [
        {"name": name, "law": effect.law, "seen": effect.seen, "listed": name in listed,
         "blind": type(effect).blind(protocol)}
        for name, effect in sorted(space.effects.items(), key=lambda x: x[0] not in listed)
    ]  # fmt: skip
    laws: dict[str, Any] = {"elastic": space.elastic, "relaxation": space.relaxation}
    return {"effects": effects} | {
        kind: [{"name": name, "law": law.law} for name, law in some.items()]
        for kind, some in laws.items()
    }


def parameters(bench: Bench, model: Answer) -> Answer:
    """Return the sliders of a model."""
    return {"parameters": msgspec.to_builtins(bench.sliders(model_of(model)))}


def curves(bench: Bench, model: Answer, tab: str | None = None) -> Answer:
    """Return a model's force and errors; a later call of the same ``tab`` supersedes this one."""
    return _look(bench, model_of(model))


def signature(bench: Bench, model: Answer, effect: str) -> Answer:
    """Return what an effect would add to a model, with the shift of the model's constants."""
    added = bench.signature(model_of(model), effect)
    return {
        "effect": added.effect,
        "amplitude": {"name": added.amplitude, "value": added.size, "unit": added.unit},
        "takes": added.takes,
        "rmse": added.error,
        "tests": [
            {"name": trial.name, "with_constants": _short(moved)}
            for trial, moved in zip(bench.samples.trials, added.with_constants, strict=True)
        ],
    }


def change(bench: Bench, model: Answer, how: str, name: str = "") -> Answer:
    """Return a changed model, fitted unless it is only to be kept."""
    given = model_of(model)
    changes: dict[str, Callable[[], ByHand]] = {
        "keep": lambda: replace(given, values=bench.look(given).values),
        "fit": lambda: bench.fit(given),
        "add": lambda: bench.add(given, name),
        "remove": lambda: bench.remove(given, name),
        "elastic": lambda: bench.rebase(given, elastic=name),
        "relaxation": lambda: bench.rebase(given, relaxation=name),
    }
    changed = changes[how]()
    return {"model": msgspec.to_builtins(changed), "curves": _look(bench, changed)}


def held_out(bench: Bench, model: Answer) -> Iterator[Any]:
    """Yield the held-out error, computed in pieces."""
    for error in bench.held_out(model_of(model)):
        yield None if error is None else {"heldout": error}


def bands(bench: Bench, folder: str) -> Answer:
    """Return what a sampled fit predicts at the samples, and its summary with the intervals."""
    saved = load(Path(folder) / "posterior.nc")
    summary = FitSummary.read(Path(folder) / "summary.json")
    own = saved.choices
    model = ByHand(own.elastic, own.relaxing, own.effects)
    forces = bench.bands(model, saved.names, saved.curve_draws)
    tests = [
        {"name": trial.name, "mean": _short(mean), "low": _short(low), "high": _short(high)}
        for trial, (low, mean, high) in zip(bench.samples.trials, forces, strict=True)
    ]
    return {
        "model": msgspec.to_builtins(model) | {"values": None}, "converged": summary.converged,
        "summary": summary.as_dict(), "tests": tests,
    }  # fmt: skip


def _of_bench(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the call of a function of a bench: the bench is that of a pad of a file."""

    def call(data: str, pad: str, effects_file: str | None, **arguments: Any) -> Any:
        return function(_bench(data, pad, effects_file), **arguments)

    return call


CALLS: dict[str, Callable[..., Any]] = {
    function.__name__: function for function in (read, pads, open_pad, measured)
} | {
    function.__name__: _of_bench(function)
    for function in (catalogue, parameters, curves, signature, change, held_out, bands)
}
"""The calls by name."""
NICE = 0
"""Added to the niceness."""
FIRST = frozenset({"pads", "measured", "catalogue", "parameters", "curves"})
"""Calls that take some milliseconds and that the page waits for; they precede the others."""


def _look(bench: Bench, model: ByHand) -> Answer:
    look = bench.look(model)
    return {
        "values": look.values,
        "rmse": look.error,
        "tests": [
            {"name": trial.name, "model": _short(force)}
            for trial, force in zip(bench.samples.trials, look.forces, strict=True)
        ],
        "cells": [_cell(bench, cell) for cell in look.cells],
    }


def _cell(bench: Bench, cell: CellError) -> Answer:
    over = cell.rmse / bench.noise
    fails = not cell.rmse <= bench.limits[cell.test, cell.phase]
    words = _words(cell, over, bench.experiment.units.force)
    return {
        "test": cell.test, "phase": cell.phase, "over_noise": over, "fails": fails, "words": words,
    }  # fmt: skip


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


def _short(values: NDArray[np.float64]) -> list[float]:
    """Return values to six digits."""
    size = np.abs(np.where(np.isfinite(values) & (values != 0.0), values, 1.0))
    # a power of ten beyond 1e22 is not exact
    scale = 10.0 ** np.clip(_DIGITS - 1 - np.floor(np.log10(size)), 0.0, 22.0)
    with np.errstate(over="ignore", invalid="ignore"):
        return list((np.round(values * scale) / scale).tolist())
