"""A pad on the bench: models laid over its tests by hand, and what each leaves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from qlvbayes.app.bench.limits import cell_limits
from qlvbayes.app.bench.model import (
    ByHand,
    Slider,
    checked,
    constants_of,
    nothing_added,
    sliders,
    theta_of,
    values_of,
)
from qlvbayes.app.bench.signature import beside
from qlvbayes.app.bench.squares import Squares
from qlvbayes.diagnosis.checks.samples import Samples, cell_errors, rmse
from qlvbayes.diagnosis.result import CellError
from qlvbayes.diagnosis.searchsetup import as_chosen, build_search
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.extending import amplitude_of, carried
from qlvbayes.inference.forward.space import Space
from qlvbayes.inference.projection import projected
from qlvbayes.io.checks import InputError, NoFiniteForceError
from qlvbayes.model.choices import Choices
from qlvbayes.preprocess.experiment import Experiment

Array = NDArray[np.float64]

_STARTS = 3  # draws of the priors from which the first fit begins, the best of all
_ALONG = 1e-3  # of a shift of the constants, over which its slope is taken


@dataclass(frozen=True, eq=False)
class Look:
    """A model's force (n,) at each test's samples, and what it leaves.

    values: every constant, as used; error: root mean square over all samples; cells: by test and
    phase; in the units of the file.
    """

    values: dict[str, float]
    forces: tuple[Array, ...]
    error: float
    cells: tuple[CellError, ...]


@dataclass(frozen=True, eq=False)
class Signature:
    """What an effect would add to a model's force (n,) at each test's samples.

    amplitude, size, unit: the constant by which it grows, at its likeliest size; alone: its force;
    with_constants: with the shift of the model's constants that goes with it; takes: share of the
    squared residual that this removes; error: root mean square that it leaves.
    """

    effect: str
    amplitude: str
    size: float
    unit: str
    alone: tuple[Array, ...]
    with_constants: tuple[Array, ...]
    takes: float
    error: float


@dataclass(frozen=True, eq=False)
class Bench:
    """One pad's tests under any model of the package, compiled once for all of them."""

    experiment: Experiment
    choices: Choices
    samples: Samples
    squares: Squares

    @classmethod
    def of(cls, experiment: Experiment, choices: Choices | None = None) -> Bench:
        """All tests of an experiment; laws, effects and priors as the choices have them.

        Raises InputError where a choice cannot be used.
        """
        choices = choices or Choices()
        experiment = as_chosen(experiment, choices)
        density = build_search(experiment, choices, kinds=choices.candidates).density
        floor = experiment.floor
        return cls(
            experiment,
            choices,
            Samples.from_experiment(experiment, density.space),
            Squares.of(density, floor.white, floor.ou),
        )

    @property
    def space(self) -> Space:
        """Every law and effect there is, with its priors."""
        return self._density.space

    @property
    def _density(self) -> Density:
        return self.squares.density

    @property
    def noise(self) -> float:
        """Sd of one reading at rest."""
        return self.experiment.floor.total

    @cached_property
    def limits(self) -> dict[tuple[str, str], float]:
        """Root mean square error of each test and phase that noise alone hardly exceeds."""
        return cell_limits(self.samples)

    @cached_property
    def effects(self) -> dict[str, AbstractEffect]:
        """Effects that can be added, by name."""
        return self.space.effects

    def usual(self) -> ByHand:
        """The model of the choices, its constants at their priors' medians."""
        return ByHand(self.choices.law, self.choices.relaxing, self.choices.effects)

    def sliders(self, model: ByHand) -> list[Slider]:
        """Its constants, each with range, unit and meaning."""
        checked(model, self.space)
        own = self.space.parameters(model.hypothesis)
        return sliders(own, self.space, self.experiment.units, constants_of(model, self.space))

    def look(self, model: ByHand) -> Look:
        """Its force and its errors; some milliseconds, as nothing is compiled anew."""
        checked(model, self.space)
        constants = constants_of(model, self.space)
        forces = [found[0] for found in self.samples.predict(model.hypothesis, constants[None])]
        left = [y - f for y, f in zip(self.samples.observed, forces, strict=True)]
        own = self.space.parameters(model.hypothesis)
        with np.errstate(over="ignore", invalid="ignore"):
            return Look(
                values_of(own, constants), tuple(forces), rmse(left),
                tuple(cell_errors(self.samples, left)),
            )  # fmt: skip

    def warm(self) -> None:
        """Compile what most effects need; the costly ones are compiled when they are asked for."""
        usual = self.usual()
        cheap = [e.name for e in self.effects.values() if not e.costly and e.generalises is None]
        new = [name for name in cheap if name not in usual.effects]
        for name in new[:1]:
            self.look(ByHand(usual.elastic, usual.relaxation, (*usual.effects, name)))

    def first(self) -> ByHand:
        """The usual model, fitted from its priors; NoFiniteForceError where no draw can be used."""
        model, space = self.usual(), self.space
        own = space.parameters(model.hypothesis)
        starts = np.concatenate(
            [nothing_added(own, space)[None], own.within(space.plain_draws(model.hypothesis))]
        )
        costs = self.squares.costs(model.hypothesis, starts)
        best = [starts[k] for k in np.argsort(costs)[:_STARTS]]
        return self._least(model, best)

    def fit(self, model: ByHand) -> ByHand:
        """Least squares from the model's own constants."""
        checked(model, self.space)
        own = self.space.parameters(model.hypothesis)
        return self._least(model, [theta_of(own, constants_of(model, self.space))])

    def add(self, model: ByHand, effect: str) -> ByHand:
        """The model with one more effect, both fitted."""
        more = replace(model, effects=(*model.effects, effect))
        self._free(model, effect)
        checked(more, self.space)
        point = self._point(model)
        own = self.space.parameters(more.hypothesis)
        start = nothing_added(own, self.space)
        start[own.carried(point.own)] = point.theta
        if amplitude_of(own, effect) is None:
            return self._least(more, [start])
        found = beside(self.squares, point, more.hypothesis, effect)
        return self._least(more, [start] if found is None else [found.moved, found.after])

    def remove(self, model: ByHand, effect: str) -> ByHand:
        """The model without one of its effects, fitted from where it stands."""
        if effect not in model.effects:
            raise InputError(f"the effect {effect} is not in the model", remedy="choose another")
        effects = tuple(name for name in model.effects if name != effect)
        values = {n: x for n, x in model.values.items() if not n.startswith(f"{effect}.")}
        return self.fit(replace(model, effects=effects, values=values))

    def rebase(
        self, model: ByHand, *, elastic: str | None = None, relaxation: str | None = None
    ) -> ByHand:
        """The model on other laws, fitted from the curves of theirs that are nearest."""
        other = replace(
            model,
            elastic=elastic or model.elastic,
            relaxation=relaxation or model.relaxation,
            values={},
        )
        checked(other, self.space)
        point = self._point(model)
        own = self.space.parameters(other.hypothesis)
        start = carried(point.own, point.theta, own, nothing_added(own, self.space))
        near = projected(self.space, point, other.hypothesis, start)
        return self._least(other, [own.within(near)])

    def signature(self, model: ByHand, effect: str) -> Signature:
        """What an effect would look like beside a model, at the size that fits its residual.

        Raises InputError where the effect is in the model, or cannot be drawn.
        """
        self._free(model, effect)
        more = replace(model, effects=(*model.effects, effect))
        checked(more, self.space)
        found = beside(self.squares, self._point(model), more.hypothesis, effect)
        if found is None:
            raise InputError(
                f"the effect {effect} adds no force to this model in these tests",
                remedy="choose another",
            )
        along = found.before + _ALONG * (found.moved - found.after)
        constants = found.own.constants(np.stack([found.before, found.after, along]))
        forces = self.samples.predict(more.hypothesis, constants)
        alone = tuple(f[1] - f[0] for f in forces)
        moved = tuple(one + (f[2] - f[0]) / _ALONG for one, f in zip(alone, forces, strict=True))
        left = [y - f[0] for y, f in zip(self.samples.observed, forces, strict=True)]
        before = rmse(left)
        after = rmse([one - two for one, two in zip(left, moved, strict=True)])
        name = found.own.names[found.amplitude.constant]
        kind = self.effects[effect].units[name.partition(".")[2]]
        return Signature(
            effect,
            name,
            float(constants[1, found.amplitude.constant]),
            self.experiment.units.of(kind),
            alone,
            moved,
            1.0 - (after / before) ** 2 if before > 0.0 else 0.0,
            after,
        )

    def held_out(self, model: ByHand) -> Iterator[float | None]:
        """The error on what is left out, one test after another (or phase, of one test alone).

        Yields None while there is more to fit, at last the root mean square error over all samples;
        nan where there is nothing to predict from.
        """
        point = self._point(model)
        residuals = []
        for blocks, test, rows in self.samples.left_out():
            found = self.squares.without(blocks).least(model.hypothesis, point.theta) or point
            predicted = self.samples.predict(model.hypothesis, found.constants[None])[test][0]
            residuals.append((self.samples.observed[test] - predicted)[rows])
            yield None
        yield rmse(residuals) if residuals else float("nan")

    def _free(self, model: ByHand, effect: str) -> None:
        if effect in model.effects:
            raise InputError(f"the effect {effect} is in the model already", remedy="remove it")

    def _point(self, model: ByHand) -> Point:
        checked(model, self.space)
        own = self.space.parameters(model.hypothesis)
        point = self._density.at(model.hypothesis, theta_of(own, constants_of(model, self.space)))
        if point is None:
            raise InputError(
                "the model's force is no number here", remedy="move the constants back"
            )
        return point

    def _least(self, model: ByHand, starts: Sequence[Array]) -> ByHand:
        """The model with the constants of least loss, from several starts."""
        found = [self.squares.least(model.hypothesis, start) for start in starts]
        points = [point for point in found if point is not None]
        if not points:
            raise NoFiniteForceError
        best = min(points, key=lambda point: self.squares.terms(point).loss)
        return replace(model, values=values_of(best.own, best.constants))
