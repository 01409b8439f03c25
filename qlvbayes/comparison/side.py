"""Read one side of a comparison from a fit, a results file or draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import permutations

import jax
import numpy as np

from qlvbayes.comparison.readings import Reading, ReadingSettings, read
from qlvbayes.fitting.fit import Fit
from qlvbayes.fitting.results import Saved
from qlvbayes.io.checks import InputError
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.laws.catalogue import find_elastic
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import (
    check_draws,
    described_model,
    drawn_models,
    factors,
    infer_choices,
    lasting_share,
    pad_alone,
    rig_effects,
    wanted_names,
)
from qlvbayes.model.model import Model
from qlvbayes.model.parameters import fields_of
from qlvbayes.motion.facts import Covered, covered

_LONGER = 1.5  # times as long a hold, or as quick a ramp, from which on tests are unlike
_WITHIN = 0.1  # of a ramp: what relaxes in less has gone when it ends
MOST_DRAWS = 1000  # of a pad, evenly out of all

Source = Fit | Saved | Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Side:
    """Draws (n, P) of the named constants, their model, and the ranges of its tests."""

    name: str
    names: tuple[str, ...]
    draws: np.ndarray
    choices: Choices
    units: UnitSystem
    reach: Covered | None = None
    fluid: str | None = None
    fitted: tuple[str, ...] = ()  # names of the fitted tests, where they are known
    converged: bool = True  # whether nothing spoke against the sampling, where that is known
    # relative sds between tests of the stiffness and of the effects' strengths, where known
    scatter: Mapping[str, float] = field(default_factory=dict)

    @property
    def constants(self) -> dict[str, np.ndarray]:
        """Draws (n,) of each constant."""
        return {name: self.draws[:, k] for k, name in enumerate(self.names)}

    @property
    def kinds(self) -> dict[str, str]:
        """Kind of unit of each constant of the pad, without noise and rig."""
        alone = pad_alone(described_model(self.choices))
        return {name: field.unit for field in fields_of(alone) for name in field.names}

    @property
    def relaxation(self) -> tuple[str, ...]:
        """The relaxation and the effects that change it, without which c and v are not its own."""
        reshaping = described_model(self.choices).reshaping
        return (self.choices.relaxing, *(effect.name for effect in reshaping))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects of the rig, which are not compared."""
        return rig_effects(described_model(self.choices))

    def in_units(self, units: UnitSystem) -> Side:
        """Return the pad in other units; InputError where strain would have to become a length."""
        if units == self.units:
            return self
        by = factors(self.choices, self.constants, self.units, units)
        draws = np.stack([x * by[name] for name, x in self.constants.items()], axis=-1)
        by_length = self.units.factor_to(units, "displacement")
        reach = None if self.reach is None else self.reach.times(by_length)
        return replace(self, draws=draws, units=units, reach=reach)

    @property
    def models(self) -> Model:
        """Whole model with the rig's effects, whose constants have the draws as leading axis."""
        law = find_elastic(self.choices.elastic, self.choices.laws)
        if self.reach is None and not law.listed:
            raise InputError(
                f"the posterior of {self.name} does not say how deep its tests went, over which "
                f"{law.name} is a curve",
                remedy="run qlvbayes fit again",
            )
        depth = self.reach.depth if self.reach else 1.0
        return drawn_models(described_model(self.choices, depth), self.names, self.draws)

    def some(self, count: int) -> Side:
        """Return the side with at most ``count`` draws, evenly spaced; one is their mean."""
        if count == 1:
            return replace(self, draws=self.draws.mean(axis=0, keepdims=True))
        return replace(self, draws=_some(self.draws, count))

    @cached_property
    def lasting(self) -> np.ndarray | None:
        """Share (n,) of the force that never relaxes, effects that change it included."""
        return lasting_share(self.choices, self.names, self.draws)

    def stated(self, quantity: str) -> np.ndarray:
        """Return draws (n,) of a constant, or of the share that never relaxes."""
        draws = self.constants[quantity] if quantity in self.names else self.lasting
        assert draws is not None
        return draws

    def read(self, settings: ReadingSettings) -> np.ndarray:
        """Return the derived quantities (n, Q) of each draw."""
        return read(pad_alone(self.models), settings)


