"""The constants of a model as sliders: range, unit, meaning."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from qlvbayes.app.bench.model import NOISE
from qlvbayes.inference.space import Leaf, Parameters, Space
from qlvbayes.io.units import UnitSystem
from qlvbayes.model.parameters import unit_kinds
from qlvbayes.priors.joint import Dirichlet

_DRAWS = 400  # of a prior, for its quantiles
_ENDS = (0.005, 0.05, 0.95, 0.995)  # of the slider, of the 90 % interval
_DECADES = 20.0  # ratio of the slider's ends from which on it is better logarithmic


@dataclass(frozen=True)
class Slider:
    """One constant: its value, the slider's ends, the central 90 % of its prior.

    log: whether the slider is better logarithmic; owner: the law or effect it belongs to; derived:
    whether it follows from the others.
    """

    name: str
    unit: str
    meaning: str
    value: float
    low: float
    high: float
    prior: tuple[float, float]
    log: bool
    owner: str
    derived: bool


def sliders(
    own: Parameters, space: Space, units: UnitSystem, constants: NDArray[np.float64]
) -> list[Slider]:
    """Of every constant but the noise's, in the order of their names."""
    kinds = unit_kinds(own.posterior)
    found = []
    for leaf in own.leaves:
        ends = _quantiles(leaf)
        for k, place in enumerate(leaf.constants):
            name = own.names[place]
            if name.startswith(NOISE):
                continue
            owner, meaning = _belongs(own, space, name)
            low, least, most, high = ends[:, k].tolist()
            value = float(constants[place])
            low, high = min(low, value), max(high, value)
            log = low > 0.0 and high / low > _DECADES and not isinstance(leaf.prior, Dirichlet)
            derived = isinstance(leaf.prior, Dirichlet) and k == 0
            unit = units.of(kinds[place])
            slider = Slider(
                name, unit, meaning, value, low, high, (least, most), log, owner, derived
            )
            found.append(slider)
    return found


@lru_cache(512)  # a leaf is one object as long as its bench
def _quantiles(leaf: Leaf) -> NDArray[np.float64]:
    """(4, count) of its prior's draws, the same each time."""
    rng = np.random.default_rng(0)
    draws = np.stack([np.ravel(leaf.prior.draw(rng)) for _ in range(_DRAWS)])
    if isinstance(leaf.prior, Dirichlet):  # a share may be anything
        low, high = np.zeros(draws.shape[1]), np.ones(draws.shape[1])
        return np.stack([low, *np.quantile(draws, _ENDS[1:3], axis=0), high])
    return np.asarray(np.quantile(draws, _ENDS, axis=0))


def _belongs(own: Parameters, space: Space, name: str) -> tuple[str, str]:
    """Law or effect of a constant, and what the constant means."""
    effect, dot, _ = name.partition(".")
    if dot:
        return effect, space.effects[effect].law
    field, hypothesis = name.partition("[")[0], own.hypothesis
    elastic = space.elastic[hypothesis.elastic]
    if field in elastic.units:
        return hypothesis.elastic, elastic.meanings.get(field, "")
    relaxation = space.relaxation[hypothesis.relaxation]
    return hypothesis.relaxation, relaxation.meanings.get(field, "")
