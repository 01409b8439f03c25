r"""Constants where the tests do not rule out other explanations: averaged over all of them.

With weights w proportional to the posterior probability of each explanation (Hoeting et al. 1999,
doi:10.1214/ss/1009212519),

.. math:: \mu = \sum_k w_k \mu_k, \quad \sigma^2 = \sum_k w_k (\sigma_k^2 + (\mu_k - \mu)^2)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import softmax

from qlvbayes.diagnosis.adequacy import is_sound
from qlvbayes.diagnosis.search import Path
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.verdict import Estimate
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.subset import Ensemble


@dataclass(frozen=True, eq=False)
class Explanation:
    """A model that the tests do not rule out.

    log_odds: posterior, against the last model.
    """

    effects: tuple[str, ...]
    log_odds: float
    point: Point


def explanations_of(
    experiment: Experiment,
    ensemble: Ensemble,
    path: Path,
    settings: Settings,
    enough: Callable[[Point], bool] | None = None,
) -> list[Explanation]:
    """The last model, and those with another effect, or none, in the place of one of its own.

    Of them all that leave no structure and are in the window: behind the last model, or behind the
    likeliest if the last has no effects. enough: whether what a model leaves does not matter, by
    default whether it leaves no structure.
    """
    enough = enough or partial(_is_sound, experiment, ensemble, settings)
    last, found = path.last, [Explanation(path.last.effects, 0.0, path.last.point)]
    for effect, place in (path.places if last.effects else {"none": path.rounds[0]}).items():
        rest = tuple(name for name in last.effects if name != effect)
        logs = place.log_weights(settings)
        holder = logs[effect] if last.effects else max(logs.values())
        points = {"none": place.base} | {c.effect: c.point for c in place.contenders}
        for name, point in points.items():
            near = name != effect and holder - logs[name] < settings.window
            if near and point and enough(point):
                effects = rest if name == "none" else (*rest, name)
                found.append(Explanation(effects, logs[name] - logs[effect], point))
    return found


def _is_sound(experiment: Experiment, ensemble: Ensemble, settings: Settings, point: Point) -> bool:
    return is_sound(experiment, ensemble, point, settings)


def averaged(
    log_weights: Sequence[float], explanations: Sequence[Mapping[str, Estimate]]
) -> dict[str, Estimate]:
    """Mean and sd of every constant that all explanations have."""
    weights = softmax(np.asarray(log_weights, dtype=float))
    first, *others = explanations
    return {
        name: _mixture(weights, [found[name] for found in explanations])
        for name in first
        if all(name in found for found in others)
    }


def _mixture(weights: np.ndarray, found: Sequence[Estimate]) -> Estimate:
    means, sds = (np.array([getattr(e, key) for e in found]) for key in ("mean", "sd"))
    mean = float(weights @ means)
    variance = float(weights @ (sds**2 + (means - mean) ** 2))
    return Estimate(found[0].unit, mean, variance**0.5)
