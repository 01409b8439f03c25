"""Describe a model put together by hand, the values of its constants, and their sliders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.forward.hypothesis import Hypothesis, Leaf, Parameters
from qlvbayes.inference.forward.space import Space
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.units import UnitSystem
from qlvbayes.model.parameters import unit_kinds
from qlvbayes.priors.joint import Dirichlet, Ordered

NOISE = "noise."  # prefix of the noise floor's constants, which are measured and not moved
_LEAST = 1e-9  # smallest share, and relative distance of two rates, whose logarithms are finite
_DRAWS = 400  # draws of a prior for its quantiles
_ENDS = (0.005, 0.05, 0.95, 0.995)  # quantiles: the slider's ends, and the 90 % interval between
_DECADES = 20.0  # ratio of the slider's ends beyond which it is logarithmic


@dataclass(frozen=True)
class ByHand:
    """Model given by the names of its laws and effects and the values of its constants.

    elastic: Name of the elastic law; relaxation: Name of the relaxation law, as after
    ``--relaxation``; effects: Names of the effects; values: Values of constants by name
    (`FitSummary.parameters`). A missing constant is at its prior's median, a missing amplitude of
    an effect at zero.
    """

    elastic: str = "exponential"
    relaxation: str = "prony:2"
    effects: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def hypothesis(self) -> Hypothesis:
        """Return the model's laws and effects."""
        return Hypothesis(self.elastic, self.relaxation, frozenset(self.effects))


def checked(model: ByHand, space: Space) -> None:
    """Raise InputError where a law or effect is unknown, or two effects are forms of one."""
    check_known("elastic law", model.elastic, space.elastic)
    check_known("relaxation", model.relaxation, space.relaxation)
    families: dict[str, str] = {}
    for name in model.effects:
        check_known("effect", name, space.effects)
        other = families.setdefault(space.effects[name].family(), name)
        if other != name:
            text = f"{other} and {name} are forms of one effect"
            raise InputError(text, remedy="take one of them out first")
    for name, value in model.values.items():
        if not np.isfinite(value):
            raise InputError(f"{name} is no number", remedy="give a finite number")


def constants_of(model: ByHand, space: Space) -> Array:
    """Return (P,) constants in the order of a hypothesis's names, absent ones at their medians."""
    own = space.parameters(model.hypothesis)
    constants = own.constants(nothing_added(own, space)[None])[0]
    for leaf in own.leaves:
        indices = range(leaf.constants.start, leaf.constants.stop)
        given = [model.values.get(own.names[k], np.nan) for k in indices]
        values = np.where(np.isfinite(given), given, constants[list(indices)])
        constants[list(indices)] = _allowed(leaf, values)
    return constants


def _allowed(leaf: Leaf, values: Array) -> Array:
    if isinstance(leaf.prior, Dirichlet):
        rest = np.maximum(values[1:], 0.0)
        rest = rest / max(float(rest.sum()), 1.0)
        return np.concatenate([[1.0 - float(rest.sum())], rest])
    if isinstance(leaf.prior, Ordered):
        return -np.sort(-np.maximum(values, _LEAST))
    return values


def theta_of(own: Parameters, constants: Array) -> Array:
    """Return (F,) free parameters of constants (P,), brought within their bounds."""
    theta = np.zeros(own.size)
    for leaf in own.leaves:
        values = constants[leaf.constants.start : leaf.constants.stop]
        if isinstance(leaf.prior, Dirichlet):
            values = np.maximum(values, _LEAST)
        if isinstance(leaf.prior, Ordered):
            values = values * (1.0 - _LEAST * np.arange(values.size))
        with np.errstate(divide="ignore", invalid="ignore"):
            free = np.ravel(leaf.prior.unconstrain(values if values.size > 1 else values[0]))
        theta[list(leaf.theta)] = np.nan_to_num(free, neginf=-_FAR, posinf=_FAR)
    return np.asarray(own.within(theta))


_FAR = 700.0  # a logarithm whose exponential is still finite


def values_of(own: Parameters, constants: Array) -> dict[str, float]:
    """Return constants (P,) by name, without the noise's."""
    pairs = zip(own.names, constants.tolist(), strict=True)
    return {name: value for name, value in pairs if not name.startswith(NOISE)}


def nothing_added(own: Parameters, space: Space) -> Array:
    """Return (F,) free parameters at their priors' medians, every effect's amplitude at zero."""
    theta = np.median(space.prior_draws(own.hypothesis), axis=0)
    for effect, amplitude in own.amplitude_of.items():
        theta[amplitude.number] = next(iter(space.effects[effect].null.values()))
    return np.asarray(own.within(theta))


@dataclass(frozen=True)
class Slider:
    """Slider of one constant: its value, its ends, and the central 90 % of the prior."""

    name: str
    unit: str
    meaning: str
    value: float
    low: float
    high: float
    prior: tuple[float, float]  # the central 90 % of the constant's prior
    log: bool  # whether the slider is logarithmic
    owner: str  # the law or effect that the constant belongs to
    derived: bool  # whether the constant follows from the others


def sliders(
    own: Parameters, space: Space, units: UnitSystem, constants: NDArray[np.float64]
) -> list[Slider]:
    """Return the slider of every constant but the noise's, in the order of their names."""
    kinds = unit_kinds(own)
    all_sliders = []
    for leaf in own.leaves:
        ends = _quantiles(leaf)
        for k, index in enumerate(leaf.constants):
            name = own.names[index]
            if name.startswith(NOISE):
                continue
            owner, meaning = _belongs(own, space, name)
            low, least, most, high = ends[:, k].tolist()
            value = float(constants[index])
            low, high = min(low, value), max(high, value)
            log = low > 0.0 and high / low > _DECADES and not isinstance(leaf.prior, Dirichlet)
            derived = isinstance(leaf.prior, Dirichlet) and k == 0
            unit = units.of(kinds[index])
            slider = Slider(
                name, unit, meaning, value, low, high, (least, most), log, owner, derived
            )
            all_sliders.append(slider)
    return all_sliders


@lru_cache(512)  # a leaf is one object for the life of its bench
def _quantiles(leaf: Leaf) -> NDArray[np.float64]:
    """Return (4, count) quantiles of a prior's draws, the same each time."""
    rng = np.random.default_rng(0)
    draws = np.stack([np.ravel(leaf.prior.draw(rng)) for _ in range(_DRAWS)])
    if isinstance(leaf.prior, Dirichlet):  # a share may be anything
        low, high = np.zeros(draws.shape[1]), np.ones(draws.shape[1])
        return np.stack([low, *np.quantile(draws, _ENDS[1:3], axis=0), high])
    return np.asarray(np.quantile(draws, _ENDS, axis=0))


def _belongs(own: Parameters, space: Space, name: str) -> tuple[str, str]:
    """Return the law or effect of a constant, and what the constant means."""
    effect, dot, _ = name.partition(".")
    if dot:
        return effect, space.effects[effect].law
    field, hypothesis = name.partition("[")[0], own.hypothesis
    elastic = space.elastic[hypothesis.elastic]
    if field in elastic.units:
        return hypothesis.elastic, elastic.meanings.get(field, "")
    relaxation = space.relaxation[hypothesis.relaxation]
    return hypothesis.relaxation, relaxation.meanings.get(field, "")
