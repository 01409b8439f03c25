"""A pad as every target gets it: one draw of its constants, a table of draws, what was tested."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path, PurePath

import equinox as eqx
import jax
import numpy as np

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.fitting.ensemble import highest_density
from qlvbayes.fitting.results import Saved, load
from qlvbayes.io.checks import InputError
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.relaxation.prony import Spectrum
from qlvbayes.model.drawn import described_model, drawn_models
from qlvbayes.model.model import Model
from qlvbayes.model.parameters import fields_of
from qlvbayes.model.stepping import without_inverse
from qlvbayes.use.exports.layers import ExportedLayer, exported_layers, in_spectrum

_LONGEST = 40  # characters of a name in an identifier: C and MATLAB distinguish 63


@dataclass(frozen=True)
class PosteriorInterval:
    """A constant's posterior: median and 90 % highest-density interval, in ``unit``."""

    name: str
    unit: str
    median: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Draws:
    """Constants of n draws: elastic (n, E) in the law's order, fractions (n, k + 1), rates (n, k).

    The spectrum is g(t) = c_0 + sum c_i e^{-v_i t} (rates in 1/s), whatever the relaxation, and
    with what effects make of it; effects: (n, M) constants of the others, in the layers' order.
    """

    elastic: np.ndarray
    fractions: np.ndarray
    rates: np.ndarray
    effects: np.ndarray

    def __len__(self) -> int:
        return len(self.elastic)


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedPad(Saved):
    """A fitted pad as every target gets it: the results file, and what an export makes of it.

    identifier: the name as C, XML and MATLAB take one, ``pad_B``, of this pad alone in its folder
    of results; middle: the draw that lies closest to the medians; table: draws evenly out of all;
    intervals: of the pad's constants; folder: of its results; date: of the export, as 2026-01-31;
    model: with the constants of the middle draw and the effects that are exported; data: where the
    user says that the tests are; pieces: its layers, for other languages; left_out: effects that
    are not exported, each with the reason; lacking: whether the diagnosis found something that no
    effect of the model is.
    """

    identifier: str
    folder: Path
    date: str
    data: Path | None
    model: Model
    pieces: tuple[ExportedLayer, ...]
    left_out: dict[str, str]
    middle: Draws
    table: Draws
    intervals: tuple[PosteriorInterval, ...]
    lacking: bool = False

    @property
    def origin(self) -> str:
        """Name of the file that was fitted, without the folders of the machine; or empty."""
        return PurePath(self.source.replace("\\", "/")).name

    @property
    def elastic(self) -> AbstractElastic:
        """Elastic law of the middle draw."""
        return self.model.elastic

    @property
    def relaxation(self) -> AbstractRelaxation:
        """Relaxation of the middle draw, after the effects that change it."""
        return self.model.relaxation

    @property
    def constant_names(self) -> tuple[str, ...]:
        """Names of the elastic law's constants, then of the layers'."""
        own = [name for piece in self.pieces for name in piece.constants]
        return (*type(self.elastic).units, *own)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that are layers of their own."""
        return tuple(effect.name for effect in self.model.effects)

    @property
    def one_way(self) -> str:
        """Reason why displacement cannot be computed from force; empty where it can."""
        why = without_inverse(self.model)
        return "; ".join(f"{name}: {reason}" for name, reason in why.items())

    @property
    def fractions(self) -> np.ndarray:
        """(k + 1,) shares of the middle draw, the first of what never relaxes."""
        return self.middle.fractions[0]

    @property
    def times(self) -> np.ndarray:
        """(k,) relaxation times (s) of the middle draw."""
        return 1.0 / self.middle.rates[0]

    def stiffness(self, depth: float) -> float:
        """Return the instantaneous stiffness of the middle draw, in the pad's units."""
        return float(self.elastic.stiffness(jax.numpy.asarray(depth)))


