"""From a pad's tests and the user's choices to a search over hypotheses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from qlvbayes.choices import Choices
from qlvbayes.diagnosis.protocol import protocol_of
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.experiment import Experiment
from qlvbayes.hypotheses.prior import TOLERANCE, HypothesisPrior
from qlvbayes.hypotheses.search import Search, Tell
from qlvbayes.inference.density import Density
from qlvbayes.inference.discrepancy import Discrepancy
from qlvbayes.inference.features import Features, Places
from qlvbayes.inference.floor_covariance import LEAST_NOISE
from qlvbayes.inference.space import Hypothesis, Space, in_natural_amplitude
from qlvbayes.inference.whitening import Whitener
from qlvbayes.laws.catalogue import LAWS, Laws
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.records.record import Blocks
from qlvbayes.scales import Scales

Array = NDArray[np.float64]



def search_of(
    experiment: Experiment,
    choices: Choices | None = None,
    *,
    laws: Laws = LAWS,
    kinds: Sequence[type[AbstractEffect]] = EFFECTS,
    prior: HypothesisPrior | None = None,
    tell: Tell = lambda text: None,
) -> Search:
    """A search, not begun yet, over every law and effect that these tests can speak of.

    Effects made of a velocity or an acceleration that the records do not give are left out.
    """
    choices = choices or Choices()
    space = space_of(experiment, choices, laws, kinds)
    peak = experiment.scales.force
    blocks = space.record.blocks
    whitener = Whitener.of(experiment.floor, blocks, LEAST_NOISE * peak)
    shapes, _ = smooth_shapes(experiment, blocks)
    discrepancy = Discrepancy.of(whitener(shapes), peak, TOLERANCE)
    relaxation = f"prony:{choices.modes}" if choices.is_prony else choices.relaxation
    usual = Hypothesis(choices.law, relaxation)
    density = Density(space, whitener, discrepancy)
    return Search(density, prior or HypothesisPrior(), usual, tell)


def smooth_shapes(experiment: Experiment, blocks: Blocks) -> tuple[Array, Features]:
    """Features (M, T, B) of the discrepancy at block means, and at any place."""
    force, first, last, real = (
        np.asarray(x) for x in (blocks.force, blocks.first, blocks.last, blocks.real)
    )
    parts = [
        Places.of(experiment, trial, k, 0.5 * (first + last)[k, real[k]], force[k, real[k]])
        for k, trial in enumerate(experiment.trials)
    ]
    places = Places.joined(parts)
    features = Features.of(places)
    shapes = np.zeros((features.factor.shape[0], *real.shape))
    shapes[:, real] = features(places)
    return shapes, features


def space_of(
    experiment: Experiment, choices: Choices, laws: Laws, kinds: Sequence[type[AbstractEffect]]
) -> Space:
    """Laws and effects with their default priors at the scales of the tests."""
    scales = experiment.scales
    protocol = protocol_of(experiment, bonded=choices.bonded)
    effects = {
        kind.name: in_natural_amplitude(kind.default(scales))
        for kind in kinds
        if kind.unmeasured(protocol) is None and not (choices.bonded and kind.name == "adhesion")
    }
    return Space(
        experiment.record(experiment.trials),
        {kind.name: kind.default(scales) for kind in laws.elastic},
        _relaxations(scales, laws, choices),
        effects,
        experiment.noise_at_rest,
        choices.bonded,
    )


def _relaxations(scales: Scales, laws: Laws, choices: Choices) -> dict[str, AbstractRelaxation]:
    """A Prony series of the user's own number of modes; one more is an effect."""
    found: dict[str, AbstractRelaxation] = {}
    for kind in laws.relaxation:
        if kind is Prony:
            found[f"prony:{choices.modes}"] = Prony.of_modes(scales, choices.modes)
        else:
            found[kind.name] = kind.default(scales)
    return found
