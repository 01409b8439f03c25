r"""Could the tests show what is hidden? From the simulator's forces, without any diagnosis.

The data are the fitted model's own force at the true constants plus the hidden effect's force
pattern, the difference of two simulations without noise. The model that lacks the effect is fitted
to them with the noise held at its true sds; its leftover, whitened by that noise, is

.. math:: \chi^2 = \sum_k e_k^2 / S_k,

the part of the pattern that no change of the constants takes, which is the expected gain of
2 ln(likelihood) if the effect is added. The price is the share of the prior that is left: an
amplitude a with prior density p (`qlvbayes.inference.noticeable`) is found to within a/chi, its
k - 1 other constants to about 1/chi of their priors, so that

.. math:: E[2 \ln BF] = \chi^2 + \ln(2 \pi p^2(a) a^2 / \chi^2) - (k - 1) \ln \chi^2.

An effect that is not of the list in this form has no prior; its price is that with a at one prior
sd, :math:`k \ln \chi^2`. Of two effects, each is taken as missing from a model that
has the other. (1 + chi^2 stands for chi^2 in the logarithms.)

The noise decides what a study gets of it: its own 2 ln BF has z^2 in place of chi^2, z normal about
chi with sd 1. The chance that it passes a threshold bounds what any diagnosis can reach.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, log1p, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from qlvbayes.effects.catalogue import EFFECTS, find
from qlvbayes.evaluation.study import Study, true_noise, true_values
from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space, in_natural_amplitude, median
from qlvbayes.inference.modes import find_mode
from qlvbayes.inference.noticeable import log_density
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import Correlated
from qlvbayes.preprocess.experiment import Experiment
from qlvbayes.preprocess.noisefloor import NoiseFloor
from qlvbayes.priors.natural import in_own_numbers
from qlvbayes.simulate import HIDDEN, Effect

Array = NDArray[np.float64]

_ENOUGH = 5e-3  # expected rise of the log density below which the fit ends: 0.01 of chi^2
SEEN = 10.0  # expected 2 ln(Bayes factor) from which an effect counts as one that could be seen


@dataclass(frozen=True)
class Expected:
    """Of one hidden effect, what noise and the pad's constants leave, and the price of its own."""

    chi2: float
    price: float

    @property
    def evidence(self) -> float:
        """Expected 2 ln(Bayes factor) against the model without the effect."""
        return self.chi2 - self.price

    def chance(self, least: float) -> float:
        """Probability that a study's own 2 ln(Bayes factor) is at least this."""
        return float(norm.cdf(sqrt(self.chi2) - sqrt(max(least + self.price, 0.0))))


def expected(study: Study, experiment: Experiment) -> dict[str, Expected]:
    """Each hidden effect, of a model that has all others."""
    whole = study.forces(study.effects)
    space = _space(study, experiment)
    whitener = _noise(study, space, experiment.scales.force)
    found = {}
    for effect in study.effects:
        others = tuple(other for other in study.effects if other is not effect)
        pattern = [a - b for a, b in zip(whole, study.forces(others), strict=True)]
        shape = _averaged(experiment, pattern)
        chi2 = _leftover(space, whitener, _Truth.of(study, space, others), shape)
        found[effect.name] = Expected(chi2, _price(experiment, effect, chi2))
    return found


def _price(experiment: Experiment, effect: Effect, chi2: float) -> float:
    """2 ln of how much of the prior the data rule out."""
    count = sum(isinstance(value, float) for value in effect.parameters.values())
    price = count * log1p(chi2)
    if effect.name not in HIDDEN:
        return price
    listed = find(effect.name).default(experiment.scales)
    amplitude = next(iter(listed.null))
    size = effect.parameters[amplitude]
    density = log_density(getattr(listed, amplitude), size)
    return price - log(2.0 * pi * size**2) - 2.0 * density


def _leftover(space: Space, whitener: Whitener, truth: _Truth, shape: Array) -> float:
    """Whitened sum of squares that a model leaves of a pattern's block means (N; tests, blocks)."""
    data = space.forces(truth.hypothesis, truth.constants[None])[0] + shape
    none = Discrepancy.none(whitener, float(np.max(np.abs(data))))
    density = Density(space.with_forces(data), whitener, none)
    mode = find_mode(density, truth.hypothesis, truth.theta, enough=_ENOUGH)
    if mode is None:
        raise NoFiniteForceError
    return float(np.sum(mode.point.residual**2))


@dataclass(frozen=True, eq=False)
class _Truth:
    """The true constants (P,) of a model with some effects, and their theta (F,)."""

    hypothesis: Hypothesis
    constants: Array
    theta: Array

    @classmethod
    def of(cls, study: Study, space: Space, others: tuple[Effect, ...]) -> _Truth:
        (elastic,), (relaxation,) = space.elastic, space.relaxation
        hypothesis = Hypothesis(elastic, relaxation, frozenset(e.name for e in others))
        own = space.parameters(hypothesis)
        values = true_values(study.constants)
        for effect in others:
            values |= {f"{effect.name}.{key}": x for key, x in effect.parameters.items()}
        middle = median(space.plain_draws(hypothesis))
        constants = own.constants(middle[None])[0]
        for name, value in values.items():
            constants[own.names.index(name)] = value
        theta = own.posterior.unconstrain(constants)
        theta = np.where(np.isfinite(theta), theta, middle)  # outside of a prior's bounds
        return cls(hypothesis, constants, own.within(theta))


def _space(study: Study, experiment: Experiment) -> Space:
    """The plain law and every listed effect, with their default priors."""
    scales = experiment.scales
    model, _ = Choices(noise=study.fitted).build(scales)
    return Space(
        experiment.record(experiment.trials),
        {model.elastic.name: in_own_numbers(model.elastic)},
        {model.relaxation.name: in_own_numbers(model.relaxation)},
        {k.name: in_own_numbers(in_natural_amplitude(k.default(scales))) for k in EFFECTS},
        Correlated.from_floor(experiment.floor),
        model.bonded,
    )


def _noise(study: Study, space: Space, peak: float) -> Whitener:
    """Noise at its true sds."""
    true = true_noise(study.noise, study.fitted)
    correlated = true.get("noise.ou", 0.0), true.get("noise.tau", 1.0)  # N, s: any time of nothing
    return Whitener.of(NoiseFloor(true["noise.white"], *correlated), space.record.blocks, peak)


def _averaged(experiment: Experiment, forces: list[Array]) -> Array:
    """Block means (tests, blocks) of other forces (tests, n) at the trials' samples."""
    trials = [
        replace(trial, test=replace(trial.test, force=force))
        for trial, force in zip(experiment.trials, forces, strict=True)
    ]
    return np.asarray(experiment.record(trials).blocks.force)