def read_pad(
    out: Path, name: str, *, draws: int, date: str, data: Path | None = None
) -> ExportedPad:
    """Return the pad of that name from a folder of results, with a table of so many draws."""
    file = _file_of(out, name)
    saved = load(file)
    model = described_model(saved.choices)
    names = [name for field in fields_of(model) for name in field.names]
    units = [saved.units.of(f.unit) for f in fields_of(model) for _ in f.names]
    values = _columns(saved, names)
    indices = np.linspace(0, len(values) - 1, min(draws, len(values))).astype(int)
    chosen = np.concatenate([[_closest(values)], indices])
    drawn = drawn_models(model, names, values[chosen])
    middle = jax.tree.map(lambda x: jax.numpy.asarray(x[0]), drawn)
    pieces, left_out = exported_layers(middle)
    own = [names.index(name) for piece in pieces for name in piece.columns]
    every = _constants_of(drawn, values[chosen][:, own])
    return ExportedPad(
        **{field.name: getattr(saved, field.name) for field in fields(Saved)},
        identifier=identifier(saved.pad, [other.name for other in out.iterdir()]),
        folder=file.parent,
        date=date,
        data=data,
        model=_going_along(middle, left_out),
        pieces=pieces,
        left_out=left_out,
        middle=_selected(every, slice(0, 1)),
        table=_selected(every, slice(1, None)),
        intervals=_intervals(file.with_name("summary.json"), names, units, values),
        lacking=_lacks_something(file.with_name("diagnosis.json")),
    )


def _lacks_something(file: Path) -> bool:
    """Return whether a pad was diagnosed, and something unmodelled is there by the verdict."""
    return file.exists() and DiagnosisResult.read(file).verdict.has_unmodelled


def identifier(name: str, others: Iterable[str]) -> str:
    """Return the name in letters and digits, distinct from that of every other pad."""
    stem = _word_characters(name)
    alike = [other for other in others if _word_characters(other).lower() == stem.lower()]
    if len(stem) <= _LONGEST and set(alike) <= {name}:
        return f"pad_{stem}"
    return f"pad_{stem[:_LONGEST]}_{hashlib.sha256(name.encode()).hexdigest()[:6]}"


def _word_characters(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "_", name)


def _file_of(out: Path, name: str) -> Path:
    files = {file.parent.name: file for file in sorted(out.glob("*/posterior.nc"))}
    if not files:
        raise InputError("no fit in this folder", file=out, remedy="run qlvbayes fit first")
    if name not in files:
        raise InputError(f"no pad {name!r} in {out}", remedy=f"use one of {', '.join(files)}")
    return files[name]


def _columns(saved: Saved, names: list[str]) -> np.ndarray:
    """Return the draws (n, P) of the named constants."""
    if missing := [name for name in names if name not in saved.names]:
        raise InputError(f"the posterior lacks {', '.join(missing)}", remedy="add its draws")
    return saved.draws[:, [saved.names.index(name) for name in names]]


def _closest(values: np.ndarray) -> int:
    """Return the draw closest to the medians, in standard deviations."""
    spread = np.std(values, axis=0)
    off = (values - np.median(values, axis=0)) / np.where(spread > 0.0, spread, 1.0)
    return int(np.argmin(np.sum(off**2, axis=1)))


def _going_along(model: Model, left_out: Mapping[str, str]) -> Model:
    """Return the model that is exported, with effects on the relaxation within its spectrum."""
    for name in left_out:
        model = model.without(name)
    alone = [effect for effect in model.effects if in_spectrum(effect, model)]
    if not alone:
        return model
    relaxation = Spectrum(*model.spectrum())
    for effect in alone:
        model = model.without(effect.name)
    return Model(model.elastic, relaxation, model.bonded, model.effects)


def _constants_of(drawn: Model, own: np.ndarray) -> Draws:
    """Return the constants of a model with draws on its leading axis; own: (n, M) of the layers."""
    fractions, rates = eqx.filter_vmap(Model.spectrum)(drawn)
    elastic = [getattr(drawn.elastic, key) for key in type(drawn.elastic).units]
    return Draws(np.stack(elastic, axis=-1), np.asarray(fractions), np.asarray(rates), own)


def _selected(draws: Draws, rows: slice) -> Draws:
    return Draws(*(getattr(draws, field.name)[rows] for field in fields(Draws)))


def _intervals(
    summary: Path, names: list[str], units: list[str], values: np.ndarray
) -> tuple[PosteriorInterval, ...]:
    """Return the intervals of ``summary.json``, which saw every draw; else those of the draws."""
    if not summary.exists():
        ends = [highest_density(column) for column in values.T]
        rows = zip(names, units, np.median(values, axis=0), ends, strict=True)
        return tuple(PosteriorInterval(name, unit, float(m), *end) for name, unit, m, end in rows)
    try:
        parameters = json.loads(summary.read_text(encoding="utf-8"))["parameters"]
        constants = [(name, parameters[name]) for name in names]
        return tuple(
            PosteriorInterval(n, p["unit"], p["median"], *p["hdi90"]) for n, p in constants
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"cannot be read ({type(error).__name__})",
            file=summary,
            remedy="run qlvbayes fit again",
        ) from error
