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

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.stats import norm

from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.evaluation.study import Study, true_noise, true_values
from qlvbayes.inference.gaussnewton import climb, pad_directions, predict_along
from qlvbayes.inference.linearised import prior_terms, whitened
from qlvbayes.inference.noticeable import log_density
from qlvbayes.inference.subset import Ensemble, Subset, with_every_effect
from qlvbayes.model.choices import Choices
from qlvbayes.model.posterior import Posterior
from qlvbayes.model.record import Record
from qlvbayes.preprocess.experiment import Experiment
from qlvbayes.simulate import HIDDEN, Effect

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
    ensemble = _ensemble(study, experiment)
    found = {}
    for effect in study.effects:
        others = tuple(other for other in study.effects if other is not effect)
        pattern = [a - b for a, b in zip(whole, study.forces(others), strict=True)]
        shape = _record(experiment, pattern).blocks.force
        chi2 = _leftover(ensemble, _Truth.of(study, ensemble, others), shape)
        found[effect.name] = Expected(chi2, _price(ensemble, effect, chi2))
    return found


def _price(ensemble: Ensemble, effect: Effect, chi2: float) -> float:
    """2 ln of how much of the prior the data rule out."""
    count = sum(isinstance(value, float) for value in effect.parameters.values())
    price = count * log1p(chi2)
    if effect.name not in HIDDEN:
        return price
    listed = ensemble.effect(effect.name)
    amplitude = next(iter(listed.null))
    size = effect.parameters[amplitude]
    density = log_density(getattr(listed, amplitude), size)
    return price - log(2.0 * pi * size**2) - 2.0 * density


def _leftover(ensemble: Ensemble, truth: _Truth, shape: Array) -> float:
    """Whitened sum of squares that a model leaves of a pattern's block means (N; tests, blocks)."""
    record = ensemble.posterior.record
    data = jnp.asarray(_predict(ensemble, truth.constants)) + shape
    tested = ensemble.with_record(eqx.tree_at(lambda r: r.blocks.force, record, data))
    point = climb(tested, truth.subset, truth.theta)
    residual = data - jnp.asarray(_predict(tested, point.constants))
    noise = type(ensemble.posterior.noise)(*map(jnp.asarray, truth.noise))
    return float(jnp.sum(whitened(noise, record, residual[None]) ** 2))


@dataclass(frozen=True, eq=False)
class _Truth:
    """The true constants (P,), their theta (D,), the noise's, and what is free in the fit."""

    constants: np.ndarray
    theta: np.ndarray
    noise: np.ndarray
    subset: Subset

    @classmethod
    def of(cls, study: Study, ensemble: Ensemble, others: tuple[Effect, ...]) -> _Truth:
        values = true_values(study.constants) | true_noise(study.noise, study.fitted)
        for effect in others:
            values |= {f"{effect.name}.{key}": x for key, x in effect.parameters.items()}
        centre = ensemble.centre
        constants = np.array(prior_terms(ensemble.posterior, jnp.asarray(centre)).constants)
        for name, value in values.items():
            constants[ensemble.names.index(name)] = value
        theta = np.asarray(ensemble.posterior.unconstrain(constants))
        theta = np.where(np.isfinite(theta), theta, centre)  # outside of a prior's bounds
        subset = _noise_held(ensemble, ensemble.subset(tuple(e.name for e in others)))
        count = len(ensemble.posterior.noise.units)
        return cls(subset.nulled(constants), theta, constants[-count:], subset)


def _noise_held(ensemble: Ensemble, subset: Subset) -> Subset:
    """The subset without the noise's numbers."""
    held = ensemble.places[-len(ensemble.posterior.noise.units) :]
    theta = [k for place in held for k in place.theta]
    constants = [k for place in held for k in place.constants]
    return replace(
        subset,
        theta=np.setdiff1d(subset.theta, theta),
        constants=np.setdiff1d(subset.constants, constants),
        priors=np.setdiff1d(subset.priors, [p.prior for p in held if p.prior is not None]),
    )


def _ensemble(study: Study, experiment: Experiment) -> Ensemble:
    """Every listed effect with its default prior."""
    scales = experiment.scales
    model, noise = Choices(noise=study.fitted).build(scales)
    posterior = Posterior(model, noise, experiment.record(experiment.trials))
    costly = tuple(kind.name for kind in EFFECTS if kind.costly)
    return with_every_effect(posterior, tuple(kind.default(scales) for kind in EFFECTS), costly)


def _record(experiment: Experiment, forces: list[np.ndarray]) -> Record:
    """Block averages of other forces (tests, n) at the trials' samples."""
    trials = [
        replace(trial, test=replace(trial.test, force=force))
        for trial, force in zip(experiment.trials, forces, strict=True)
    ]
    return experiment.record(trials)


def _predict(ensemble: Ensemble, constants: np.ndarray) -> np.ndarray:
    """Block means (T, B) of constants (P,)."""
    still = pad_directions(np.zeros((1, constants.size)))
    return predict_along(ensemble, constants, still)[0]