def side_of(source: Source, name: str) -> Side:
    """Return a side from a fit, a results file, or a dict of draws by the constants' names."""
    if isinstance(source, Fit):
        tests, fitted = source.experiment, tuple(trial.name for trial in source.trials)
        known = tests.units, covered(tests), tests.fluid, fitted, source.enough
        draws = _some(source.constants.reshape(-1, len(source.names)))
        return Side(source.pad, tuple(source.names), draws, source.choices, *known)
    if isinstance(source, Saved):
        stated = source.units, source.covered, source.fluid, source.fitted, source.converged
        return Side(source.pad, source.names, _some(source.draws), source.choices, *stated)
    given = {key: np.ravel(np.asarray(values, float)) for key, values in source.items()}
    choices = infer_choices(given)
    names = tuple(wanted_names(choices, given))
    check_draws(choices, {key: given[key] for key in names})
    return Side(name, names, _some(np.stack([given[k] for k in names], axis=-1)), choices, PAD)


def _some(draws: np.ndarray, count: int = MOST_DRAWS) -> np.ndarray:
    """Return at most ``count`` draws, evenly out of all."""
    return draws[np.linspace(0, len(draws) - 1, min(count, len(draws))).astype(int)]


def unheld_times(sides: Sequence[Side]) -> list[str]:
    """Return sentences on relaxation times of a pad that another's tests do not hold."""
    unheld = []
    for side, other in permutations(sides, 2):
        own, others = side.reach, other.reach
        if own is None or others is None:
            continue
        mean = jax.tree.map(lambda leaf: leaf[0], side.some(1).models.relaxation)
        for name, value in mean.times().items():
            time = float(value)
            text = f"{name} of {side.name} is {plain(time, 2)} s, and"
            if own.hold > _LONGER * others.hold and time > others.hold:
                unheld.append(f"{text} {other.name} was held for {plain(others.hold, 2)} s")
            elif _LONGER * own.quickest < others.quickest and time < _WITHIN * others.quickest:
                took = f"took {plain(others.quickest, 2)} s"
                unheld.append(f"{text} the quickest ramp of {other.name} {took}")
    return unheld


def shared_constants(sides: Sequence[Side]) -> list[Reading]:
    """Return constants that mean the same in all models and vary in one at least.

    They mean the same where they are of one law, or one effect, in all models.
    """
    first = sides[0]
    elastic = find_elastic(first.choices.elastic, first.choices.laws).units
    shared = []
    for name, kind in first.kinds.items():
        laws = [
            side.choices.elastic if name.split("[")[0] in elastic else side.relaxation
            for side in sides
        ]
        same = all(name in side.kinds for side in sides) and ("." in name or len(set(laws)) == 1)
        if same and any(np.ptp(side.constants[name]) > 0.0 for side in sides):
            group = "effects" if "." in name else "constants"
            shared.append(Reading(name, first.units.of(kind), group, False))
    return shared


def lasting_shares(sides: Sequence[Side], shared: Sequence[Reading]) -> list[Reading]:
    """Return the share that never relaxes where all models have one, but no constant states it."""
    stated = {"c[0]", "c0"}.intersection(reading.quantity for reading in shared)
    if stated or any(side.lasting is None for side in sides):
        return []
    return [Reading("share that never relaxes", "1", "relaxation", False)]


def fixed_constants(sides: Sequence[Side]) -> list[str]:
    """Return constants that were fixed in all models."""
    first = sides[0]
    return [
        name
        for name in first.kinds
        if all(name in s.kinds and np.ptp(s.constants[name]) == 0.0 for s in sides)
    ]
