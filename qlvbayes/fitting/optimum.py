"""Find the mode of a fit's posterior, from which sampling starts, and the curvature there.

The modes of the diagnosis (`qlvbayes.inference.modes`) are found from several draws of the priors.
There the discrepancy is separated from what the derivatives of the force can follow, so that the
curve follows the data. The highest of them is then located closely: what a discrepancy may have
moved the constants by depends on where it lies.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from qlvbayes.fitting.least_squares import NormalApproximation, covariance_from, sums_of_squares
from qlvbayes.fitting.marginal_likelihood import (
    Spread,
    discrepancy_of,
    floor_likelihood,
    has_uncertain_zeros,
    white_likelihood,
    with_zero_errors,
)
from qlvbayes.fitting.posterior import Posterior, Predictor
from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.scatter import UNDECIDED
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.inference.modes import Mode, base_modes, find_mode
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.model.choices import Choices
from qlvbayes.model.model import Model
from qlvbayes.model.noise import Floor, White
from qlvbayes.motion.experiment import Experiment, Trial

_STARTS = 8  # draws of the priors, those nearest to the data, from which modes are looked for
_REDRAWN = 6  # draws of the relaxation in a row that lead no higher, after which the search ends
_CLOSE = 1e-6  # predicted rise of the log density of a step at which the mode is located

Tests = tuple[Trial, ...]


@dataclass(frozen=True, eq=False)
class Start:
    """Where sampling starts: the posterior, the normal approximation about its mode, the spread.

    spread: None where no discrepancy is modelled.
    """

    posterior: Posterior
    normal: NormalApproximation
    spread: Spread | None


def predictor_of(experiment: Experiment, choices: Choices, trials: Tests) -> Predictor:
    """Return the predictor of the chosen model over the block means of some trials."""
    experiment = replace(experiment, rested=choices.rested)
    return Predictor.from_model(*choices.build(experiment.scales), experiment.record(trials))


def best_model(experiment: Experiment, choices: Choices, trials: Tests, seed: int = 0) -> Model:
    """Return the chosen model with the numbers of its highest mode in its fields."""
    predictor = predictor_of(experiment, choices, trials)
    mode = _highest(_density(experiment, predictor, trials), predictor, seed)
    return predictor.parameters.model_at(mode.point.constants)


def find_start(experiment: Experiment, choices: Choices, trials: Tests, seed: int = 0) -> Start:
    """Return where sampling starts.

    Raises NoFiniteForceError where no draw of the priors has a finite force.
    """
    predictor = predictor_of(experiment, choices, trials)
    density = _density(experiment, predictor, trials)
    mode = _highest(density, predictor, seed)
    noise, own = predictor.noise, predictor.parameters
    if isinstance(noise, Floor) and has_uncertain_zeros(predictor.model, trials):
        model = own.model_at(mode.point.constants)
        predictor = predictor.over(with_zero_errors(predictor.record, trials, model))
        density = _density(experiment, predictor, trials)
    mode = find_mode(density, predictor.hypothesis, mode.point.theta, min_gain=_CLOSE) or mode
    point, blocks = mode.point, predictor.record.blocks
    if isinstance(noise, Floor):
        separation = density.discrepancy.separated(point.responses, own.length)
        likelihood = floor_likelihood(experiment, noise, density.discrepancy, separation)
    else:
        assert isinstance(noise, White)
        residual = np.asarray(blocks.force) - point.predicted
        likelihood = white_likelihood(noise, blocks, experiment.scales.noise, residual)
    posterior = Posterior(predictor.space, predictor.hypothesis, noise, likelihood)
    normal = NormalApproximation(point.theta, covariance_from(mode.curvature, own.length))
    if not isinstance(noise, Floor):
        return Start(posterior, normal, None)
    discrepancy = density.discrepancy
    if len(trials) > 1:
        discrepancy = replace(discrepancy, scatter=UNDECIDED)
    return Start(posterior, normal, Spread.about(discrepancy, point))


def _density(experiment: Experiment, predictor: Predictor, trials: Tests) -> Density:
    """Return the density of the diagnosis, of the one model of a fit."""
    noise, blocks = predictor.noise, predictor.record.blocks
    if isinstance(noise, Floor):
        discrepancy = discrepancy_of(experiment, trials, blocks, noise)
        return Density(predictor.space, discrepancy)
    floor = replace(experiment.floor, white=experiment.scales.noise, ou=0.0, dwells=None)
    whitener = Whitener.from_floor(floor, blocks, experiment.scales.force)
    return Density(predictor.space, Discrepancy.none(whitener, experiment.scales.force))


def _highest(density: Density, predictor: Predictor, seed: int) -> Mode:
    """Return the highest mode that draws of the priors lead to."""
    hypothesis, real = predictor.hypothesis, predictor.space.real
    draws = predictor.parameters.within(predictor.space.prior_draws(hypothesis, seed))
    squares = sums_of_squares(predictor, np.ones(real.shape), draws)
    order = [k for k in np.argsort(squares) if np.isfinite(squares[k])]
    found = base_modes(density, hypothesis, draws[order[:_STARTS]], seed, _REDRAWN)
    if not found:
        raise NoFiniteForceError
    return found[0]
