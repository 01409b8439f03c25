"""Lay models over a pad's tests by hand, and compute their forces and errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

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
from qlvbayes.diagnosis.checks.samples import Samples, cell_errors, leave_out, rmse
from qlvbayes.diagnosis.result import CellError
from qlvbayes.diagnosis.searchsetup import as_chosen, build_search
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.fitting.optimum import best_model
from qlvbayes.fitting.residuals import FALSE_ALARMS, error_limit
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.forward.hypothesis import Amplitude, Hypothesis, Parameters
from qlvbayes.inference.forward.space import Space
from qlvbayes.inference.modes import find_mode
from qlvbayes.inference.starts import projected, shapes, transferred
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError, NoFiniteForceError
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.phases import KINDS

_STARTS = 3  # number of the best draws of the priors from which the first fit begins
_DRAWN = 200  # draws that make a band
_BAND = (0.05, 0.95)  # quantiles of a band's ends
_ROUNDS = 3  # times that the size of an added effect is inserted into its force
_LEAST = 1e-6  # smallest size over the prior's sd, which stands for zero
_ALONG = 1e-3  # share of a shift of the constants over which its slope is taken


@dataclass(frozen=True, eq=False)
class Look:
    """Force (n,) of a model at the samples of each test, and its errors."""

    values: dict[str, float]  # every constant, as used
    forces: tuple[Array, ...]  # (n,) for each test, in the unit of the file
    error: float  # root mean square error over all samples, in the unit of the file
    cells: tuple[CellError, ...]


@dataclass(frozen=True, eq=False)
class Signature:
    """Force (n,) that an effect would add to a model at the samples of each test."""

    effect: str
    amplitude: str  # name of the constant by which the effect grows
    size: float  # most probable size of the amplitude
    unit: str
    alone: tuple[Array, ...]  # the effect's own force, (n,) for each test
    # the same with the shift of the model's constants that goes with it
    with_constants: tuple[Array, ...]
    takes: float  # share of the squared residual that this removes
    error: float  # root mean square error that remains


@dataclass(frozen=True, eq=False)
class Bench:
    """Bench on which any model of the package is compared with one pad's tests.

    experiment: The tests of the pad; choices: Laws, effects and priors; samples: The samples at
    which forces and errors are computed; density: The posterior density under independent noise, by
    which models are fitted.
    """

    experiment: Experiment
    choices: Choices
    samples: Samples
    density: Density

    @classmethod
    def from_experiment(cls, experiment: Experiment, choices: Choices | None = None) -> Bench:
        """Return the bench for all tests of an experiment; raise InputError for a wrong choice."""
        choices = choices or Choices()
        experiment = as_chosen(experiment, choices)
        density = build_search(experiment, choices, kinds=choices.candidates).density
        trials = experiment.trials
        known = any(trial.test.contact_sd for trial in trials)
        model = best_model(experiment, choices, trials) if known else None
        samples = Samples.from_experiment(experiment, density.space, model)
        contacts = samples.contacts.changes(density.space.record.blocks)
        shared = np.sum(density.whitener.flattened(contacts) ** 2, axis=0)
        sds = np.sqrt(density.whitener.sds**2 - shared)
        return cls(experiment, choices, samples, density.with_independent_noise(sds, contacts))

    @property
    def space(self) -> Space:
        """Return every law and effect with its priors."""
        return self.density.space

    @property
    def noise(self) -> float:
        """Return the standard deviation of one reading at rest, in the unit of force."""
        return self.experiment.floor.total

    @cached_property
    def limits(self) -> dict[tuple[str, str], float]:
        """Return the root mean square error of each test and phase that noise hardly exceeds."""
        return _cell_limits(self.samples)

    @property
    def effects(self) -> dict[str, AbstractEffect]:
        """Return the effects that can be added, by name."""
        return self.space.effects

    def baseline(self) -> ByHand:
        """Return the model of the choices, its constants at their priors' medians."""
        return ByHand(self.choices.elastic, self.choices.relaxing, self.choices.effects)

    def _own(self, model: ByHand) -> Parameters:
        """Return the parameters of a model; raise InputError where it is none."""
        checked(model, self.space)
        return self.space.parameters(model.hypothesis)

    def sliders(self, model: ByHand) -> list[Slider]:
        """Return a model's constants, each with range, unit and meaning."""
        own = self._own(model)
        return sliders(own, self.space, self.experiment.units, constants_of(model, self.space))

    def look(self, model: ByHand) -> Look:
        """Return a model's force and errors, in some milliseconds."""
        own, constants = self._own(model), constants_of(model, self.space)
        with np.errstate(over="ignore", invalid="ignore"):
            forces = self._forces(self.density, model.hypothesis, constants)
            left = [y - f for y, f in zip(self.samples.observed, forces, strict=True)]
            return Look(
                values_of(own, constants), tuple(forces), rmse(left),
                tuple(cell_errors(self.samples, left)),
            )  # fmt: skip

    def _forces(self, density: Density, hypothesis: Hypothesis, constants: Array) -> list[Array]:
        """Return the force (n,) of each test, at the contacts that constants (P,) imply."""
        samples = self.samples
        predicted = self.space.forces(hypothesis, constants[None])[0]
        residual = density.whitener((self.space.record.blocks.force - predicted)[None])[0]
        moved = samples.moved(density, residual, density.discrepancy.at(0.0))
        forces = samples.predict(hypothesis, constants[None])
        return [one[0] + more for one, more in zip(forces, moved, strict=True)]

    def first(self) -> ByHand:
        """Return the model of the choices, fitted from its priors, if a draw can be used."""
        model, space = self.baseline(), self.space
        own = space.parameters(model.hypothesis)
        starts = np.concatenate(
            [nothing_added(own, space)[None], own.within(space.prior_draws(model.hypothesis))]
        )
        forces = space.forces(model.hypothesis, own.constants(starts))
        residuals = self.density.whitener(np.asarray(space.record.blocks.force) - forces)
        with np.errstate(over="ignore"):  # a sum that overflows is the worst
            sums = np.nan_to_num(np.sum(residuals**2, axis=1), nan=np.inf)
        return self._least(model, [starts[k] for k in np.argsort(sums)[:_STARTS]])

    def fit(self, model: ByHand) -> ByHand:
        """Return the model fitted by least squares from its own constants."""
        return self._least(model, [theta_of(self._own(model), constants_of(model, self.space))])

    def add(self, model: ByHand, effect: str) -> ByHand:
        """Return the model with one more effect, both fitted; raise InputError if it cannot be."""
        more, own = self._with(model, effect)
        point = self._point(model)
        start = nothing_added(own, self.space)
        start[own.positions_of(point.own)] = point.theta
        if effect not in own.amplitude_of:
            return self._least(more, [start])
        added = added_effect(self.density, point, more.hypothesis, effect)
        return self._least(more, [start] if added is None else [added.moved, added.after])

    def remove(self, model: ByHand, effect: str) -> ByHand:
        """Return the model without one of its effects, fitted from its own constants."""
        if effect not in model.effects:
            raise InputError(f"the effect {effect} is not in the model", remedy="choose another")
        effects = tuple(name for name in model.effects if name != effect)
        values = {n: x for n, x in model.values.items() if not n.startswith(f"{effect}.")}
        return self.fit(replace(model, effects=effects, values=values))

    def rebase(
        self, model: ByHand, *, elastic: str | None = None, relaxation: str | None = None
    ) -> ByHand:
        """Return the model on other laws (None keeps one), fitted from their nearest curves."""
        elastic, relaxation = elastic or model.elastic, relaxation or model.relaxation
        other = replace(model, elastic=elastic, relaxation=relaxation, values={})
        own, point = self._own(other), self._point(model)
        start = transferred(point.own, point.theta, own, nothing_added(own, self.space))
        near = projected(self.space, point, other.hypothesis, start)
        return self._least(other, [own.within(near)])

    def signature(self, model: ByHand, effect: str) -> Signature:
        """Return what an effect would add to a model, at the size that fits its residual."""
        more, _ = self._with(model, effect)
        added = added_effect(self.density, self._point(model), more.hypothesis, effect)
        if added is None:
            what = f"the effect {effect} adds no force to this model in these tests"
            raise InputError(what, remedy="choose another")
        along = added.before + _ALONG * (added.moved - added.after)
        constants = added.own.constants(np.stack([added.before, added.after, along]))
        forces = self.samples.predict(more.hypothesis, constants)
        alone = tuple(f[1] - f[0] for f in forces)
        moved = tuple(one + (f[2] - f[0]) / _ALONG for one, f in zip(alone, forces, strict=True))
        left = [y - f[0] for y, f in zip(self.samples.observed, forces, strict=True)]
        before = rmse(left)
        after = rmse([one - two for one, two in zip(left, moved, strict=True)])
        name = added.own.names[added.amplitude.constant]
        kind = self.effects[effect].units[name.partition(".")[2]]
        size = float(constants[1, added.amplitude.constant])
        takes = 1.0 - (after / before) ** 2 if before > 0.0 else 0.0
        unit = self.experiment.units.of(kind)
        return Signature(effect, name, size, unit, alone, moved, takes, after)

    def held_out(self, model: ByHand) -> Iterator[float | None]:
        """Yield None while there is more to fit, and at last the held-out error.

        One test after another is left out, or one phase after another of a single test. The error
        is the root mean square over all samples; it is nan where there is nothing to predict from.
        """
        point = self._point(model)
        residuals = []
        for others, test, rows in leave_out(self.density, self.samples):
            mode = find_mode(others, model.hypothesis, point.theta)
            refitted = mode.point if mode is not None else point
            predicted = self._forces(others, model.hypothesis, refitted.constants)[test]
            residuals.append((self.samples.observed[test] - predicted)[rows])
            yield None
        yield rmse(residuals) if residuals else float("nan")

    def bands(
        self, model: ByHand, names: Sequence[str], draws: Array
    ) -> list[tuple[Array, Array, Array]]:
        """Return the low end, mean and high end (n,) of the forces of each test.

        They belong to draws (S, Q) of the constants that are named, of which some are used. Between
        the ends a reading, with the noise at rest, lies with 90 % probability.
        """
        order = list(self._own(model).names)
        some = draws[:: max(1, len(draws) // _DRAWN)][:_DRAWN]
        constants = np.tile(constants_of(model, self.space), (len(some), 1))
        for name, column in zip(names, some.T, strict=True):
            if name in order:
                constants[:, order.index(name)] = column
        rng = np.random.default_rng(0)
        found = []
        for k, forces in enumerate(self.samples.predict(model.hypothesis, constants)):
            read = forces + self.samples.floor(k) * rng.standard_normal(forces.shape)
            low, high = np.quantile(read, _BAND, axis=0)
            found.append((low, forces.mean(axis=0), high))
        return found

    def _with(self, model: ByHand, effect: str) -> tuple[ByHand, Parameters]:
        """Return a model with one more effect, and its parameters."""
        if effect in model.effects:
            raise InputError(f"the effect {effect} is in the model already", remedy="remove it")
        more = replace(model, effects=(*model.effects, effect))
        return more, self._own(more)

    def _point(self, model: ByHand) -> Point:
        theta = theta_of(self._own(model), constants_of(model, self.space))
        point = self.density.at(model.hypothesis, theta)
        if point is None:
            what = "the model's force is no number here"
            raise InputError(what, remedy="move the constants back")
        return point

    def _least(self, model: ByHand, starts: Sequence[Array]) -> ByHand:
        """Return the model with the constants of least loss, from several starts."""
        reached = [find_mode(self.density, model.hypothesis, start) for start in starts]
        modes = [mode for mode in reached if mode is not None]
        if not modes:
            raise NoFiniteForceError
        best = min(modes, key=lambda mode: mode.loss).point
        return replace(model, values=values_of(best.own, best.constants))


@dataclass(frozen=True, eq=False)
class AddedEffect:
    """Model at theta (F,) with one more effect, at the effect's most probable size and shape.

    ``own`` are the parameters of the model with the effect, and ``amplitude`` is the effect's among
    them. ``before`` and ``after`` (G,) have the amplitude at zero and at its size, with the
    constants unchanged; ``moved`` (G,) includes the constants' shift. ``cost`` is the remaining sum
    of squares.
    """

    own: Parameters
    amplitude: Amplitude
    before: Array
    after: Array
    moved: Array
    cost: float


def added_effect(
    density: Density, point: Point, hypothesis: Hypothesis, effect: str
) -> AddedEffect | None:
    """Return an additional effect at a point, in the shape that takes most of the residual.

    With J the slopes of the model's own constants and g the force of the effect of unit size, both
    over the noise, shift d and size a minimise

    .. math:: |r - J^T d - a g|^2 - d^T P d,

    P the curvature of the constants' priors. The size is inserted into g a few times, as few
    effects are linear in it.
    """
    space = density.space
    own = space.parameters(hypothesis)
    amplitude = own.amplitude_of.get(effect)
    if amplitude is None:
        return None
    starts = shapes(space, point, own, effect)
    candidates = [_scaled(density, point, own, amplitude, start) for start in starts]
    found = [candidate for candidate in candidates if candidate is not None]
    return min(found, key=lambda x: x.cost, default=None)


def _scaled(
    density: Density, point: Point, own: Parameters, amplitude: Amplitude, start: Array
) -> AddedEffect | None:
    index, residual, slopes = amplitude.number, point.residual, point.jacobian
    prior = point.prior.curvature
    size, shift, cost = amplitude.sd, np.zeros(point.own.size), np.inf
    for _ in range(_ROUNDS):
        added = density.space.added_forces(own.hypothesis, start[None], index, size)
        force = density.whitener(added)[0]
        square = float(force @ force)
        if not (np.isfinite(square) and square > 0.0):
            return None
        rows = np.concatenate([slopes, force[None]])
        matrix = rows @ rows.T
        matrix[:-1, :-1] += prior
        scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        matrix, right = matrix * np.outer(scale, scale), scale * (rows @ residual)
        solution = scale * np.linalg.lstsq(matrix, right, rcond=1e-12)[0]
        low, high = own.lowest[index] - start[index], own.highest[index] - start[index]
        smallest = _LEAST * amplitude.sd
        scaled = float(np.clip(solution[-1] * size, low, high))
        if abs(scaled) < smallest:  # the residual has nothing of it
            scaled, solution = smallest if high > 0.0 else -smallest, 0.0 * solution
        shift = solution[:-1]
        cost = float(np.sum((residual - shift @ slopes - force * (scaled / size)) ** 2))
        size = scaled
    after = start.copy()
    after[index] += size
    moved = after.copy()
    moved[own.positions_of(point.own)] += shift
    return AddedEffect(own, amplitude, start, own.within(after), own.within(moved), cost)


def _cell_limits(samples: Samples) -> dict[tuple[str, str], float]:
    """Return the root mean square, by test and phase, beyond which a model set by hand fails.

    It is the limit of the check of a fit (`qlvbayes.fitting.residuals`), for constants that are
    known exactly: noise, and errors of the motion and of the zero of displacement, exceed it in
    1 % of pads.
    """
    cells = {}
    for k, trial in enumerate(samples.trials):
        covariance, phases = _covariance(samples, k), samples.phases(k)
        for kind in KINDS:
            here = np.flatnonzero(phases == kind)
            if here.size:
                cells[trial.name, kind] = _cumulants(covariance[np.ix_(here, here)])
    level = FALSE_ALARMS / max(len(cells), 1)
    return {cell: error_limit(cumulants, level) for cell, cumulants in cells.items()}


def _covariance(samples: Samples, k: int) -> Array:
    """Return the covariance (n, n) of the errors of the samples of test k (N^2)."""
    floor, time = samples.experiment.floor, samples.trials[k].test.time[samples.rows[k]]
    scale, weight, extra, timing = (
        samples.of_blocks(k, name) for name in ("scale", "weight", "extra", "timing")
    )
    blocks, real = samples.space.record.blocks, samples.space.real[k]
    middle = 0.5 * (np.asarray(blocks.first) + np.asarray(blocks.last))[k, real]
    contact = np.interp(time, middle, np.asarray(blocks.contact)[k, real])
    correlated = floor.ou**2 * np.exp(-np.abs(time[:, None] - time) / floor.tau)
    noise = np.outer(scale, scale) * (correlated + np.diag((floor.white * weight) ** 2))
    common = np.outer(extra, extra) + np.outer(contact, contact)
    tare = samples.trials[k].test.tare_sd
    return np.asarray(noise + np.diag(timing**2) + common + tare**2)


def _cumulants(covariance: Array) -> tuple[float, float, float]:
    """Return the first three cumulants of the mean square of a normal of this covariance."""
    scaled = covariance / len(covariance)
    squared = scaled @ scaled
    third = 8.0 * float(np.sum(squared * scaled))
    return float(np.trace(scaled)), 2.0 * float(np.trace(squared)), third
